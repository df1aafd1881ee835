"""What an odometry is.

Frames: the pose it tells is the LiDAR's, at the stamp of the scan, in the LiDAR's frame of the
first scan after the reset. How the IMU is mounted is told with the reset, for a scan does not
say it.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose


@runtime_checkable
class Odometry(Protocol):
    """Tells from scans, and from inertial samples where there are any, how the sensor moved.

    Constructor arguments are keyword-only and all have defaults. Whatever comes in, poses stay
    finite; what cannot be trusted is called degraded, with the reason.
    """

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget everything; the next scan is the new start.

        lidar_from_imu: how the IMU is mounted; None: its frame is the LiDAR's.
        """

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Take a scan and return where it was taken.

        imu: the samples since the last call, in order of time, up to the end of the sweep at
            best; None without an IMU.
        """
