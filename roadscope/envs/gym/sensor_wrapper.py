"""Sensors around any single-agent environment of highway-env."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from roadscope.core import Pose, Tracks
from roadscope.envs.gym.observer import Observer, checked_seed, rig_of, warn_without_render_mode
from roadscope.envs.gym.spaces import Observation, checked_action, goal_state, observation_space
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.ego_motion import RAW_S, STATES_AROUND
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weathers import Weather
from roadscope.envs.traffic.conversion import (
    Constants,
    ForeignEnvError,
    original_constants,
    own_constants,
    refuse_multi_agent,
    to_world,
)
from roadscope.envs.traffic.recorder import TrafficRecorder
from roadscope.envs.traffic.timeline import Timeline

STYLES_OF = {
    "HighwayEnv": "motorway",
    "ExitEnv": "motorway",
    "MergeEnv": "motorway",
    "MergeGenericEnv": "motorway",
    "IntersectionEnv": "urban",
    "RoundaboutEnv": "urban",
    "RoundaboutGenericEnv": "urban",
    "UTurnEnv": "urban",
    "TwoWayEnv": "urban",
    "LaneKeepingEnv": "campus",
    "RacetrackEnv": "campus",
    "ParkingEnv": "bare",
}
"""Roadside of each family of environments, by class name."""


class SensorWrapper(gym.Wrapper[Observation, Any, Any, Any], RecordConstructorArgs):
    """Adds the sensors of a rig to a highway-env environment.

    rig: name of a preset (`roadscope list rigs`), path of a TOML file, or a `Rig`.
    seed: of the sensors if the first `reset` has none; a seed of `reset` takes precedence.
    style: roadside, a name of `roadside.STYLES`; None for the usual one of the environment.
    weather: name of a preset (`roadscope list weathers`) or a `Weather`.
    light: name of a preset (`roadscope list lights`) or a `Light`, for the camera; None draws a
        daylight. Without a camera only None and `day` are accepted.
    faults: such as `fog:3` or a list of them (`roadscope list faults`), which also has weather.
    records: whether `info` contains every frame and its truth; training is faster without them.
    pixel_truth: whether `info["pixel_truth"]` contains depth, instance and category of every pixel
        of the observed image (`PixelTruth`), and each truth of an image those of that image.

    The observation is a dictionary of the latest complete scan and the own state: see
    `spaces.observation_space`. `info["frames"]` holds each `Frame` completed since the last call
    and `info["truths"]` its `Truth`; `info["truth"]` is that of the observation. The traffic is
    the same, to the bit, as without the wrapper. Only single-agent highway-env
    environments without sensors are accepted.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        rig: str | Rig = "vlp16",
        *,
        seed: int | None = None,
        style: str | None = None,
        weather: str | Weather = "clear",
        light: str | Light | None = None,
        faults: Faults = (),
        records: bool = True,
        pixel_truth: bool = False,
    ) -> None:
        RecordConstructorArgs.__init__(
            self,
            rig=rig,
            seed=seed,
            style=style,
            weather=weather,
            light=light,
            faults=faults,
            records=records,
            pixel_truth=pixel_truth,
        )
        gym.Wrapper.__init__(self, env)
        refuse_sensors(env)
        refuse_multi_agent(env)
        chosen = rig_of(rig)
        suited = suited_style(env.unwrapped) if style is None else style
        self._observer = Observer(
            chosen,
            seed=checked_seed(seed),
            style=suited,
            weather=weather,
            light=light,
            faults=faults,
            records=records,
            pixel_truth=pixel_truth,
        )
        self._recorder = TrafficRecorder()
        self._constants: Constants = {}
        self._period_s = chosen.lidar.spec.period_s
        self._history_s = 0.0
        self.observation_space = observation_space(chosen, goal=_goal(env.unwrapped) is not None)
        rate = env.unwrapped.config["policy_frequency"]  # type: ignore[attr-defined]
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": rate}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode of traffic, and sense it from here on."""
        with original_constants(self._constants):
            _, info = self.env.reset(seed=seed, options=options)
        rig = self._observer.rig
        self._history_s = rig.memory_s
        if rig.inertial:
            # A reset may change the settings of the environment.
            frequency = self.env.unwrapped.config["simulation_frequency"]  # type: ignore[attr-defined]
            self._history_s += STATES_AROUND / frequency + 2 * RAW_S
        episode = self._observer.next_seed(seed)
        self._recorder = TrafficRecorder(seed=episode)
        self._recorder.attach(self.env.unwrapped)
        timeline = self._recorder.timeline()
        observation, sensed = self._observer.reset(timeline, timeline.end_s, episode)
        return self._with_goal(observation), {**info, **sensed}

    def step(self, action: Any) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Drive for one policy step and sense whatever the sensors complete meanwhile."""
        self._require_reset("step()")
        action = checked_action(self.action_space, action)
        before_s = self._recorder.stamp_s
        with own_constants(self._constants):
            _, reward, terminated, truncated, info = self.env.step(action)
        if self._recorder.road is not self.env.unwrapped.road:  # type: ignore[attr-defined]
            raise ForeignEnvError(
                "the environment below SensorWrapper began another episode, which the sensors do "
                "not follow: only call reset() of the outermost wrapper, and put wrappers such as "
                "Autoreset around SensorWrapper"
            )
        now_s = self._recorder.stamp_s
        # The oldest sweep that is still open began less than two periods before the step, or before
        # the instant until which the ego's motion was settled then.
        timeline = self._recorder.timeline(now_s - before_s + 2 * self._period_s + self._history_s)
        observation, sensed = self._observer.advance(timeline, now_s)
        observation = self._with_goal(observation)
        return observation, reward, bool(terminated), bool(truncated), {**info, **sensed}

    def render(self) -> Any:
        """Return one picture of the latest scan and image, (720, 1280, 3) uint8.

        Only for `render_mode="rgb_array"`; other modes render the environment itself. Without a
        render mode it warns and returns None.
        """
        if self.render_mode is None:
            warn_without_render_mode()
            return None
        return self.env.render() if self.render_mode != "rgb_array" else self.draw()

    def draw(self, tracks: Tracks | None = None) -> np.ndarray:
        """Return the picture of `render`, whatever the mode. tracks: shown too, frame `world`."""
        self._require_reset("render()")
        return self._observer.render(self._recorder.timeline(2 * self._period_s), tracks)

    def recording(self) -> Timeline:
        """Return the traffic of the episode so far."""
        self._require_reset("recording()")
        return self._recorder.timeline()

    def _require_reset(self, call: str) -> None:
        if self._observer.latest is None:
            raise gym.error.ResetNeeded(f"{call} before reset(): there is no episode yet")

    def _with_goal(self, observation: Observation) -> Observation:
        goal = _goal(self.env.unwrapped)
        if goal is not None:
            timeline = self._recorder.timeline(0.0)
            ego = timeline.world_from_ego(timeline.end_s)
            observation["goal"] = goal_state(ego, goal)
        return observation


def suited_style(env: Any) -> str:
    """Return the usual roadside of an environment of highway-env."""
    kinds = (kind.__name__ for kind in type(env).__mro__)
    return next((STYLES_OF[kind] for kind in kinds if kind in STYLES_OF), "bare")


def refuse_sensors(env: gym.Env[Any, Any]) -> None:
    """Raise `ForeignEnvError` if any layer of an environment already has sensors."""
    layer = env
    while not _senses(layer) and isinstance(layer, gym.Wrapper):
        layer = layer.env
    if _senses(layer):
        name = env.spec.id if env.spec is not None else type(env.unwrapped).__name__
        where = "SensorWrapper" if isinstance(layer, SensorWrapper) else "gym.make"
        raise ForeignEnvError(f"'{name}' already has sensors; choose them by the rig= of {where}")


def _senses(env: gym.Env[Any, Any]) -> bool:
    return (
        isinstance(env.observation_space, spaces.Dict)
        and "lidar_range" in env.observation_space.spaces
    )


def _goal(env: Any) -> Pose | None:
    """Return the world pose where the ego should stop, or None if the task has no goal."""
    goal = getattr(env.vehicle, "goal", None)
    if goal is None:
        return None
    position, heading, _ = to_world(np.array(goal.position), np.array(goal.heading))
    return Pose.planar(position[0], position[1], float(heading))
