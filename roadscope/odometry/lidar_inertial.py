"""Tightly coupled LiDAR-inertial odometry on a map of static surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose, WheelSamples
from roadscope.core.arguments import check_positive, check_positive_or_infinite
from roadscope.core.names import unknown
from roadscope.envs.sensors.imu_spec import IMUS
from roadscope.odometry.clock import Clock, ScanTick
from roadscope.odometry.estimates import LOST, estimate, lack_of_points, propagated_covariance
from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import POSE, SPEED, InertialNoise, InertialState, resume
from roadscope.odometry.inertial.speed_check import FAR_M_S, SpeedCheck
from roadscope.odometry.inertial.speed_search import ROUGHLY_M_S, Speed
from roadscope.odometry.inertial.standstill import (
    WINDOW_S,
    IntegratedSpeed,
    RestHistory,
    measured_rest,
)
from roadscope.odometry.inertial.start import InertialStart
from roadscope.odometry.inertial.track import ImuInterval, InertialTrack
from roadscope.odometry.inertial.wheel_buffer import WheelBuffer
from roadscope.odometry.rigid import inverse
from roadscope.odometry.scatter import excessive_noise
from roadscope.odometry.voxels.matching import ScanMatch, misfit_of
from roadscope.odometry.voxels.sweep import ThinnedScan

USUAL_UNIT = "adis16448"
"""The inertial unit whose noise is assumed by default."""
SUFFICIENT_INFORMATION, SUFFICIENT_AGREEMENT = 1.0, 0.5
"""Sufficient mean information of a point about the forward motion, 1/m^2. It is 2 and more on
streets, less in platoons, in tunnels and between barriers. With less information, at least the
share `SUFFICIENT_AGREEMENT` of the points must agree with the map: it does in all but 4 of 1500
scans of validation seeds, and in no scan in which all objects move along with the sensor."""
VAGUE_M_S = 0.5
"""An estimate is degraded if the standard deviation of its speed is greater. Chosen by hand."""
GUESS_M_S, GUESS_RAD_S = 10.0, 0.1
"""Standard deviations of speed and turn rate while the speed is unknown. Chosen by hand."""
SPEED_UNKNOWN = "too few fixtures determine the speed"
"""Fixtures are static objects beside the road."""
SCANS_IN_MAP = 10.0
"""Consecutive scans are matched with nearly the same scans in the map, about so many, so their
errors are nearly the same. The variance of a pose on the map, divided by this, is the part that is
new in a scan. Chosen by hand."""
SLIP = 10
"""Tyres may slip during so many scans in a row. Later a wheel speed is accepted, however different
from the predicted one. Chosen by hand."""


class LidarInertialOdometry:
    """Error-state Kalman filter on inertial samples, corrected by each scan on a map of surfaces.

    The first scans determine the speed: that at which their static objects coincide. From then on
    the inertial prediction is so precise that traffic which moves along with the sensor cannot
    displace the pose. A return at a place through which earlier beams passed is of an object that
    has moved there. A return at a place that was hidden by an object at the same range may be of
    this object, which then moves along with the sensor. Both are dynamic and left out. The filter
    follows Xu 2022 (FAST-LIO2); map, speed search and the detection of dynamic returns are ours.
    Without an IMU the prediction has constant velocity.
    """

    def __init__(
        self,
        *,
        match_m: float = 0.8,
        insert_m: float = 0.3,
        reach_m: float = 120.0,
        drop_dynamic: bool = True,
        imu: str = USUAL_UNIT,
        wheels: bool = False,
    ) -> None:
        """Store the settings.

        match_m, insert_m: edges of the cubes of which one return each is matched, or added to the
            map, metres; indoors, where there are few cubes, those for matching are smaller.
        reach_m: radius of the map. drop_dynamic: leave out dynamic returns, and those that
            contradict a surface of the map.
        imu: the unit whose noise is expected, a name of `envs.sensors.imu_spec.IMUS`.
        wheels: whether wheel speeds are used, if there are any.
        """
        check_positive(match_m=match_m, insert_m=insert_m)
        check_positive_or_infinite(reach_m=reach_m)
        self.match_m, self.insert_m, self.reach_m = match_m, insert_m, reach_m
        if imu not in IMUS:
            raise ValueError(unknown("inertial unit", imu, IMUS))
        self.drop_dynamic, self.imu, self.wheels = drop_dynamic, imu, wheels
        self.noise = InertialNoise() if imu == USUAL_UNIT else InertialNoise.of(IMUS[imu])
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear map, pose, speed and biases."""
        self._clock, self._imu = Clock(), ImuBuffer(lidar_from_imu)
        self._wheels = WheelBuffer()
        self._lever = np.zeros(3) if lidar_from_imu is None else lidar_from_imu.translation.copy()
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._earlier_state: InertialState | None = None
        self._trust_gravity = True
        self._integrated_speed, self._last_fast_s = IntegratedSpeed(self.noise), -np.inf
        self._begin(np.eye(4))

    def _begin(self, start_from_map: np.ndarray) -> None:
        self._start_from_map = start_from_map
        self._track: InertialTrack | None = None
        self._start = InertialStart(self.noise, is_restart=self._earlier_state is not None)
        self._check, self._misfits = SpeedCheck(), 0
        self._speed_known, self._rest = False, RestHistory(self.noise)
        self._slipped = 0

    def add_wheels(self, wheels: WheelSamples) -> None:
        """Add speeds along the LiDAR's x axis, which is that of the vehicle."""
        if self.wheels:
            self._wheels.add(wheels)

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Predict by the samples, correct by the scan, and return the pose."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        interval = self._samples_since_last(scan, tick)
        self._integrated_speed.predict(interval)
        sweep = ThinnedScan.of(scan, self.insert_m, self.match_m)
        moving = np.zeros(len(sweep.rows), bool)
        problem = lack_of_points(len(sweep.matched_rows), scan.ring)
        if self._track is None:
            problem = self._collect_first_scans(sweep, interval, problem)
        else:
            moving, problem = self._match_scan(self._track, sweep, interval, problem)
        self._update_pose_and_covariance(interval)
        sensor_problem = self._imu.missing_samples(scan.stamp_s, tick.elapsed_s)
        return estimate(
            self._pose,
            self._covariance,
            scan.stamp_s,
            len(scan),
            tick.reason or problem or sensor_problem or excessive_noise(scan),
            dynamic=sweep.spread(moving),
        )

    def _samples_since_last(self, scan: LidarScan, tick: ScanTick) -> ImuInterval:
        """Return the inertial samples since the last scan."""
        stamp_s, start_s = scan.stamp_s, scan.stamp_s - tick.elapsed_s
        half_s = float(np.abs(scan.time_offset_s).max(initial=0.0))
        rate = self._imu.mean_rate(stamp_s - half_s, stamp_s + half_s) if half_s else None
        if tick.elapsed_s and self._imu.covers(start_s, stamp_s):
            return ImuInterval(tick.elapsed_s, *self._imu.within(start_s, stamp_s), rate)
        none = np.empty((0, 3))
        return ImuInterval(tick.elapsed_s, np.empty(0), none, none, rate)

    def _collect_first_scans(self, sweep: ThinnedScan, interval: ImuInterval, problem: str) -> str:
        """Collect first scans until they determine the speed; return a reason until then."""
        if problem:
            return problem
        self._start.add(sweep, interval, self._imu)
        wheel_speed = self._wheels.at(sweep.scan.stamp_s)
        speed = self._start.speed() if wheel_speed is None else Speed.measured(wheel_speed[0])
        if speed is None:
            return "" if len(self._start) == 1 else "the speed is not known yet"
        if wheel_speed is None and speed.ahead_m_s < self._integrated_speed.least_m_s:
            speed = replace(speed, ahead_m_s=self._integrated_speed.gained_m_s, by_fixtures=False)
        self._track = self._start.track(speed, self._imu, self._lever, self._new_track)
        self._speed_known = speed.reliable or sweep.close
        return "" if self._speed_known else SPEED_UNKNOWN

    def _new_track(self, state: InertialState) -> InertialTrack:
        if self._earlier_state is not None:
            resume(state, self._earlier_state, with_gravity=self._trust_gravity)
            self._trust_gravity = True
        return InertialTrack(
            state, self._lever, self.noise, reach_m=self.reach_m, drop_dynamic=self.drop_dynamic
        )

    def _match_scan(
        self, track: InertialTrack, sweep: ThinnedScan, interval: ImuInterval, problem: str
    ) -> tuple[np.ndarray, str]:
        """Predict and correct; return (K,) dynamic returns, and the reason of a degraded pose."""
        track.predict(interval)
        scan = sweep.scan
        if not track.slow:
            self._last_fast_s = scan.stamp_s
        wheels_used = self._use_wheels(track, scan.stamp_s)
        points = track.points_at_stamp(sweep)
        moving = track.moving(points, scan.stamp_s)
        if problem:
            self._rest = RestHistory(self.noise)
            return moving, problem
        scan_match = track.matched(sweep, points, moving)
        problem = misfit_of(scan_match)
        # While fixtures confirm the speed, the points that do not agree are of traffic.
        fits = not problem or wheels_used or self._check.confirmed(scan.stamp_s)
        if not wheels_used and track.twist()[0] < self._integrated_speed.least_m_s:
            problem, fits = "the speed is below the integrated acceleration", False
        self._misfits = 0 if fits else self._misfits + 1
        if fits:
            track.update_by_match(scan_match)
            self._update_rest(track, interval, scan.stamp_s)
            track.add_to_map(sweep, points, moving)
            # In a room there is no traffic that could mislead the speed.
            self._speed_known |= sweep.close
            if not wheels_used:
                problem = self._check_by_fixtures(track, scan) or problem
        else:
            self._rest = RestHistory(self.noise)
        if self._misfits >= LOST:
            self._earlier_state = track.state
            self._begin(self._start_from_map @ track.pose)
        problem = problem or ("" if self._speed_known else SPEED_UNKNOWN)
        return moving, problem or _reason_of_vague_speed(track) or _reason_of_missing_information(
            track, scan_match
        )

    def _use_wheels(self, track: InertialTrack, now_s: float) -> bool:
        """Use the speed of wheels; return whether it was accepted.

        Tyres slip only for a moment: a lasting speed is accepted unless fixtures contradict it.
        """
        wheel_speed = self._wheels.at(now_s)
        if wheel_speed is None:
            return False
        doubted = self._slipped < SLIP or self._check.confirmed(now_s)
        accepted = track.correct_by_wheels(*wheel_speed, doubted=doubted)
        self._slipped = 0 if accepted else self._slipped + 1
        return accepted

    def _update_rest(self, track: InertialTrack, interval: ImuInterval, now_s: float) -> None:
        """Correct a sensor at rest; at the end, go back to the last state that surely was at rest.

        In steady braking samples are as constant as at rest, but the sensor was faster shortly
        before.
        """
        slow = now_s >= self._last_fast_s + WINDOW_S
        means = measured_rest(self._imu, now_s, self.noise) if slow else None
        if means is not None and self._rest.may_continue(interval, now_s):
            rate, force = means
            if self._rest.is_empty:
                track.correct_gravity(force)
            track.correct_at_rest(rate)
            self._rest.add(track, interval)
            self._integrated_speed.start_from_rest(track.state)
        elif self._rest.end(track, interval, now_s):
            self._integrated_speed.start_from_rest(track.state)
        track.doubt_m = self._rest.doubt_m(track)

    def _check_by_fixtures(self, track: InertialTrack, scan: LidarScan) -> str:
        """Correct the speed by fixtures; return a reason if they contradict it.

        Then `_match_scan` starts everything again, as after `LOST` rejected scans.
        """
        ahead_m_s, rate_rad_s = track.twist()[[0, 5]]
        measured = self._check.speed_error(
            scan,
            float(ahead_m_s),
            float(rate_rad_s),
            track.hidden_acceleration_m_s2,
            self._integrated_speed.least_m_s,
        )
        if measured is None:
            return ""
        off_m_s, spread_m_s = measured
        if abs(off_m_s) > FAR_M_S:
            self._misfits = LOST
            return "fixtures beside the road show another speed"
        if self._check.contradicts(
            off_m_s, track.speed_deviation_m_s(max(spread_m_s, ROUGHLY_M_S))
        ):
            # The filter has taken the error of the speed for a slope, which changes gravity.
            self._misfits, self._trust_gravity = LOST, False
            return "fixtures beside the road repeatedly show another speed"
        track.correct_speed(off_m_s, spread_m_s)
        self._speed_known = True
        return ""

    def _update_pose_and_covariance(self, interval: ImuInterval) -> None:
        """Set pose and covariance from the track, or from the first scans."""
        before = self._pose
        track = self._track
        map_from_lidar = self._start.guess() if track is None else track.pose
        self._pose = self._start_from_map @ map_from_lidar
        if not interval.elapsed_s:
            return
        if track is None or not self._speed_known:
            spread = np.diag([GUESS_M_S**2] * 3 + [GUESS_RAD_S**2] * 3) * interval.elapsed_s**2
        else:
            axes = np.kron(np.eye(2), track.state.pose[:3, :3])
            spread = axes.T @ track.state.covariance[POSE, POSE] @ axes / SCANS_IN_MAP
        self._covariance = propagated_covariance(
            self._covariance, inverse(before) @ self._pose, spread
        )


def _reason_of_vague_speed(track: InertialTrack) -> str:
    """Return a reason if the speed is too uncertain, else an empty text."""
    off_m_s = float(np.sqrt(np.linalg.eigvalsh(track.state.covariance[SPEED, SPEED])[-1]))
    return f"the speed may be {off_m_s:.2g} m/s off" if off_m_s > VAGUE_M_S else ""


def _reason_of_missing_information(track: InertialTrack, scan_match: ScanMatch) -> str:
    """Return a reason if the points do not determine the forward motion, else an empty text."""
    ahead = track.state.pose[:3, 0]
    information = float(ahead @ scan_match.information[:3, :3] @ ahead)
    if (
        information >= SUFFICIENT_INFORMATION * scan_match.matched_points
        or scan_match.agreement >= SUFFICIENT_AGREEMENT
    ):
        return ""
    outliers = 1 - scan_match.agreement
    return f"too few points show the forward motion; {outliers:.0%} disagree with the map"
