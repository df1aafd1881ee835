"""Scans against a map of surfaces in voxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.clock import Clock, ScanTick
from roadscope.odometry.cloud_kernels import deskewed, placed, thinned
from roadscope.odometry.estimates import estimate, grown, poverty
from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.rigid import exp_se3, inverse, log_se3
from roadscope.odometry.scatter import scattered
from roadscope.odometry.voxels.matching import PosePrior, ScanMatch, best_match, match
from roadscope.odometry.voxels.surfaces import VoxelMap

BOUNDS_M = (1.5, 120.0)
"""Nearer is the own vehicle; farther, beams lie too far apart to tell a surface."""
LEAST_POINTS = 60
LEAST_AGREEMENT = 0.3
WEAKEST_M = 0.2
"""A pose that the scan leaves so uncertain in some direction is carried by the prediction."""
LOST = 5
"""So many scans in a row that do not fit: the map is begun anew."""
SPEEDS_M_S = tuple(range(-4, 49, 2))
"""Along x, tried when nothing is known of the speed, slowest first among equals."""
ACCELERATION_M_S2, TURNING_RAD_S2 = 8.0, 2.0
"""What vehicles do not exceed for long; hard braking on dry road is 8 m/s^2."""
GYRO_RAD_S = 0.01
"""How far a gyro's mean rate may be off: its bias before it is learned."""
BIAS_GAIN = 0.05
SIMILAR = 50.0
"""So many returns are worth one, beside the prediction and for the covariance: neighbours err
alike, by the same misfit surface, and traffic errs together."""


@dataclass(slots=True)
class TimedPoints:
    """What is used of a scan: (N, 3) points where they were measured, (N,) times after the stamp.

    few: rows that are matched; all are put into the map.
    """

    points: np.ndarray
    times_s: np.ndarray
    few: np.ndarray

    def at_stamp(self, twist: np.ndarray, rows: np.ndarray | slice) -> np.ndarray:
        """Return the points of rows as seen at the stamp by a sensor that moves at a twist."""
        return deskewed(self.points[rows], self.times_s[rows], twist)


