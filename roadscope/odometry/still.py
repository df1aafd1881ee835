"""The odometry that does not believe in motion."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.clock import Clock
from roadscope.odometry.estimates import estimate


class StillOdometry:
    """Stays where it is: the lowest mark, and what a jammed odometry looks like."""

    takes_imu: ClassVar = False

    def __init__(self) -> None:
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget the last stamp; the mounting does not matter."""
        self._clock = Clock()

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Return the start, whatever the scan shows."""
        tick = self._clock.tick(scan.stamp_s)
        return estimate(np.eye(4), np.zeros((6, 6)), scan.stamp_s, len(scan), tick.reason)
