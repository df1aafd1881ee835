"""The environments of our own Gymnasium ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator
from highway_env.envs.highway_env import HighwayEnv

from roadscope.envs.gym.observer import warn_without_render_mode
from roadscope.envs.gym.playback import PlaybackEnv
from roadscope.envs.gym.sensor_wrapper import SensorWrapper
from roadscope.envs.gym.spaces import Observation
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weathers import Weather
from roadscope.envs.traffic.agent_road import AgentRoad
from roadscope.envs.traffic.conversion import original_constants
from roadscope.envs.traffic.scenarios import find

EGOS = ("agent", "idm")
"""Possible drivers: the agent's action, or the ego's own driver model."""

ACTION_INFO = ("action", "rewards")
"""Entries of `info` about an action that highway-env drew without a seed in a reset; left out."""


@dataclass(frozen=True)
class Task:
    """An environment in which an agent drives.

    env: `module:Class`.
    config: settings that differ from the environment's defaults.
    limit_s: time after which the episode is truncated.
    counted: whether the number of other vehicles can be chosen.
    """

    env: str
    config: Mapping[str, Any] = field(default_factory=dict)
    limit_s: float = 60.0
    counted: bool = False


_MOTORWAY, _FOREIGN = f"{__name__}:MotorwayEnv", "highway_env.envs"
TASKS: Mapping[str, Task] = MappingProxyType(
    {
        "motorway": Task(_MOTORWAY, counted=True),
        "dense-motorway": Task(_MOTORWAY, {"vehicles_density": 1.5}, counted=True),
        "merge": Task(f"{_FOREIGN}.merge_env:ConnectedLaneMergeEnv"),
        "roundabout": Task(f"{_FOREIGN}.roundabout_env:ConnectedLaneRoundaboutEnv"),
        "intersection": Task(f"{_FOREIGN}.intersection_env:ConnectedLaneIntersectionEnv"),
        "racetrack": Task(f"{_FOREIGN}.racetrack_env:ConnectedLaneRacetrackEnv", limit_s=300.0),
        "two-way": Task(f"{_FOREIGN}.two_way_env:TwoWayEnv", limit_s=15.0),
        "parking-lot": Task(
            f"{_FOREIGN}.parking_env:ParkingEnv", {"vehicles_count": 10}, limit_s=100.0
        ),
    }
)
"""Scenarios in which an agent can drive; the others are only played. Classes are those of the
newest versions of highway-env's ids: in older ones vehicles do not see those on the next piece of a
lane."""


class ScenarioEnv(gym.Env[Observation, Any]):
    """A scenario observed through the sensors of a rig.

    scenario: a name of `scenarios.SCENARIOS`.
    ego: `agent`: the action drives the ego. Action space, reward and termination are those of
        highway-env's own environment. `idm`: a recorded scenario is played whose ego drives
        itself, and the only action is to continue. None: `agent` if the scenario has a task.
    rig, style, weather, light, faults, records, pixel_truth: as in `SensorWrapper`.
    vehicles: number of other vehicles on an agent's motorway; None for that of `config`, else 50.
    config: settings of highway-env that an agent's environment should have.
    duration_s: the episode is truncated after this time at the latest.
    step_s: time from step to step of a played scenario; None for the period of the LiDAR.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        scenario: str,
        *,
        ego: str | None = None,
        rig: str | Rig = "vlp16",
        style: str | None = None,
        weather: str | Weather = "clear",
        light: str | Light | None = None,
        faults: Faults = (),
        records: bool = True,
        pixel_truth: bool = False,
        vehicles: int | None = None,
        config: Mapping[str, Any] | None = None,
        duration_s: float | None = None,
        step_s: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        driver = _driver(scenario, ego)
        _check_vehicles(vehicles, scenario, driver)
        _check_render_mode(render_mode, self.metadata["render_modes"])
        sensing: dict[str, Any] = {
            "style": style,
            "weather": weather,
            "light": light,
            "faults": faults,
            "records": records,
            "pixel_truth": pixel_truth,
        }
        if duration_s is not None and not duration_s > 0:
            raise ValueError(f"duration_s: expected a positive number of seconds, got {duration_s}")
        if driver == "agent":
            if step_s is not None:
                raise ValueError("step_s: only with ego='idm'; set config['policy_frequency']")
            task = TASKS[scenario]
            self._limit_s = task.limit_s if duration_s is None else duration_s
            settings = dict(config or {})
            if vehicles is not None and settings.setdefault("vehicles_count", vehicles) != vehicles:
                raise ValueError("vehicles and config['vehicles_count'] differ: leave one out")
            traffic = _traffic(task, settings, render_mode)
            inner: gym.Env[Observation, Any] = self._with_sensors(traffic, rig, **sensing)
        else:
            if config is not None:
                raise ValueError("config: only with ego='agent'; a played scenario has none")
            self._limit_s = np.inf
            inner = PlaybackEnv(
                scenario,
                rig,
                duration_s=duration_s,
                step_s=step_s,
                render_mode=render_mode,
                **sensing,
            )
        self._inner = inner
        self.render_mode = render_mode
        self.observation_space = inner.observation_space
        self.action_space = inner.action_space
        self.metadata = dict(inner.metadata)

    def _with_sensors(
        self, traffic: gym.Env[Any, Any], rig: str | Rig, **sensing: Any
    ) -> gym.Env[Observation, Any]:
        """Return the traffic that an agent drives in, with sensors."""
        observe_nothing(traffic)
        return SensorWrapper(traffic, rig, **sensing)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; `options` may have `config`, which changes settings of highway-env."""
        _check_options(options or {})
        super().reset(seed=seed, options=options)
        observation, info = self._inner.reset(seed=seed, options=options)
        for name in ACTION_INFO:
            info.pop(name, None)
        return observation, info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive or play on for one step and sense whatever the sensors complete meanwhile."""
        observation, reward, terminated, truncated, info = self._inner.step(action)
        overdue = info["time_s"] >= self._limit_s - 1e-9
        return observation, float(reward), terminated, truncated or overdue, info

    def render(self) -> Any:
        """Return one picture of the latest scan and image, (720, 1280, 3) uint8.

        Without sensors, as with `perception="truth"`, the picture is highway-env's. Without a
        render mode it warns and returns None.
        """
        if self.render_mode is None:
            warn_without_render_mode()
            return None
        image: Any = self._inner.render()
        return image

    def close(self) -> None:
        """Release the traffic; closing again is fine."""
        self._inner.close()


