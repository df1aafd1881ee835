"""From a growing timeline to what `reset` and `step` return."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from roadscope.core import Frame, Truth
from roadscope.envs.gym.spaces import Lanes, ego_state, imu_block, imu_samples, range_image
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as find_rig
from roadscope.envs.sensors.sensing import Sensing, check_light
from roadscope.envs.sensors.weather import CLEAR, Weather
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.style import style_named

LOOK = 1_000_000
"""Number of the sweep before an episode: its noise is that of no sweep which the episode has."""

Report = tuple[dict[str, Any], dict[str, Any]]


def rig_of(given: object) -> Rig:
    """Return the rig that a caller named or gave; anything else is a `TypeError`."""
    if isinstance(given, Rig):
        return given
    if isinstance(given, str):
        return find_rig(given)
    raise TypeError(
        "rig: expected the name of a preset, the path of a TOML file or a Rig, "
        f"got {type(given).__name__} {given!r}"
    )


def checked_seed(given: object) -> int | None:
    """Return a seed that every generator takes; refuse others before an episode depends on it."""
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, (int, np.integer)):
        raise TypeError(f"seed: expected a whole number or None, got {given!r}")
    if given < 0:
        raise ValueError(f"seed: expected a whole number from 0 up, got {given}")
    return int(given)


class Observer:
    """Senses one episode after the other and lays the latest scan out for an agent.

    Its randomness is its own: an episode with a seed is sensed with that seed, so it equals the
    recorded one, and an episode without takes the next of a sequence that the last seed began.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        seed: int | None = None,
        style: str | None = None,
        weather: str | Weather = CLEAR,
        light: str | Light | None = None,
        faults: Faults = (),
        records: bool = True,
        pixel_truth: bool = False,
    ) -> None:
        self.rig = rig
        self.latest: tuple[Frame, Truth] | None = None
        self._pixels: np.ndarray | None = None
        self._shown: Truth | None = None
        self._felt = np.zeros((imu_samples(rig), 6), np.float32)
        if style is not None:
            style_named(style)
        self._records = records
        self._seeds = np.random.SeedSequence(seed)
        self._sensing = Sensing(
            rig, 0, style, weather=weather, light=light, faults=faults, pixel_truth=pixel_truth
        )
        check_light(light, rig)

    def next_seed(self, seed: int | None) -> int:
        """Return the seed of the next episode, the given one if there is one."""
        if seed is not None:
            self._seeds = np.random.SeedSequence(seed)
            return seed
        return int(self._seeds.spawn(1)[0].generate_state(1, np.uint64)[0])

    def reset(self, timeline: Timeline, now_s: float, seed: int) -> Report:
        """Begin an episode; return observation and info.

        The first observation is a look around: the sweep that ends now, of a world that came
        here at constant velocity. It belongs to no frame of the episode.
        """
        self._sensing.reset(seed)
        self._start_s = now_s
        self._lanes = Lanes(timeline.road)
        self.latest, self._pixels = self._look(timeline, now_s), None
        # Before the first sweep is complete, nothing has been felt.
        self._felt = np.zeros_like(self._felt)
        mount = self.rig.camera
        if mount is not None:
            stamp_s = now_s - mount.spec.exposure_s / 2
            frame, self._shown = self._sensing.sense_image_at(timeline, stamp_s)
            image = frame.camera
            # Before the first image that arrives, a dark one is observed.
            dark = (mount.spec.pinhole.height, mount.spec.pinhole.width, 3)
            self._pixels = np.zeros(dark, np.uint8) if image is None else image.pixels
        return self._report([], timeline, now_s)

    def advance(self, timeline: Timeline, until_s: float) -> Report:
        """Sense on to an instant; return observation and info of what was completed by then."""
        pairs = self._sensing.advance(timeline, until_s)
        for frame, truth in pairs:
            if frame.lidar is not None:
                self.latest = frame, truth
            if frame.camera is not None:
                self._pixels, self._shown = frame.camera.pixels, truth
            if frame.imu is not None:
                self._felt = imu_block(self._felt, frame.imu)
        return self._report(pairs, timeline, until_s)

    def render(self, timeline: Timeline) -> np.ndarray:
        """Return a bird's-eye view of the latest scan, (H, W, 3) uint8."""
        from roadscope.envs.gym.render import birds_eye

        assert self.latest is not None
        frame, truth = self.latest
        return birds_eye(frame, truth, timeline)

    def _look(self, timeline: Timeline, now_s: float) -> tuple[Frame, Truth]:
        """Sense the sweep that ends now; the world that it makes serves the whole episode."""
        mount = self.rig.lidar
        first_stamp_s = now_s - mount.spec.sweep_s / 2 - LOOK * mount.spec.period_s
        self._sensing.rig = replace(
            self.rig, lidar=replace(mount, first_stamp_s=first_stamp_s), imu=None, wheels=None
        )
        try:
            return self._sensing.sense(timeline, LOOK)
        finally:
            self._sensing.rig = self.rig

    def _report(self, pairs: list[tuple[Frame, Truth]], timeline: Timeline, now_s: float) -> Report:
        assert self.latest is not None
        frame, truth = self.latest
        observation = range_image(frame.lidar, self.rig.lidar.spec)
        if self._pixels is not None:
            observation["image"] = self._pixels.copy()
        if self.rig.imu is not None:
            observation["imu"] = self._felt.copy()
        observation["ego"] = ego_state(timeline, now_s, self._lanes)
        info: dict[str, Any] = {"time_s": now_s - self._start_s, "truth": truth}
        if self._sensing.pixel_truth and self._shown is not None:
            info["pixel_truth"] = self._shown.pixels
        if self._records:
            info["frames"] = tuple(frame for frame, _ in pairs)
            info["truths"] = tuple(truth for _, truth in pairs)
        return observation, info
