"""The odometry that does not believe in motion."""

from __future__ import annotations

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, OdometryStatus, Pose
from roadscope.odometry.clock import Clock


class StillOdometry:
    """Stays where it is: the lowest mark, and what a jammed odometry looks like."""

    def __init__(self) -> None:
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget the last stamp; the mounting does not matter."""
        self._clock = Clock()

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Return the start, with the certainty that it claims."""
        tick = self._clock.tick(scan.stamp_s)
        reason = tick.reason or ("" if len(scan) else "an empty scan")
        status = OdometryStatus.DEGRADED if reason else OdometryStatus.OK
        return OdometryEstimate(
            Pose.identity(), np.zeros((6, 6)), np.zeros(len(scan), bool), scan.stamp_s,
            status, reason,
        )  # fmt: skip