def _driver(scenario: str, ego: str | None) -> str:
    """Return who drives; raise `ValueError` for unknown names and agents without a task."""
    find(scenario)
    if ego is None:
        return "agent" if scenario in TASKS else "idm"
    if ego not in EGOS:
        raise ValueError(f"no ego '{ego}'; known: {', '.join(EGOS)}")
    if ego == "agent" and scenario not in TASKS:
        raise ValueError(f"'{scenario}' is only played, its ego drives itself: ego='idm'")
    return ego


def _check_options(options: Mapping[str, Any]) -> None:
    """Raise `ValueError` for options of a reset that would change the spaces."""
    if of_spaces := {"observation", "action"} & set(options.get("config") or {}):
        raise ValueError(
            f"options['config']: {', '.join(sorted(of_spaces))} decides a space of the "
            "environment, which stays; give it to gym.make, config="
        )


def _check_vehicles(vehicles: int | None, scenario: str, driver: str) -> None:
    """Raise an error unless a number of vehicles can be chosen."""
    if vehicles is None:
        return
    if driver != "agent" or not TASKS[scenario].counted:
        names = ", ".join(f"'{name}'" for name, task in TASKS.items() if task.counted)
        raise ValueError(f"vehicles: only with ego='agent', in {names}")
    if isinstance(vehicles, bool) or not isinstance(vehicles, (int, np.integer)) or vehicles < 0:
        raise ValueError(f"vehicles: expected a whole number from 0 up, got {vehicles!r}")


def _check_render_mode(mode: str | None, modes: Sequence[str]) -> None:
    if mode is not None and mode not in modes:
        listed = ", ".join(f"'{name}'" for name in modes)
        raise ValueError(
            f"no render mode {mode!r}; known: {listed}, or None. "
            "gym.make makes 'human' and 'rgb_array_list' of 'rgb_array'"
        )


def _traffic(task: Task, config: Mapping[str, Any], render_mode: str | None) -> gym.Env[Any, Any]:
    """Make the environment of highway-env that an agent drives in."""
    make: Any = load_env_creator(task.env)
    settings = {**task.config, **config}
    with original_constants({}):
        traffic: gym.Env[Any, Any] = make(config=settings, render_mode=render_mode)
    return traffic


def observe_nothing(traffic: gym.Env[Any, Any]) -> None:
    """Let an environment of highway-env make empty observations from its next reset on."""
    config: dict[str, Any] = traffic.unwrapped.config  # type: ignore[attr-defined]
    config["observation"] = {"type": "AttributesObservation", "attributes": []}


class MotorwayEnv(HighwayEnv):  # type: ignore[misc]
    """`HighwayEnv` with its actions, rewards and traffic, stepped by kernels.

    With other drivers than highway-env's `IDMVehicle`, and with connected lanes or trajectories to
    show, its objects are stepped instead.
    """

    def _reset(self) -> None:
        super()._reset()
        if not self.config["neighbour_vehicles_connected_lanes"]:
            AgentRoad.adopt(self.road, self.vehicle)
