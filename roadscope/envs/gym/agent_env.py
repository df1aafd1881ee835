"""highway-env's motorway for an agent, with traffic by kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from highway_env.envs.highway_env import HighwayEnv

from roadscope.envs.traffic.agent_road import AgentRoad


class MotorwayEnv(HighwayEnv):  # type: ignore[misc]
    """`HighwayEnv` with its actions, rewards and traffic, stepped by kernels.

    With other drivers than highway-env's `IDMVehicle`, and with connected lanes or trajectories to
    show, its objects are stepped instead.

    observes: whether observations are made from the next reset on; otherwise they are empty.
    """

    observes = True

    def define_spaces(self) -> None:
        """Set the spaces, and what makes observations."""
        super().define_spaces()
        if not self.observes:
            self.observation_type = _Nothing()

    def _reset(self) -> None:
        super()._reset()
        if not self.config["neighbour_vehicles_connected_lanes"]:
            AgentRoad.adopt(self.road, self.vehicle)


class _Nothing:
    """An observation of highway-env without content."""

    def space(self) -> spaces.Box:
        return spaces.Box(0.0, 1.0, (0,), np.float32)

    def observe(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        return np.empty(0, np.float32)
