"""What an odometry is.

Frames: the pose it tells is the LiDAR's, at the stamp of the scan, in the LiDAR's frame of the
first scan after the reset. How the IMU is mounted is told with the reset, for a scan does not
say it.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose, WheelSamples


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
            best; None without an IMU. Who has no use for them may say so by a class attribute
            `takes_imu = False`, so that users are told.
        """


@runtime_checkable
class WheeledOdometry(Odometry, Protocol):
    """An odometry that takes wheel speeds too, where a vehicle tells them."""

    def add_wheels(self, wheels: WheelSamples) -> None:
        """Take the samples since the last scan, in order of time; `update` follows.

        Not called without wheels. The vehicle's length is the LiDAR's x axis.
        """


def takes_wheels(odometry: Odometry) -> bool:
    """Say whether an odometry lets wheel speeds in; one that has `wheels` False does not."""
    return isinstance(odometry, WheeledOdometry) and getattr(odometry, "wheels", True) is not False


def takes_imu(odometry: Odometry) -> bool:
    """Say whether an odometry has use for inertial samples: unless it says that it has none."""
    return getattr(odometry, "takes_imu", True) is not False


def asked(
    odometry: Odometry, scan: LidarScan, imu: ImuSamples | None, wheels: WheelSamples | None
) -> OdometryEstimate:
    """Tell an odometry of a scan, and of wheels if it takes their speed."""
    if wheels is not None and isinstance(odometry, WheeledOdometry):
        odometry.add_wheels(wheels)
    return odometry.update(scan, imu)
