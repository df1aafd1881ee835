"""Protocol of odometries.

The LiDAR's x axis points ahead, z up; `MountedOdometry` is for other mountings.

Frames: an estimated pose is that of the LiDAR at the stamp of the scan, in the LiDAR's frame at the
first scan after the reset. The pose of the IMU is an argument of the reset, since scans do not
contain it.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose, WheelSamples


@runtime_checkable
class Odometry(Protocol):
    """Estimates the motion of a LiDAR from scans, and from inertial samples if there are any.

    Constructor arguments are keyword-only and all have defaults. Poses are finite for any input;
    an unreliable pose has the status degraded and a reason.
    """

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear all state; the next scan is the new start.

        lidar_from_imu: pose of the IMU; None: its frame is that of the LiDAR.
        """

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Process a scan and return its pose.

        imu: the samples since the last call, in order of time, if possible up to the end of the
            sweep; None without an IMU. An odometry that does not use them may have a class
            attribute `takes_imu = False`, so that users are informed.
        """


@runtime_checkable
class WheeledOdometry(Odometry, Protocol):
    """An odometry that also uses wheel speeds, if there are any."""

    def add_wheels(self, wheels: WheelSamples) -> None:
        """Add the samples since the last scan, in order of time; `update` follows.

        Not called without wheel speeds. The LiDAR's x axis points ahead.
        """


def takes_wheels(odometry: Odometry) -> bool:
    """Return whether an odometry uses wheel speeds; its attribute `wheels` can be False."""
    return isinstance(odometry, WheeledOdometry) and getattr(odometry, "wheels", True) is not False


def takes_imu(odometry: Odometry) -> bool:
    """Return whether an odometry uses inertial samples; one with `takes_imu` False does not."""
    return getattr(odometry, "takes_imu", True) is not False


def update_with_wheels(
    odometry: Odometry, scan: LidarScan, imu: ImuSamples | None, wheels: WheelSamples | None
) -> OdometryEstimate:
    """Return the estimate for a scan; wheel speeds are added first if the odometry uses them."""
    if wheels is not None and isinstance(odometry, WheeledOdometry):
        odometry.add_wheels(wheels)
    return odometry.update(scan, imu)
