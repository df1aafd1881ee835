"""The scans of an episode as an odometry gets them, with the true poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import singledispatch
from typing import TypeVar

import numpy as np

from roadscope.benchmarks.episode import Episode, sensed, sensing_of
from roadscope.core import ImuSamples, LidarScan, Pose, Truth, WheelSamples
from roadscope.core.record import Record

MOVING_M_S = 0.1
"""Slower road users count as standing: from scan to scan they move less than the range noise."""

Samples = TypeVar("Samples", ImuSamples, WheelSamples)


@dataclass(frozen=True, slots=True, eq=False)
class Step(Record):
    """One scan of a drive.

    imu, wheels: samples since the last scan that arrived; None for a rig without that sensor.
    world_from_lidar: the true pose at the stamp.
    moving: (N,) bool, which returns truly came from road users that move over the ground.
    """

    scan: LidarScan
    imu: ImuSamples | None
    wheels: WheelSamples | None
    world_from_lidar: Pose
    moving: np.ndarray

    def without_moving(self) -> Step:
        """Return the step without the returns of moving road users."""
        return replace(self, scan=self.scan.select(~self.moving), moving=self.moving[~self.moving])


def imu_mounting(episode: Episode) -> Pose | None:
    """Return `lidar_from_imu` as the user believes it to be; None without an IMU."""
    if not episode.simulated:
        return None
    sensing = sensing_of(episode)
    imu = sensing.rig.imu
    if imu is None:
        return None
    believed = sensing.calibration
    return believed.pose(sensing.rig.lidar.name).inverse() @ believed.pose(imu.name)


@singledispatch
def drive(episode: Episode) -> Iterator[Step]:
    """Yield the scans of an episode that arrive, the same bytes every time, in fresh arrays.

    A scan also brings the samples of lost scans before it.
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


def _joined(blocks: Sequence[Samples | None]) -> Samples | None:
    """Return the samples of several scans as one block; None where there are none."""
    present = [block for block in blocks if block is not None]
    if not present:
        return None
    kind = type(present[0])
    names = [each.name for each in fields(kind)]
    return kind(*(np.concatenate([getattr(block, name) for block in present]) for name in names))
