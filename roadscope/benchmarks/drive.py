"""The scans of an episode as an odometry gets them, and what was true meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from roadscope.benchmarks.episode import Episode, sensed, sensing_of
from roadscope.core import ImuSamples, LidarScan, Pose, Truth, WheelSamples
from roadscope.core.record import Record

SCAN_ARRAYS = ("points", "intensity", "ring", "column", "time_offset_s")
MOVING_M_S = 0.1
"""Slower road users stand, at that time: from scan to scan they move less than ranges err."""

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

    A scan that arrives has the samples of those that were lost before it too.
    """
    from roadscope.envs.sensors.rigs import rig

    mount = rig(episode.rig).lidar.ego_from_lidar
    imu: list[ImuSamples | None] = []
    wheels: list[WheelSamples | None] = []
    for frame, truth in sensed(episode):
        imu.append(frame.imu)
        wheels.append(frame.wheels)
        if frame.lidar is None:
            continue
        pose = truth.world_from_ego @ mount
        yield Step(frame.lidar, _joined(imu), _joined(wheels), pose, moving_in(truth))
        imu, wheels = [], []


def moving_in(truth: Truth) -> np.ndarray:
    """Return (P,) bool, which returns of the scan came from road users that truly move."""
    fast = np.hypot(*truth.velocities.T) > MOVING_M_S
    moving: np.ndarray = np.isin(truth.sources, truth.ids[fast])
    return moving


def select(scan: LidarScan, rows: np.ndarray | slice) -> LidarScan:
    """Return the scan with some of its returns, in arrays of its own."""
    return replace(scan, **{name: getattr(scan, name)[rows].copy() for name in SCAN_ARRAYS})


def _joined(blocks: Sequence[Samples | None]) -> Samples | None:
    """Return the samples of several scans as one block; None where there are none."""
    known = [block for block in blocks if block is not None]
    if not known:
        return None
    kind = type(known[0])
    names = [each.name for each in fields(kind)]
    return kind(*(np.concatenate([getattr(block, name) for block in known]) for name in names))
