"""What an odometry is given of an episode, and what was true meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TypeVar

import numpy as np

from roadscope.benchmarks.episode import SCAN_ARRAYS, Episode, sensing_of, timeline_of
from roadscope.benchmarks.fingerprint import fingerprint
from roadscope.core import ImuSamples, LidarScan, Pose, Truth, WheelSamples
from roadscope.core.record import Record

MOVING_M_S = 0.1
"""Slower road users stand, at that time: from scan to scan they move less than ranges err."""
KEPT_BYTES = 600_000_000
BYTES_PER_RAY = 40

Samples = TypeVar("Samples", ImuSamples, WheelSamples)


@dataclass(frozen=True, slots=True, eq=False)
class Step(Record):
    """One scan of a drive.

    imu, wheels: samples since the last scan that arrived; None without IMU, without wheels.
    world_from_lidar: the true pose at the stamp.
    moving: (N,) bool, which returns truly came from road users that move over the ground.
    """

    scan: LidarScan
    imu: ImuSamples | None
    wheels: WheelSamples | None
    world_from_lidar: Pose
    moving: np.ndarray

    def copied(self) -> Step:
        """Return a step whose measurements a plug-in may write to."""
        return replace(
            self,
            scan=select(self.scan, slice(None)),
            imu=_joined([self.imu]),
            wheels=_joined([self.wheels]),
        )

    def without_moving(self) -> Step:
        """Return the step as it is in a world in which nothing moves but the sensor."""
        return replace(self, scan=select(self.scan, ~self.moving), moving=self.moving[~self.moving])


def imu_mounting(episode: Episode) -> Pose | None:
    """Return `lidar_from_imu` as the user believes it to be; None without an IMU."""
    sensing = sensing_of(episode)
    imu = sensing.rig.imu
    if imu is None:
        return None
    known = sensing.calibration
    return known.pose(sensing.rig.lidar.name).inverse() @ known.pose(imu.name)


def drive(episode: Episode) -> Iterator[Step]:
    """Yield the scans of an episode that arrive; every time the same bytes, in arrays of one's own.

    The last episode is kept: the next job of a worker is often another entry on the same.
    """
    from roadscope.envs.sensors.rigs import rig

    timeline, spec = timeline_of(episode), rig(episode.rig).lidar.spec
    scans = (timeline.end_s - timeline.start_s) / spec.period_s
    if scans * spec.beams * spec.columns * BYTES_PER_RAY > KEPT_BYTES:
        yield from _sensed(episode)
        return
    for step in _kept(episode, fingerprint(episode.spec())):
        yield step.copied()


@lru_cache(maxsize=1)
def _kept(episode: Episode, key: str) -> tuple[Step, ...]:
    """Keep the last one; key: changes when the rig file that the episode names does."""
    return tuple(_sensed(episode))


def _sensed(episode: Episode) -> Iterator[Step]:
    from roadscope.envs.sensors.rigs import rig

    carrier = replace(rig(episode.rig), camera=None)
    mount = carrier.lidar.ego_from_lidar
    felt: list[ImuSamples | None] = []
    rolled: list[WheelSamples | None] = []
    for frame, truth in sensing_of(episode, carrier).whole(timeline_of(episode)):
        felt.append(frame.imu)
        rolled.append(frame.wheels)
        if frame.lidar is None:
            continue
        yield Step(
            frame.lidar,
            _joined(felt),
            _joined(rolled),
            truth.world_from_ego @ mount,
            moving_in(truth),
        )
        felt, rolled = [], []


def moving_in(truth: Truth) -> np.ndarray:
    """Return (P,) bool, which returns of the scan came from road users that truly move."""
    fast = np.hypot(*truth.velocities.T) > MOVING_M_S
    moving: np.ndarray = np.isin(truth.sources, truth.ids[fast])
    return moving


def select(scan: LidarScan, rows: np.ndarray | slice) -> LidarScan:
    """Return the scan with some of its returns, in arrays of its own."""
    return replace(scan, **{name: getattr(scan, name)[rows].copy() for name in SCAN_ARRAYS})


def _joined(blocks: Sequence[Samples | None]) -> Samples | None:
    """Return the samples of scans that were lost with those of the one that came."""
    there = [block for block in blocks if block is not None]
    if not there:
        return None
    kind = type(there[0])
    names = [each.name for each in fields(kind)]
    return kind(*(np.concatenate([getattr(block, name) for block in there]) for name in names))
