"""LiDAR and inertial unit as one, on a map of what stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose, WheelSamples
from roadscope.core.names import unknown
from roadscope.envs.sensors.imu_spec import IMUS
from roadscope.odometry.clock import Clock, ScanTick
from roadscope.odometry.estimates import estimate, grown, poverty
from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import (
    POSE,
    SPEED,
    InertialNoise,
    InertialState,
    resume,
)
from roadscope.odometry.inertial.speed_check import FAR_M_S, SpeedCheck
from roadscope.odometry.inertial.speed_search import ROUGHLY_M_S, Speed
from roadscope.odometry.inertial.standstill import (
    WINDOW_S,
    IntegratedSpeed,
    RestHistory,
    measured_rest,
)
from roadscope.odometry.inertial.start import InertialStart
from roadscope.odometry.inertial.track import InertialTrack, Stretch
from roadscope.odometry.inertial.wheel_buffer import WheelBuffer
from roadscope.odometry.rigid import inverse
from roadscope.odometry.scatter import scattered
from roadscope.odometry.voxels.matching import ScanMatch
from roadscope.odometry.voxels.sweep import ThinnedScan

USUAL_UNIT = "adis16448"
LEAST_POINTS = 60
LEAST_AGREEMENT = 0.3
HOLDS, HALF = 1.0, 0.5
"""A point on a surface tells the way ahead by so much, 1/m^2, on average, or hardly at all: by 2
and more on streets, by less in platoons, tunnels and between barriers. Even there fewer than half
of the points agree in 4 of 1500 scans of validation seeds; where all moves along, in every one."""
VAGUE_M_S = 0.5
"""A speed known no better than this is called degraded."""
GUESS_M_S, GUESS_RAD_S = 10.0, 0.1
"""How far off the motion may be while its speed is not known."""
UNSURE = "nothing that is fixed tells the speed clearly"
REMEMBERED = 10.0
"""A scan is matched to about so many others: its error is theirs in good part."""
LOST = 5
"""So many scans in a row that do not fit: everything begins anew."""
SLIP = 10
"""For so many scans in a row, tyres may slip."""


class LidarInertialOdometry:
    """Error-state Kalman filter on inertial samples, corrected by each scan on a map of surfaces.

    The first scans tell the speed: that at which what stands in them comes together. From then on
    the inertial prediction is so tight that traffic which moves along cannot pull the pose with
    it. Returns where beams looked through before have moved in, or along if beams ended before
    them as far away as now: they are called dynamic and left out. Follows Xu 2022 (FAST-LIO2) in
    the filter; map, speed search and the decision what is dynamic are ours. Without an IMU the
    state goes on at constant velocity.
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
        """Set it up.

        match_m, insert_m: edges of cubes of which one return is matched, or put into the map;
            indoors, where few cubes are met, finer ones are matched.
        reach_m: how far the map goes. drop_dynamic: leave out what is held to be dynamic, and
            put nothing into the map that is off a surface known there.
        imu: the unit whose noise is expected, a name of `envs.sensors.imu_specs.IMUS`.
        wheels: let their speed in, where there are any.
        """
        for name, size_m in (("match_m", match_m), ("insert_m", insert_m), ("reach_m", reach_m)):
            if not size_m > 0:
                raise ValueError(f"{name} must be above 0, got {size_m!r}")
        self.match_m, self.insert_m, self.reach_m = match_m, insert_m, reach_m
        if imu not in IMUS:
            raise ValueError(unknown("inertial unit", imu, IMUS))
        self.drop_dynamic, self.imu, self.wheels = drop_dynamic, imu, wheels
        self.noise = InertialNoise() if imu == USUAL_UNIT else InertialNoise.of(IMUS[imu])
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget map, pose, speed, biases."""
        self._clock, self._imu = Clock(), ImuBuffer(lidar_from_imu)
        self._wheels = WheelBuffer()
        self._lever = np.zeros(3) if lidar_from_imu is None else lidar_from_imu.translation.copy()
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._known: InertialState | None = None
        self._level = True
        self._felt, self._fast_s = IntegratedSpeed(self.noise), -np.inf
        self._begin(np.eye(4))

    def _begin(self, start_from_map: np.ndarray) -> None:
        self._start_from_map = start_from_map
        self._track: InertialTrack | None = None
        self._start = InertialStart(self.noise, anew=self._known is not None)
        self._check, self._misfits = SpeedCheck(), 0
        self._speed_known, self._rest = False, RestHistory(self.noise)
        self._slipped = 0

    def add_wheels(self, wheels: WheelSamples) -> None:
        """Take speeds along the LiDAR's x axis, which is the vehicle's."""
        if self.wheels:
            self._wheels.add(wheels)

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Predict by the samples, correct by the scan."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        stretch = self._stretch(scan, tick)
        self._felt.predict(stretch)
        sweep = ThinnedScan.of(scan, self.insert_m, self.match_m)
        moving = np.zeros(len(sweep.rows), bool)
        poor = poverty(len(sweep.few), LEAST_POINTS, scan.ring)
        if self._track is None:
            poor = self._wait(sweep, stretch, poor)
        else:
            moving, poor = self._follow(self._track, sweep, stretch, poor)
        self._tell(stretch)
        lack = self._imu.lack(scan.stamp_s, tick.elapsed_s)
        return estimate(
            self._pose,
            self._covariance,
            scan.stamp_s,
            len(scan),
            tick.reason or poor or lack or scattered(scan),
            dynamic=sweep.spread(moving),
        )

    def _stretch(self, scan: LidarScan, tick: ScanTick) -> Stretch:
        """Return what was felt since the last scan."""
        stamp_s, start_s = scan.stamp_s, scan.stamp_s - tick.elapsed_s
        half_s = float(np.abs(scan.time_offset_s).max(initial=0.0))
        rate = self._imu.mean_rate(stamp_s - half_s, stamp_s + half_s) if half_s else None
        if tick.elapsed_s and self._imu.covers(start_s, stamp_s):
            return Stretch(tick.elapsed_s, *self._imu.within(start_s, stamp_s), rate)
        none = np.empty((0, 3))
        return Stretch(tick.elapsed_s, np.empty(0), none, none, rate)

    def _wait(self, sweep: ThinnedScan, stretch: Stretch, poor: str) -> str:
        """Gather first scans until they tell the speed; return what is still unknown."""
        if poor:
            return poor
        self._start.add(sweep, stretch, self._imu)
        told = self._wheels.at(sweep.scan.stamp_s)
        speed = self._start.speed() if told is None else Speed.told(told[0])
        if speed is None:
            return "" if len(self._start) == 1 else "the speed is not known yet"
        if told is None and speed.ahead_m_s < self._felt.least_m_s:
            speed = replace(speed, ahead_m_s=self._felt.gained_m_s, by_fixtures=False)
        self._track = self._start.track(speed, self._imu, self._lever, self._made)
        self._speed_known = speed.known or sweep.close
        return "" if self._speed_known else UNSURE

    def _made(self, state: InertialState) -> InertialTrack:
        if self._known is not None:
            resume(state, self._known, level=self._level)
            self._level = True
        return InertialTrack(
            state, self._lever, self.noise, reach_m=self.reach_m, drop_dynamic=self.drop_dynamic
        )

    def _follow(
        self, track: InertialTrack, sweep: ThinnedScan, stretch: Stretch, poor: str
    ) -> tuple[np.ndarray, str]:
        """Predict and correct; return which returns have moved in, and what is wrong."""
        track.predict(stretch)
        scan = sweep.scan
        if not track.slow:
            self._fast_s = scan.stamp_s
        rolled = self._rolled(track, scan.stamp_s)
        points = track.points_at_stamp(sweep)
        moving = track.moving(points, scan.stamp_s)
        if poor:
            self._rest = RestHistory(self.noise)
            return moving, poor
        found = track.matched(sweep, points, moving)
        poor = _misfit(found)
        # While what stands confirms the speed, it is the traffic that does not agree.
        fits = not poor or rolled or self._check.confirmed(scan.stamp_s)
        if not rolled and track.twist()[0] < self._felt.least_m_s:
            poor, fits = "more speed was felt than is seen", False
        self._misfits = 0 if fits else self._misfits + 1
        if fits:
            track.update_by_match(found)
            self._stand_or_leave(track, stretch, scan.stamp_s)
            track.remember(sweep, points, moving)
            # No traffic drives along in a room.
            self._speed_known |= sweep.close
            if not rolled:
                poor = self._held_against_what_stands(track, scan) or poor
        else:
            self._rest = RestHistory(self.noise)
        if self._misfits >= LOST:
            self._known = track.state
            self._begin(self._start_from_map @ track.pose)
        poor = poor or ("" if self._speed_known else UNSURE)
        return moving, poor or _vague(track) or _unmet(track, found)

    def _rolled(self, track: InertialTrack, now_s: float) -> bool:
        """Let in what wheels tell; say whether they told the speed.

        Tyres slip for a moment; what they keep telling is taken unless what stands says otherwise.
        """
        told = self._wheels.at(now_s)
        if told is None:
            return False
        doubted = self._slipped < SLIP or self._check.confirmed(now_s)
        rolled = track.correct_by_wheels(*told, doubted=doubted)
        self._slipped = 0 if rolled else self._slipped + 1
        return rolled

    def _stand_or_leave(self, track: InertialTrack, stretch: Stretch, now_s: float) -> None:
        """Hold the sensor where it stands; once it leaves, take back what was held too long.

        Even braking is felt as evenly as standing, but who brakes was faster within the window.
        """
        slow = now_s >= self._fast_s + WINDOW_S
        felt = measured_rest(self._imu, now_s, self.noise) if slow else None
        if felt is not None and self._rest.may_be(stretch, now_s):
            rate, force = felt
            if self._rest.begins:
                track.correct_gravity(force)
            track.correct_at_rest(rate)
            self._rest.held(track, stretch)
            self._felt.stood(track.state)
        elif self._rest.left(track, stretch, now_s):
            self._felt.stood(track.state)
        track.doubt_m = self._rest.doubt_m(track)

    def _held_against_what_stands(self, track: InertialTrack, scan: LidarScan) -> str:
        """Correct the speed by fixtures; where it is another, say so."""
        ahead_m_s, rate_rad_s = track.twist()[[0, 5]]
        looked = self._check.off(
            scan, float(ahead_m_s), float(rate_rad_s), track.unfelt_m_s2, self._felt.least_m_s
        )
        if looked is None:
            return ""
        off_m_s, spread_m_s = looked
        if abs(off_m_s) > FAR_M_S:
            self._misfits = LOST
            return "what stands beside the road moves otherwise"
        if self._check.contradicts(
            off_m_s, track.speed_deviation_m_s(max(spread_m_s, ROUGHLY_M_S))
        ):
            # What pulled the speed away has passed for a slope.
            self._misfits, self._level = LOST, False
            return "what stands beside the road moves otherwise again and again"
        track.correct_speed(off_m_s, spread_m_s)
        self._speed_known = True
        return ""

    def _tell(self, stretch: Stretch) -> None:
        """Take over pose and covariance of whatever is followed."""
        before = self._pose
        track = self._track
        here = self._start.guess() if track is None else track.pose
        self._pose = self._start_from_map @ here
        if not stretch.elapsed_s:
            return
        if track is None or not self._speed_known:
            spread = np.diag([GUESS_M_S**2] * 3 + [GUESS_RAD_S**2] * 3) * stretch.elapsed_s**2
        else:
            axes = np.kron(np.eye(2), track.state.pose[:3, :3])
            spread = axes.T @ track.state.covariance[POSE, POSE] @ axes / REMEMBERED
        self._covariance = grown(self._covariance, inverse(before) @ self._pose, spread)


def _misfit(found: ScanMatch) -> str:
    """Say why a match is not to be trusted; empty if it is."""
    if found.held < LEAST_POINTS:
        return f"{found.held} points on surfaces that are known"
    if found.agreement < LEAST_AGREEMENT:
        return f"{found.agreement:.0%} of the points agree"
    return ""


def _vague(track: InertialTrack) -> str:
    """Say so where the speed is hardly known; empty where it is."""
    off_m_s = float(np.sqrt(np.linalg.eigvalsh(track.state.covariance[SPEED, SPEED])[-1]))
    return f"the speed may be {off_m_s:.2g} m/s off" if off_m_s > VAGUE_M_S else ""


def _unmet(track: InertialTrack, found: ScanMatch) -> str:
    """Say so where all that would tell how far the sensor came is elsewhere; else empty."""
    ahead = track.state.pose[:3, 0]
    told = float(ahead @ found.information[:3, :3] @ ahead)
    if told >= HOLDS * found.held or found.agreement >= HALF:
        return ""
    return f"what would tell the way ahead does not agree, {1 - found.agreement:.0%} of the points"
