"""Scans against a map of surfaces in voxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.core.arguments import check_positive, check_positive_or_infinite
from roadscope.odometry.clock import Clock, ScanTick
from roadscope.odometry.cloud_kernels import deskewed, placed, thinned
from roadscope.odometry.estimates import (
    LOST,
    SIMILAR,
    WEAKEST_M,
    covariance_of,
    estimate,
    lack_of_points,
    propagated_covariance,
)
from roadscope.odometry.imu_buffer import BIAS_GAIN, ImuBuffer
from roadscope.odometry.rigid import exp_se3, inverse, log_se3
from roadscope.odometry.scatter import excessive_noise
from roadscope.odometry.voxels.matching import PosePrior, ScanMatch, best_match, match, misfit_of
from roadscope.odometry.voxels.surfaces import VoxelMap
from roadscope.odometry.voxels.sweep import BOUNDS_M

SPEEDS_M_S = tuple(range(-4, 49, 2))
"""Speeds along x that are tried if the speed is unknown; of equal ones the slowest is used."""
ACCELERATION_M_S2, TURNING_RAD_S2 = 8.0, 2.0
"""Limits that vehicles do not exceed for long; hard braking on a dry road is 8 m/s^2."""
GYRO_RAD_S = 0.01
"""Standard deviation of a gyro's mean rate: its bias before it is estimated. Chosen by hand."""


@dataclass(slots=True)
class TimedPoints:
    """Thinned points of a scan.

    points: (N, 3) metres, the sensor's frame at each point's own time. times_s: (N,) seconds after
        the stamp. matched_rows: (K,) rows of the points that are matched; all are added to the map.
    """

    points: np.ndarray
    times_s: np.ndarray
    matched_rows: np.ndarray

    def at_stamp(self, twist: np.ndarray, rows: np.ndarray | slice) -> np.ndarray:
        """Return some points, (K, 3), in the sensor's frame at the stamp.

        twist: (6,) m/s and rad/s, constant during the sweep.
        """
        return deskewed(self.points[rows], self.times_s[rows], twist)


