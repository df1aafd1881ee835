"""Observations and infos of `reset` and `step`, made from a growing timeline."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from gymnasium import logger

from roadscope.core import Frame, Tracks, Truth
from roadscope.envs.gym.spaces import LaneLocator, ego_state, imu_block, imu_samples, range_image
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as find_rig
from roadscope.envs.sensors.sensing import Sensing, check_light
from roadscope.envs.sensors.weathers import CLEAR, Weather
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.style import find_style

FIRST_SWEEP = 1_000_000
"""Number of the sweep before an episode, so that no sweep of the episode has the same noise."""

ObservationAndInfo = tuple[dict[str, Any], dict[str, Any]]
"""What `reset` and `step` return of an observer."""


def rig_of(rig: object) -> Rig:
    """Return a rig by name, or the rig itself; raise `TypeError` for anything else."""
    if isinstance(rig, Rig):
        return rig
    if isinstance(rig, str):
        return find_rig(rig)
    raise TypeError(
        "rig: expected the name of a preset, the path of a TOML file or a Rig, "
        f"got {type(rig).__name__} {rig!r}"
    )


def checked_seed(seed: object) -> int | None:
    """Return a seed that every generator accepts; raise an error for any other."""
    if seed is None:
        return None
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)):
        raise TypeError(f"seed: expected a whole number or None, got {seed!r}")
    if seed < 0:
        raise ValueError(f"seed: expected a whole number from 0 up, got {seed}")
    return int(seed)


class _Moment(NamedTuple):
    """What a composed frame shows of one scan.

    stamp_s: of the scan. x, y: of the ego, metres, world frame. returns: their number in the scan.
    users: number of road users with returns.
    """

    stamp_s: float
    x: float
    y: float
    returns: int
    users: int

    @staticmethod
    def of(frame: Frame, truth: Truth) -> _Moment:
        x, y, _ = truth.world_from_ego.translation
        returns = 0 if frame.lidar is None else len(frame.lidar)
        return _Moment(
            truth.stamp_s, float(x), float(y), returns, int((truth.lidar_returns > 0).sum())
        )


class Observer:
    """Senses one episode after the other and makes observations for an agent.

    It has its own random numbers: an episode with a seed is sensed with that seed, so it equals
    the recorded one; an episode without a seed takes the next of a sequence from the last seed.
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
        self._image: tuple[Frame, Truth] | None = None
        self._pixels: np.ndarray | None = None
        self._history: list[_Moment] = []
        self._imu_block = np.zeros((imu_samples(rig), 6), np.float32)
        if style is not None:
            find_style(style)
        self._records = records
        self._seeds = np.random.SeedSequence(seed)
        self._sensing = Sensing(
            rig, 0, style, weather=weather, light=light, faults=faults, pixel_truth=pixel_truth
        )
        check_light(light, rig)

    def next_seed(self, seed: int | None) -> int:
        """Return the seed of the next episode: the argument, or the next of the sequence."""
        if seed is not None:
            self._seeds = np.random.SeedSequence(seed)
            return seed
        return int(self._seeds.spawn(1)[0].generate_state(1, np.uint64)[0])

    def reset(self, timeline: Timeline, now_s: float, seed: int) -> ObservationAndInfo:
        """Begin an episode; return observation and info.

        The first observation is the sweep that ends now, with constant velocities before the
        episode. It belongs to no frame of the episode.
        """
        self._sensing.reset(seed)
        self._start_s = now_s
        self._lanes = LaneLocator(timeline.road)
        self.latest, self._pixels = self._sense_first_sweep(timeline, now_s), None
        self._history = [_Moment.of(*self.latest)]
        # Before the first sweep is complete, there are no inertial samples.
        self._imu_block = np.zeros_like(self._imu_block)
        mount = self.rig.camera
        if mount is not None:
            stamp_s = now_s - mount.spec.exposure_s / 2
            self._image = self._sensing.sense_image_at(timeline, stamp_s)
            image = self._image[0].camera
            # If a fault drops this image, a dark one is observed until the next.
            dark = (mount.spec.pinhole.height, mount.spec.pinhole.width, 3)
            self._pixels = np.zeros(dark, np.uint8) if image is None else image.pixels
        return self._observation_and_info([], timeline, now_s)

    def advance(self, timeline: Timeline, until_s: float) -> ObservationAndInfo:
        """Sense up to an instant; return observation and info of all frames completed by then."""
        pairs = self._sensing.advance(timeline, until_s, newest=not self._records)
        for frame, truth in pairs:
            if frame.lidar is not None:
                self.latest = frame, truth
                self._history.append(_Moment.of(frame, truth))
            if frame.camera is not None:
                self._pixels, self._image = frame.camera.pixels, (frame, truth)
            if frame.imu is not None:
                self._imu_block = imu_block(self._imu_block, frame.imu)
        return self._observation_and_info(pairs, timeline, until_s)

    def render(self, timeline: Timeline, tracks: Tracks | None = None) -> np.ndarray:
        """Return a composed frame of the latest scan and image, (720, 1280, 3) uint8.

        tracks: frame `world`; they are drawn where they are at the stamp of the scan.
        """
        from roadscope.envs.drawing.composed import Snapshot, composed_frame
        from roadscope.envs.drawing.panels import RunningScore

        assert self.latest is not None
        frame, truth = self.latest
        image, image_truth = self._image or (None, None)
        history = np.array(self._history)
        names = ("speed (m/s)", "returns", "road users hit")
        stamps_s, places = history[:, 0], history[:, 1:3]
        steps_m = np.linalg.norm(np.diff(places, axis=0, prepend=np.nan), axis=1)
        columns = (steps_m / np.diff(stamps_s, prepend=np.nan), *history[:, 3:].T)
        shown = Snapshot(
            frame,
            truth,
            timeline,
            self.rig,
            title=f"rig {self.rig.name}",
            scores=tuple(
                RunningScore(name, values, decimals=int(k == 0))
                for k, (name, values) in enumerate(zip(names, columns, strict=True))
            ),
            image=image,
            image_truth=image_truth,
            tracks=None if tracks is None else _moved_to(tracks, truth.stamp_s),
            path=places,
        )
        return composed_frame(shown)

    def _sense_first_sweep(self, timeline: Timeline, now_s: float) -> tuple[Frame, Truth]:
        """Return the sweep that ends now; its world is used in the whole episode."""
        mount = self.rig.lidar
        first_stamp_s = now_s - mount.spec.sweep_s / 2 - FIRST_SWEEP * mount.spec.period_s
        self._sensing.rig = replace(
            self.rig, lidar=replace(mount, first_stamp_s=first_stamp_s), imu=None, wheels=None
        )
        try:
            return self._sensing.sense(timeline, FIRST_SWEEP)
        finally:
            self._sensing.rig = self.rig

    def _observation_and_info(
        self, pairs: list[tuple[Frame, Truth]], timeline: Timeline, now_s: float
    ) -> ObservationAndInfo:
        assert self.latest is not None
        frame, truth = self.latest
        observation = range_image(frame.lidar, self.rig.lidar.spec)
        if self._pixels is not None:
            observation["image"] = self._pixels.copy()
        if self.rig.imu is not None:
            observation["imu"] = self._imu_block.copy()
        observation["ego"] = ego_state(timeline, now_s, self._lanes)
        info: dict[str, Any] = {"time_s": now_s - self._start_s, "truth": truth}
        if self._sensing.pixel_truth and self._image is not None:
            info["pixel_truth"] = self._image[1].pixels
        if self._records:
            info["frames"] = tuple(frame for frame, _ in pairs)
            info["truths"] = tuple(truth for _, truth in pairs)
        return observation, info


def _moved_to(tracks: Tracks, stamp_s: float) -> Tracks:
    """Return tracks at another instant, moved at constant velocity."""
    centres = tracks.centres.copy()
    centres[:, :2] += (stamp_s - tracks.stamp_s) * tracks.velocities
    return replace(tracks, centres=centres, stamp_s=stamp_s)


def warn_without_render_mode() -> None:
    """Warn, as Gymnasium's own environments do, that nothing is rendered without a render mode."""
    logger.warn(
        "render() without a render mode renders nothing; give one to gymnasium.make or to the "
        'environment: render_mode="rgb_array"'
    )
