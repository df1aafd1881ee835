"""Adapter of other libraries' odometries: stamps, unusable scans, frames, degraded poses."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.above_ground import standing
from roadscope.odometry.clock import Clock
from roadscope.odometry.estimates import LOST, estimate, lack_of_points, propagated_covariance
from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.peers.interface import LibraryScan, OdometryLibrary, Placed
from roadscope.odometry.rigid import exp_se3, inverse, log_se3, orthonormal
from roadscope.odometry.scatter import excessive_noise

FASTEST_M_S = 100.0
"""No vehicle is faster: the library has lost track and is restarted."""
JUMP_M_S2, JUMP_M_S = 15.0, 2.0
"""Largest acceleration of a vehicle, and the uncertainty of a speed from scans."""
STEP = np.diag([0.05] * 3 + [0.005] * 3) ** 2
"""Nominal covariance of a step, metres and radians: the libraries report none."""
CARRIED = np.diag([8.0] * 3 + [2.0] * 3) ** 2
"""Covariance of a motion predicted for a second: vehicles do not exceed these accelerations. It
grows with the fourth power of time."""


class OdometryAdapter:
    """Runs a library's odometry behind our interface.

    A library never gets a scan that is out of order or has too few points: the pose is then
    predicted at constant velocity. A library's pose may belong to the end of the sweep; it is
    moved to the stamp at the velocity between the last two scans.
    """

    takes_imu: ClassVar = False
    """Whether the library uses inertial samples."""

    def __init__(
        self, start: Callable[[Pose | None], OdometryLibrary], *, ground: bool = True
    ) -> None:
        """Store how to start the library.

        start: returns a new library odometry for the pose of the IMU. ground: whether it gets the
        ground returns, as its authors intend. On flat ground the rings move along with the sensor,
        which misleads methods without a prior. Otherwise it gets the returns of `standing` only.
        """
        self._start, self._ground = start, ground
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget everything."""
        self._mounting = lidar_from_imu
        self._clock, self._imu, self._last_imu_s = Clock(), ImuBuffer(None), -np.inf
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._twist: np.ndarray | None = None
        self._trusted: tuple[np.ndarray, float] | None = None
        self._now_s, self._placed_any = 0.0, False
        self._begin()

    def _begin(self) -> None:
        """Start the library; its second scan defines the pose of its world frame."""
        self._library = self._start(self._mounting)
        self._before: Placed | None = None
        self._last_taken_s = 0.0
        self._start_from_world: np.ndarray | None = None
        self._refused = 0

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Pass the scan to the library and return the pose of the LiDAR."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        self._now_s += tick.elapsed_s
        before = self._pose
        if self._twist is not None:
            self._pose = before @ exp_se3(self._twist * tick.elapsed_s)
        usable = np.isfinite(scan.points).all(axis=1)
        if not self._ground:
            above = np.zeros(len(usable), bool)
            above[standing(scan).rows] = True
            usable &= above
        library_scan = self._library_scan(scan, usable)
        problem = lack_of_points(int(usable.sum()), scan.ring[usable])
        problem = problem or self._placed(library_scan)
        spread = CARRIED * tick.elapsed_s**4 if problem else STEP * bool(tick.elapsed_s)
        self._covariance = propagated_covariance(
            self._covariance, inverse(before) @ self._pose, spread
        )
        missing_samples = (
            self._imu.missing_samples(scan.stamp_s, tick.elapsed_s) if self.takes_imu else ""
        )
        reason = tick.reason or problem or missing_samples or excessive_noise(scan)
        return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), reason)

    def _library_scan(self, scan: LidarScan, usable: np.ndarray) -> LibraryScan:
        new = self._imu.stamps_s > self._last_imu_s
        stamps_s = self._imu.stamps_s[new]
        self._last_imu_s = float(stamps_s[-1]) if len(stamps_s) else self._last_imu_s
        # The clock of the library has no steps back.
        offset_s = self._now_s - scan.stamp_s
        samples = ImuSamples(stamps_s + offset_s, self._imu.rates[new], self._imu.forces[new])
        return LibraryScan(
            scan.points[usable].astype(np.float64),
            scan.time_offset_s[usable].astype(np.float64),
            self._now_s,
            self._now_s - self._last_taken_s if self._before else 0.0,
            samples,
        )

    def _placed(self, scan: LibraryScan) -> str:
        """Let the library place a scan; return the reason why the pose is degraded, or nothing."""
        try:
            placed = self._library.place(scan)
        except Exception as error:
            self._refused += 1
            if self._refused == LOST:
                self._begin()
            return f"refused: {' '.join(str(error).split())}"
        self._refused = 0
        if not np.isfinite(placed.world_from_lidar).all():
            self._begin()
            return "the library's pose is not finite"
        before, self._before = self._before, placed
        taken_s, self._last_taken_s = self._last_taken_s, scan.stamp_s
        if before is None:
            self._first_pose = self._pose
            is_restart, self._placed_any = self._placed_any, True
            return "the library was restarted" if is_restart else ""
        return self._moved(before, taken_s, placed, scan.stamp_s)

    def _moved(self, before: Placed, taken_s: float, placed: Placed, stamp_s: float) -> str:
        """Accept a motion; return the reason why it is implausible, or nothing."""
        moved = orthonormal(inverse(before.world_from_lidar) @ placed.world_from_lidar)
        length_s = placed.at_s - before.at_s
        twist = log_se3(moved) / length_s
        speed_m_s = float(np.linalg.norm(twist[:3]))
        if not speed_m_s <= FASTEST_M_S:
            self._begin()
            return f"{speed_m_s:.0f} m/s is not the speed of a vehicle"
        if self._start_from_world is None:
            first = _pose_at(before, twist, taken_s)
            self._start_from_world = self._first_pose @ inverse(first)
        self._pose = orthonormal(self._start_from_world @ _pose_at(placed, twist, stamp_s))
        self._twist = twist
        return self._doubted(twist[:3], placed.at_s)

    def _doubted(self, velocity: np.ndarray, at_s: float) -> str:
        """Return why a speed is implausible after the last trusted one, or nothing."""
        if self._trusted is not None:
            before, then_s = self._trusted
            change_m_s = float(np.linalg.norm(velocity - before))
            if change_m_s > JUMP_M_S + JUMP_M_S2 * (at_s - then_s):
                return f"the speed jumps by {change_m_s:.0f} m/s"
        self._trusted = velocity, at_s
        return ""


def _pose_at(placed: Placed, twist: np.ndarray, to_s: float) -> np.ndarray:
    """Return the (4, 4) pose at another time, with a constant (6,) twist."""
    pose_then: np.ndarray = placed.world_from_lidar @ exp_se3(twist * (to_s - placed.at_s))
    return pose_then