class VoxelMapOdometry:
    """Matches each scan with the surfaces of earlier scans in voxels of three sizes.

    The prediction has constant velocity and the turn of the gyro if there is one; scans are
    deskewed. If the speed is unknown, many speeds are tried.

    memory: `map` keeps the surfaces of all scans within `reach_m`, metres; `scan` keeps those of
        the last one only.
    match_m, insert_m: edges of the cubes of which one return each is matched, or added to the map,
        metres.
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
        check_positive(match_m=match_m, insert_m=insert_m)
        check_positive_or_infinite(reach_m=reach_m)
        self.memory, self.match_m, self.insert_m = memory, match_m, insert_m
        self._map = VoxelMap(reach_m=reach_m)
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear map, pose and speed."""
        self._map.clear()
        self._clock, self._imu = Clock(), ImuBuffer(lidar_from_imu)
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._twist, self._bias = np.zeros(6), np.zeros(3)
        self._first: TimedPoints | None = None
        self._begun, self._misfits = False, 0

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Match the scan with the map and return the pose of the sensor."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        twist = self._predicted_twist(scan.stamp_s, tick)
        cloud = self._cloud(scan)
        problem = lack_of_points(len(cloud.matched_rows), scan.ring)
        if problem:
            self._predict_only(twist, tick)
        elif not self._begun:
            self._begin(cloud, twist, tick)
        else:
            problem = self._match_scan(cloud, twist, tick)
        sensor_problem = self._imu.missing_samples(scan.stamp_s, tick.elapsed_s)
        reason = tick.reason or problem or sensor_problem or excessive_noise(scan)
        return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), reason)

    def _cloud(self, scan: LidarScan) -> TimedPoints:
        rows = thinned(scan.points, self.insert_m, *BOUNDS_M)
        points = scan.points[rows]
        return TimedPoints(
            points, scan.time_offset_s[rows], thinned(points, self.match_m, *BOUNDS_M)
        )

    def _predicted_twist(self, stamp_s: float, tick: ScanTick) -> np.ndarray:
        """Return the predicted twist: the last one, with the turn rate of the gyro."""
        twist = self._twist.copy()
        rate = self._imu.mean_rate(stamp_s - tick.elapsed_s, stamp_s) if tick.elapsed_s else None
        self._gyro_rate = rate
        if rate is not None:
            twist[3:] = rate - self._bias
        return twist

    def _begin(self, cloud: TimedPoints, twist: np.ndarray, tick: ScanTick) -> None:
        """Start a map with a scan; the next scan determines its speed."""
        self._predict_only(twist, tick)
        self._map.clear()
        self._first, self._begun, self._misfits = cloud, True, 0
        self._add_to_map(cloud, self._twist)

    def _match_scan(self, cloud: TimedPoints, twist: np.ndarray, tick: ScanTick) -> str:
        """Match a scan; return the reason if it is rejected, else nothing."""
        scan_match, twist = self._matched(cloud, twist, tick)
        self._first = None
        motion = inverse(self._pose) @ scan_match.map_from_sensor
        uncertain = covariance_of(scan_match.map_from_sensor, scan_match.information)
        problem = misfit_of(scan_match) or _reason_of_uncertainty(uncertain)
        if problem:
            self._predict_only(twist, tick)
            self._misfits += 1
            self._begun = self._misfits < LOST
            return problem
        self._misfits = 0
        self._covariance = propagated_covariance(self._covariance, motion, uncertain)
        self._pose, self._twist = scan_match.map_from_sensor, log_se3(motion) / tick.elapsed_s
        if self._gyro_rate is not None:
            self._bias += BIAS_GAIN * (self._gyro_rate - self._bias - self._twist[3:])
        self._add_to_map(cloud, self._twist)
        return ""

    def _matched(
        self, cloud: TimedPoints, twist: np.ndarray, tick: ScanTick
    ) -> tuple[ScanMatch, np.ndarray]:
        """Return the best match, with points deskewed by it, and the predicted twist."""
        if self._first is not None and not self._twist.any():
            twist = self._first_twist(self._first, cloud, twist, tick.elapsed_s)
        starts = [self._prior(each, tick) for each in _around(twist, tick)]
        points = cloud.at_stamp(twist, cloud.matched_rows)
        scan_match = best_match(self._map, points, starts)
        measured = log_se3(inverse(self._pose) @ scan_match.map_from_sensor) / tick.elapsed_s
        points = cloud.at_stamp(measured, cloud.matched_rows)
        start = PosePrior(scan_match.map_from_sensor, self._prior(twist, tick).information)
        return match(self._map.voxels, points, start, scales=(3.0,), steps=3), twist

    def _first_twist(
        self, first: TimedPoints, cloud: TimedPoints, twist: np.ndarray, elapsed_s: float
    ) -> np.ndarray:
        """Return the twist at which the second scan fits best onto the first, which it deskews."""
        tried = []
        for speed in sorted(SPEEDS_M_S, key=abs):
            guess = np.array([speed, 0.0, 0.0, *twist[3:]])
            self._map.clear()
            self._add_to_map(first, guess)
            start = self._prior(guess, ScanTick(elapsed_s))
            scan_match = match(self._map.voxels, cloud.at_stamp(guess, cloud.matched_rows), start)
            tried.append(
                (scan_match.fits, log_se3(inverse(self._pose) @ scan_match.map_from_sensor))
            )
        moved = max(tried, key=lambda each: each[0])[1] / elapsed_s
        self._map.clear()
        self._add_to_map(first, moved)
        return moved

    def _prior(self, twist: np.ndarray, tick: ScanTick) -> PosePrior:
        """Return the prior pose after a twist, uncertain by the limits of driving."""
        shift_m = ACCELERATION_M_S2 * tick.elapsed_s**2
        turn = TURNING_RAD_S2 * tick.elapsed_s**2
        if self._gyro_rate is not None:
            turn = min(turn, GYRO_RAD_S * tick.elapsed_s)
        spread = np.array([shift_m] * 3 + [turn] * 3)
        return PosePrior(self._pose @ exp_se3(twist * tick.elapsed_s), np.diag(SIMILAR / spread**2))

    def _predict_only(self, twist: np.ndarray, tick: ScanTick) -> None:
        """Move as predicted, without the scan."""
        if not tick.elapsed_s:
            return
        motion = exp_se3(twist * tick.elapsed_s)
        spread = np.array([ACCELERATION_M_S2] * 3 + [TURNING_RAD_S2] * 3) * tick.elapsed_s**2
        self._covariance = propagated_covariance(self._covariance, motion, np.diag(spread**2))
        self._pose = self._pose @ motion

    def _add_to_map(self, cloud: TimedPoints, twist: np.ndarray) -> None:
        if self.memory == "scan":
            self._map.clear()
        points = placed(cloud.at_stamp(twist, slice(None)), self._pose)
        self._map.add(points, self._pose[:3, 3])


def _around(twist: np.ndarray, tick: ScanTick) -> list[np.ndarray]:
    """Return initial twists: after a gap the speed may have changed."""
    if not tick.reason:
        return [twist]
    changes = np.linspace(-1, 1, 9) * ACCELERATION_M_S2 / 2 * tick.elapsed_s
    return [twist + np.array([c, 0, 0, 0, 0, 0]) for c in sorted(changes, key=abs)]


def _reason_of_uncertainty(uncertain: np.ndarray) -> str:
    """Return a reason if a position is uncertain in some direction, else an empty text."""
    weakest_m = float(np.sqrt(np.linalg.eigvalsh(uncertain[:3, :3])[-1]))
    if weakest_m > WEAKEST_M:
        return f"in one direction the scan shows the position only to {weakest_m:.2g} m"
    return ""
