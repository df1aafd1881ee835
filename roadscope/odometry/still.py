"""An odometry without motion."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.clock import Clock
from roadscope.odometry.estimates import estimate


class StillOdometry:
    """Always returns the start pose: the lower mark of a leaderboard."""

    takes_imu: ClassVar = False

    def __init__(self) -> None:
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear the last stamp; the pose of the IMU is not used."""
        self._clock = Clock()

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Return the start pose for any scan."""
        tick = self._clock.tick(scan.stamp_s)
        return estimate(np.eye(4), np.zeros((6, 6)), scan.stamp_s, len(scan), tick.reason)
