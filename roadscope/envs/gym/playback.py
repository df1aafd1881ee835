"""An environment that plays a recorded scenario; the ego drives itself."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from roadscope.envs.gym.observer import Observer, rig_of, warn_without_render_mode
from roadscope.envs.gym.spaces import Observation, checked_action, observation_space
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weathers import Weather
from roadscope.envs.traffic.scenarios import find, record
from roadscope.envs.traffic.timeline import Timeline


class PlaybackEnv(gym.Env[Observation, np.int64]):
    """Plays a scenario and senses it; the ego drives itself, so the only action is to continue.

    scenario, duration_s: as in `scenarios.record`. `reset(seed=s)` plays the recording of seed
        s; its data are byte for byte those of `sensing.sense`. A reset without a seed draws one.
    rig, style, weather, light, faults, records, pixel_truth: as in `SensorWrapper`.
    step_s: time from step to step; None for the period of the LiDAR.

    The reward is 0, and an episode is truncated where the recording ends.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        scenario: str,
        rig: str | Rig = "vlp16",
        *,
        duration_s: float | None = None,
        step_s: float | None = None,
        style: str | None = None,
        weather: str | Weather = "clear",
        light: str | Light | None = None,
        faults: Faults = (),
        records: bool = True,
        pixel_truth: bool = False,
        render_mode: str | None = None,
    ) -> None:
        chosen = _with_frame_stamps(rig_of(rig), scenario)
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(1)
        self._observer = Observer(
            chosen,
            style=style,
            weather=weather,
            light=light,
            faults=faults,
            records=records,
            pixel_truth=pixel_truth,
        )
        self.observation_space = observation_space(chosen)
        self._scenario = scenario
        self._duration_s = duration_s
        self._step_s = chosen.lidar.spec.period_s if step_s is None else step_s
        if not 0 < self._step_s < np.inf:
            raise ValueError(f"step_s: expected a positive number of seconds, got {step_s}")
        self.metadata = {**self.metadata, "render_fps": 1 / self._step_s}
        self._timeline: Timeline | None = None
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a recording."""
        super().reset(seed=seed, options=options)
        episode = self._observer.next_seed(seed)
        self._timeline = _recorded(self._scenario, episode, self._duration_s)
        # Scripts begin a little before 0, so that all actors move in the first sweep.
        self._start_s = max(self._timeline.start_s, 0.0)
        self._steps = 0
        return self._observer.reset(self._timeline, self._start_s, episode)

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Play on for `step_s`."""
        if self._timeline is None:
            raise gym.error.ResetNeeded("step() before reset(): there is no episode yet")
        checked_action(self.action_space, action)
        self._steps += 1
        end_s = self._timeline.end_s
        now_s = min(self._start_s + self._steps * self._step_s, end_s)
        observation, info = self._observer.advance(self._timeline, now_s)
        # The end of a recording differs from its nominal length by a rounding error.
        return observation, 0.0, False, now_s >= end_s - 1e-9, info

    def render(self) -> Any:
        """Return one picture of the latest scan and image, (720, 1280, 3) uint8.

        Without a render mode it warns and returns None.
        """
        if self.render_mode is None:
            warn_without_render_mode()
            return None
        if self._timeline is None:
            return None
        return self._observer.render(self._timeline)


def _with_frame_stamps(rig: Rig, scenario: str) -> Rig:
    """Return the rig with sweeps at the numbered frames of a scripted scenario, from 1 on."""
    if not find(scenario).scripted or rig.lidar.first_stamp_s is not None:
        return rig
    return replace(rig, lidar=replace(rig.lidar, first_stamp_s=rig.lidar.spec.period_s))


@lru_cache(maxsize=8)
def _recorded(scenario: str, seed: int, duration_s: float | None) -> Timeline:
    """Return a recording; the last few are cached, so that a replay costs nothing."""
    return record(scenario, seed, duration_s)
