"""What other libraries' odometries leave to us: stamps, poor scans, frames, what is degraded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.above_ground import standing
from roadscope.odometry.clock import Clock
from roadscope.odometry.estimates import estimate, grown, poverty
from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.peers.interface import Given, Library, Placed
from roadscope.odometry.rigid import exp_se3, inverse, log_se3, orthonormal
from roadscope.odometry.scatter import scattered

LEAST_POINTS = 60
FASTEST_M_S = 100.0
"""Faster is no vehicle: the library is lost and begun anew."""
JUMP_M_S2, JUMP_M_S = 15.0, 2.0
"""A speed that changes by more is that of no vehicle; the latter is what scans leave open."""
LOST = 5
"""So many scans in a row that a library refuses: it is begun anew."""
STEP = np.diag([0.05] * 3 + [0.005] * 3) ** 2
"""Nominal covariance of a step, metres and radians: the libraries tell none."""
CARRIED = np.diag([8.0] * 3 + [2.0] * 3) ** 2
"""That of a pose carried on for a second: the accelerations that vehicles do not exceed."""


class Adapter:
    """Runs a library's odometry and answers as ours do.

    A library never sees a scan that is out of order or too poor to match: the pose is carried on
    at constant velocity. Poses are brought from where the library puts the LiDAR, which may be at
    the end of the sweep, to the stamp, at the velocity between the last two scans.
    """

    def __init__(
        self, start: Callable[[Pose | None], Library], *, takes_imu: bool, ground: bool = True
    ) -> None:
        """Take what starts a library, told how the IMU is mounted; takes_imu: it has use for it.

        ground: whether it is shown the ground, as its authors mean it to be. Where that is flat
        its rings travel with the sensor, and who has no prior follows them. Without it the rest
        is what `standing` leaves.
        """
        self._start, self._takes_imu, self._ground = start, takes_imu, ground
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget everything."""
        self._mounting = lidar_from_imu
        self._clock, self._imu, self._felt_s = Clock(), ImuBuffer(None), -np.inf
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._twist: np.ndarray | None = None
        self._trusted: tuple[np.ndarray, float] | None = None
        self._now_s, self._placed_any = 0.0, False
        self._begin()

    def _begin(self) -> None:
        """Start the library; its second scan tells where its world lies."""
        self._library = self._start(self._mounting)
        self._before: Placed | None = None
        self._taken_s = 0.0
        self._start_from_world: np.ndarray | None = None
        self._refused = 0

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Hand the scan on and say where that puts the LiDAR."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        self._now_s += tick.elapsed_s
        before = self._pose
        if self._twist is not None:
            self._pose = before @ exp_se3(self._twist * tick.elapsed_s)
        sound = np.isfinite(scan.points).all(axis=1)
        if not self._ground:
            above = np.zeros(len(sound), bool)
            above[standing(scan).rows] = True
            sound &= above
        given = self._given(scan, sound)
        poor = poverty(int(sound.sum()), LEAST_POINTS, scan.ring[sound]) or self._placed(given)
        spread = CARRIED * tick.elapsed_s**4 if poor else STEP * bool(tick.elapsed_s)
        self._covariance = grown(self._covariance, inverse(before) @ self._pose, spread)
        lack = self._imu.lack(scan.stamp_s, tick.elapsed_s) if self._takes_imu else ""
        reason = tick.reason or poor or lack or scattered(scan)
        return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), reason)

    def _given(self, scan: LidarScan, sound: np.ndarray) -> Given:
        new = self._imu.stamps_s > self._felt_s
        stamps_s = self._imu.stamps_s[new]
        self._felt_s = float(stamps_s[-1]) if len(stamps_s) else self._felt_s
        late_s = self._now_s - scan.stamp_s
        samples = ImuSamples(stamps_s + late_s, self._imu.rates[new], self._imu.forces[new])
        return Given(
            scan.points[sound].astype(np.float64),
            scan.time_offset_s[sound].astype(np.float64),
            self._now_s,
            self._now_s - self._taken_s if self._before else 0.0,
            samples,
        )

    def _placed(self, given: Given) -> str:
        """Let the library place a scan; return what is wrong with that, or nothing."""
        try:
            placed = self._library.place(given)
        except Exception as error:
            self._refused += 1
            if self._refused == LOST:
                self._begin()
            return f"refused: {' '.join(str(error).split())}"
        self._refused = 0
        if not np.isfinite(placed.world_from_lidar).all():
            self._begin()
            return "the library's pose is no number"
        before, self._before = self._before, placed
        taken_s, self._taken_s = self._taken_s, given.stamp_s
        if before is None:
            self._first_pose = self._pose
            anew, self._placed_any = self._placed_any, True
            return "the library begins anew" if anew else ""
        return self._moved(before, taken_s, placed, given.stamp_s)

    def _moved(self, before: Placed, taken_s: float, placed: Placed, stamp_s: float) -> str:
        """Take over a motion; return what is wrong with it, or nothing."""
        moved = orthonormal(inverse(before.world_from_lidar) @ placed.world_from_lidar)
        length_s = placed.at_s - before.at_s
        twist = log_se3(moved) / length_s
        speed_m_s = float(np.linalg.norm(twist[:3]))
        if not speed_m_s <= FASTEST_M_S:
            self._begin()
            return f"{speed_m_s:.0f} m/s is no speed of a vehicle"
        if self._start_from_world is None:
            first = _brought(before, twist, taken_s)
            self._start_from_world = self._first_pose @ inverse(first)
        self._pose = orthonormal(self._start_from_world @ _brought(placed, twist, stamp_s))
        self._twist = twist
        return self._doubted(twist[:3], placed.at_s)

    def _doubted(self, velocity: np.ndarray, at_s: float) -> str:
        """Say by how much a speed is off the last that was trusted, if no vehicle does that."""
        if self._trusted is not None:
            before, then_s = self._trusted
            change_m_s = float(np.linalg.norm(velocity - before))
            if change_m_s > JUMP_M_S + JUMP_M_S2 * (at_s - then_s):
                return f"the speed jumps by {change_m_s:.0f} m/s"
        self._trusted = velocity, at_s
        return ""


def _brought(placed: Placed, twist: np.ndarray, to_s: float) -> np.ndarray:
    """Return the (4, 4) pose at another time, at a (6,) twist."""
    brought: np.ndarray = placed.world_from_lidar @ exp_se3(twist * (to_s - placed.at_s))
    return brought
