"""The first scans, until they determine the speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import (
    GRAVITY_M_S2,
    InertialNoise,
    InertialState,
    SpeedDeviations,
    started,
)
from roadscope.odometry.inertial.speed_search import CELL_M, Ends, Speed, speed_of
from roadscope.odometry.inertial.standstill import measured_rest
from roadscope.odometry.inertial.track import ImuInterval, InertialTrack
from roadscope.odometry.rigid import exp_se3
from roadscope.odometry.voxels.sweep import ThinnedScan

FEWEST, MOST = 4, 6
"""Least and greatest number of first scans. Fewer may agree by chance; after the greatest number
the best speed is used, even if it is not clear."""
DEVIATIONS_M_S = SpeedDeviations(0.5, 0.2, 0.1)
"""Standard deviations of the velocity that the speed search gives."""
REST_DEVIATIONS_M_S = SpeedDeviations(0.05, 0.05, 0.05)
"""Standard deviations of the velocity of a sensor that is at rest."""
SLOW_M_S = 2 * DEVIATIONS_M_S.ahead
FORCE_S = 0.1
"""A speed that the search gives below the first may be that of a sensor at rest. The specific force
at the first scan is averaged over the second."""


class InertialStart:
    """Collects scans and the samples between them.

    is_restart: at the first start a sensor whose samples are constant is taken to be at rest,
    unless fixtures show that it moves; at a restart it is not. search: returns the speed of some
    scans with a turn rate, rad/s.
    """

    def __init__(
        self,
        noise: InertialNoise,
        *,
        is_restart: bool = False,
        search: Callable[[list[Ends], float], Speed] = speed_of,
    ) -> None:
        self.noise, self._search = noise, search
        self._sweeps: list[tuple[ThinnedScan, ImuInterval, Ends]] = []
        self._rate, self._best = np.zeros(3), Speed(0.0, 0.0)
        self._is_restart, self._quiet = is_restart, False

    def __len__(self) -> int:
        return len(self._sweeps)

    def add(self, sweep: ThinnedScan, interval: ImuInterval, samples: ImuBuffer) -> None:
        """Add a scan."""
        self._sweeps.append((sweep, interval, Ends.of(sweep.scan)))
        first_s, last_s = self._sweeps[0][0].scan.stamp_s, sweep.scan.stamp_s
        rate = samples.mean_rate(first_s, last_s) if last_s > first_s else None
        self._rate = np.zeros(3) if rate is None else rate
        self._quiet = measured_rest(samples, last_s, self.noise, last_s - first_s) is not None

    @property
    def at_rest(self) -> bool:
        """Whether the sensor is at rest since the first scan."""
        return self._quiet and not self._is_restart and not self._best.by_fixtures

    def speed(self) -> Speed | None:
        """Return the speed ahead once it is clear or there are enough scans, else None."""
        if len(self._sweeps) < 2:
            return None
        self._best = self._search([ends for *_, ends in self._sweeps], float(self._rate[2]))
        if self._quiet and not self._is_restart:
            self._best = _at_rest_unless_fixtures(self._best)
        if len(self._sweeps) < (FEWEST if self._best.clear else MOST):
            return None
        return self._best

    def guess(self) -> np.ndarray:
        """Return the best (4, 4) pose of the last scan in the frame of the first."""
        if not self._sweeps:
            return np.eye(4)
        elapsed_s = self._sweeps[-1][0].scan.stamp_s - self._sweeps[0][0].scan.stamp_s
        # A displacement within one cell is not significant.
        ahead_m = self._best.ahead_m_s * elapsed_s
        ahead_m = ahead_m if abs(ahead_m) > CELL_M / 2 else 0.0
        return exp_se3(np.array([ahead_m, 0.0, 0.0, *(self._rate * elapsed_s)]))

    def track(
        self,
        speed: Speed,
        samples: ImuBuffer,
        lever: np.ndarray,
        new_track: Callable[[InertialState], InertialTrack],
    ) -> InertialTrack:
        """Return a track that has processed all scans so far.

        lever: see `InertialTrack`. new_track: makes a track from the state at the first scan.
        """
        stamp_s = self._sweeps[0][0].scan.stamp_s
        force = np.array([0.0, 0.0, GRAVITY_M_S2])
        if samples.covers(stamp_s, stamp_s + FORCE_S):
            lengths, _, forces = samples.within(stamp_s, stamp_s + FORCE_S)
            force = lengths @ forces / lengths.sum()
        ahead_m_s = max(DEVIATIONS_M_S.ahead, speed.spread_m_s)
        at_rest = self.at_rest and not speed.ahead_m_s
        deviations = REST_DEVIATIONS_M_S if at_rest else DEVIATIONS_M_S._replace(ahead=ahead_m_s)
        state = started(force, np.array([speed.ahead_m_s, 0.0, 0.0]), deviations, self.noise)
        state.pose[:3, 3] = lever
        track = new_track(state)
        for i, (sweep, interval, _) in enumerate(self._sweeps):
            track.predict(interval, still=i == 0)
            points = track.points_at_stamp(sweep)
            moving = track.moving(points, sweep.scan.stamp_s)
            if i:
                track.update_by_match(track.matched(sweep, points, moving))
            track.add_to_map(sweep, points, moving)
        return track


def _at_rest_unless_fixtures(speed: Speed) -> Speed:
    """Return the speed of a sensor with constant samples: low ends may all belong to traffic."""
    if not speed.by_fixtures:
        return Speed(0.0, 0.0)
    return replace(speed, ahead_m_s=0.0) if abs(speed.ahead_m_s) < SLOW_M_S else speed
