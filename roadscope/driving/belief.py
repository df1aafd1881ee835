"""Observations of highway-env made of tracks in place of the true traffic."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from highway_env.vehicle.kinematics import Vehicle

from roadscope.core import Tracks
from roadscope.envs.traffic.conversion import ForeignEnvError, from_world

BESIDE_ROAD_M = 3.0
"""Tracks that are farther than this beside every lane are left out; chosen by hand."""
OBSERVATIONS = ("Kinematics", "OccupancyGrid", "TimeToCollision")
"""Types of highway-env's observations that can be made of tracks."""


class BelievedObservation:
    """The observation of a highway-env environment, of tracks in place of true vehicles.

    highway-env's own code makes it, from a road on which the tracks drive. The ego, the lanes and
    fixed obstacles are those of the environment.

    env: an unwrapped environment, after a reset. seed: of the order in which `order="shuffled"`
    lists vehicles. config: settings of the observation; None for those of the environment.
    """

    def __init__(self, env: Any, seed: int, config: Mapping[str, Any] | None = None) -> None:
        from highway_env.envs.common.observation import observation_factory

        settings = dict(env.config["observation"] if config is None else config)
        check_observation(settings)
        self._believed = _BelievedEnv(env, np.random.default_rng(seed))
        self._type = observation_factory(self._believed, settings)

    @property
    def space(self) -> spaces.Space[Any]:
        """The space of the observations."""
        space: spaces.Space[Any] = self._type.space()
        return space

    def observe(self, tracks: Tracks) -> np.ndarray:
        """Return the observation; tracks: frame `world`, at the environment's instant."""
        self._believed.road = believed_road(self._believed.env, tracks)
        observation: np.ndarray = self._type.observe()
        return observation


def check_observation(config: Mapping[str, Any]) -> None:
    """Raise `ForeignEnvError` if an observation of highway-env cannot be made of tracks."""
    kind = config["type"]
    if kind not in OBSERVATIONS:
        raise ForeignEnvError(
            f"an observation of type '{kind}' cannot be made of tracks; possible: "
            f"{', '.join(OBSERVATIONS)}"
        )


class _BelievedEnv:
    """An environment whose road has the tracks on it; all else is the environment's."""

    def __init__(self, env: Any, np_random: np.random.Generator) -> None:
        self.env, self.road, self.np_random = env, env.road, np_random

    def __getattr__(self, name: str) -> Any:
        # `copy` and `pickle` look for special methods; those of the environment copy that.
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.env, name)


def believed_road(env: Any, tracks: Tracks) -> Any:
    """Return the road of an environment with its ego, and with tracks as all other vehicles.

    Tracks that are more than `BESIDE_ROAD_M` away from the nearest lane are left out.
    """
    road = copy.copy(env.road)
    road.vehicles = [env.vehicle]
    states = from_world(tracks.centres[:, :2], tracks.yaws, tracks.velocities)
    for position, heading, velocity, size in zip(*states, tracks.sizes, strict=True):
        vehicle = BelievedVehicle(road, position, heading, 0.0)
        vehicle.speed = float(velocity @ vehicle.direction)
        vehicle.velocity = velocity
        vehicle.LENGTH, vehicle.WIDTH = size[:2]
        if vehicle.lane.on_lane(vehicle.position, margin=BESIDE_ROAD_M):
            road.vehicles.append(vehicle)
    return road


class BelievedVehicle(Vehicle):  # type: ignore[misc]
    """A vehicle with an estimated velocity, which may not be along its heading."""

    velocity = np.zeros(2)