class VoxelMapOdometry:
    """Moves each scan onto the surfaces that those before it left in voxels of three sizes.

    Predicted at constant velocity, turned by the gyro where there is one; the sweep's own motion
    is taken out. Where nothing is known of the speed, many are tried.
    """

    def __init__(
        self,
        *,
        memory: Literal["map", "scan"] = "map",
        match_m: float = 0.8,
        insert_m: float = 0.3,
        reach_m: float = 150.0,
    ) -> None:
        if memory not in ("map", "scan"):
            raise ValueError(f"memory is 'map' or 'scan', got {memory!r}")
        for name, size_m in (("match_m", match_m), ("insert_m", insert_m), ("reach_m", reach_m)):
            if not size_m > 0:
                raise ValueError(f"{name} must be above 0, got {size_m!r}")
        self.memory, self.match_m, self.insert_m = memory, match_m, insert_m
        self._map = VoxelMap(reach_m=reach_m)
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget map, pose and speed."""
        self._map.clear()
        self._clock, self._imu = Clock(), ImuBuffer(lidar_from_imu)
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._twist, self._bias = np.zeros(6), np.zeros(3)
        self._first: TimedPoints | None = None
        self._begun, self._misfits = False, 0

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Move the scan onto the map and say where that puts the sensor."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        twist = self._expected(scan.stamp_s, tick)
        cloud = self._cloud(scan)
        poor = poverty(len(cloud.few), LEAST_POINTS, scan.ring)
        if poor:
            self._carry_on(twist, tick)
        elif not self._begun:
            self._begin(cloud, twist, tick)
        else:
            poor = self._follow(cloud, twist, tick)
        lack = self._imu.lack(scan.stamp_s, tick.elapsed_s)
        reason = tick.reason or poor or lack or scattered(scan)
        return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), reason)

    def _cloud(self, scan: LidarScan) -> TimedPoints:
        rows = thinned(scan.points, self.insert_m, *BOUNDS_M)
        points = scan.points[rows]
        return TimedPoints(
            points, scan.time_offset_s[rows], thinned(points, self.match_m, *BOUNDS_M)
        )

    def _expected(self, stamp_s: float, tick: ScanTick) -> np.ndarray:
        """Return the twist since the last scan: the last one, turned as the gyro says."""
        twist = self._twist.copy()
        rate = self._imu.mean_rate(stamp_s - tick.elapsed_s, stamp_s) if tick.elapsed_s else None
        self._turned = rate
        if rate is not None:
            twist[3:] = rate - self._bias
        return twist

    def _begin(self, cloud: TimedPoints, twist: np.ndarray, tick: ScanTick) -> None:
        """Start a map with a scan; the next one tells how fast it was taken."""
        self._carry_on(twist, tick)
        self._map.clear()
        self._first, self._begun, self._misfits = cloud, True, 0
        self._remember(cloud, self._twist)

    def _follow(self, cloud: TimedPoints, twist: np.ndarray, tick: ScanTick) -> str:
        """Match a scan; return what is wrong with it, or nothing."""
        found, twist = self._matched(cloud, twist, tick)
        self._first = None
        motion = inverse(self._pose) @ found.map_from_sensor
        uncertain = self._uncertainty(found)
        poor = _misfit(found, uncertain)
        if poor:
            self._carry_on(twist, tick)
            self._misfits += 1
            self._begun = self._misfits < LOST
            return poor
        self._misfits = 0
        self._covariance = grown(self._covariance, motion, uncertain)
        self._pose, self._twist = found.map_from_sensor, log_se3(motion) / tick.elapsed_s
        if self._turned is not None:
            self._bias += BIAS_GAIN * (self._turned - self._bias - self._twist[3:])
        self._remember(cloud, self._twist)
        return ""

    def _matched(
        self, cloud: TimedPoints, twist: np.ndarray, tick: ScanTick
    ) -> tuple[ScanMatch, np.ndarray]:
        """Return the best match, deskewed again with what was found, and the expected twist."""
        if self._first is not None and not self._twist.any():
            twist = self._first_twist(self._first, cloud, twist, tick.elapsed_s)
        starts = [self._belief(each, tick) for each in _around(twist, tick)]
        points = cloud.at_stamp(twist, cloud.few)
        found = best_match(self._map, points, starts)
        seen = log_se3(inverse(self._pose) @ found.map_from_sensor) / tick.elapsed_s
        points = cloud.at_stamp(seen, cloud.few)
        start = PosePrior(found.map_from_sensor, self._belief(twist, tick).information)
        return match(self._map.voxels, points, start, scales=(3.0,), steps=3), twist

    def _first_twist(
        self, first: TimedPoints, cloud: TimedPoints, twist: np.ndarray, elapsed_s: float
    ) -> np.ndarray:
        """Try speeds: the first scan, freed of each, is the map on which the second must fit."""
        tried = []
        for speed in sorted(SPEEDS_M_S, key=abs):
            guess = np.array([speed, 0.0, 0.0, *twist[3:]])
            self._map.clear()
            self._remember(first, guess)
            start = self._belief(guess, ScanTick(elapsed_s))
            found = match(self._map.voxels, cloud.at_stamp(guess, cloud.few), start)
            tried.append((found.fits, log_se3(inverse(self._pose) @ found.map_from_sensor)))
        moved = max(tried, key=lambda each: each[0])[1] / elapsed_s
        self._map.clear()
        self._remember(first, moved)
        return moved

    def _belief(self, twist: np.ndarray, tick: ScanTick) -> PosePrior:
        """Say where a twist leads, and how sure that is at the limits of driving."""
        shift_m = ACCELERATION_M_S2 * tick.elapsed_s**2
        turn = TURNING_RAD_S2 * tick.elapsed_s**2
        if self._turned is not None:
            turn = min(turn, GYRO_RAD_S * tick.elapsed_s)
        spread = np.array([shift_m] * 3 + [turn] * 3)
        return PosePrior(self._pose @ exp_se3(twist * tick.elapsed_s), np.diag(SIMILAR / spread**2))

    def _uncertainty(self, found: ScanMatch) -> np.ndarray:
        """Return the (6, 6) covariance of a match in the sensor's frame."""
        axes = np.kron(np.eye(2), found.map_from_sensor[:3, :3])
        information = axes.T @ found.information @ axes / SIMILAR
        covariance: np.ndarray = np.linalg.inv(information + 1e-6 * np.eye(6))
        return covariance

    def _carry_on(self, twist: np.ndarray, tick: ScanTick) -> None:
        """Go on as before without a look at the scan."""
        if not tick.elapsed_s:
            return
        motion = exp_se3(twist * tick.elapsed_s)
        spread = np.array([ACCELERATION_M_S2] * 3 + [TURNING_RAD_S2] * 3) * tick.elapsed_s**2
        self._covariance = grown(self._covariance, motion, np.diag(spread**2))
        self._pose = self._pose @ motion

    def _remember(self, cloud: TimedPoints, twist: np.ndarray) -> None:
        if self.memory == "scan":
            self._map.clear()
        points = placed(cloud.at_stamp(twist, slice(None)), self._pose)
        self._map.add(points, self._pose[:3, 3])


def _around(twist: np.ndarray, tick: ScanTick) -> list[np.ndarray]:
    """Return twists to start from: after a gap the speed may have changed."""
    if not tick.reason:
        return [twist]
    changes = np.linspace(-1, 1, 9) * ACCELERATION_M_S2 / 2 * tick.elapsed_s
    return [twist + np.array([c, 0, 0, 0, 0, 0]) for c in sorted(changes, key=abs)]


def _misfit(found: ScanMatch, uncertain: np.ndarray) -> str:
    """Say why a match is not to be trusted; empty if it is."""
    if found.held < LEAST_POINTS:
        return f"{found.held} points on surfaces that are known"
    if found.agreement < LEAST_AGREEMENT:
        return f"{found.agreement:.0%} of the points agree"
    weakest_m = float(np.sqrt(np.linalg.eigvalsh(uncertain[:3, :3])[-1]))
    if weakest_m > WEAKEST_M:
        return f"the scan leaves {weakest_m:.2g} m open in one direction"
    return ""
