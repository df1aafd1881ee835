"""Check of the estimated speed against fixtures beside the road."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.inertial.speed_search import Ends, Speed, standing_speed_of

SCANS, EVERY_S = 5, 0.5
"""Number of scans of a measurement, half a second at 10 Hz; pause after one that succeeds."""
FAR_M_S = 2.5
"""Errors of this size mean that the map consists of moving traffic."""
NEAR_M_S, BELIEVED_S = 1.0, 2.0
"""A check within this error confirms a speed, for this time."""
UNLIKELY = 3.0
"""A difference of more standard deviations than this is unlikely."""


class SpeedCheck:
    """Measures the speed once a second from a few scans alone, and again at once if that fails.

    One measurement in some hundreds has a gross error. Two in a row hardly have the same error
    unless both contain a wall that ends at the sensor's range: that end moves with the sensor, but
    inertial samples contradict it.
    """

    def __init__(self, measure: Callable[[list[Ends], float], Speed] = standing_speed_of) -> None:
        """Take what returns the speed of some scans with a turn rate, rad/s."""
        self.measure = measure
        self._ends: list[Ends] = []
        self._speeds: list[float] = []
        self._done_s, self._confirmed_s = -np.inf, -np.inf
        self._last_off_m_s, self._last_deviations = np.inf, 0.0

    def speed_error(
        self,
        scan: LidarScan,
        ahead_m_s: float,
        rate_rad_s: float,
        hidden_acceleration_m_s2: float,
        least_m_s: float = -np.inf,
    ) -> tuple[float, float] | None:
        """Add a scan with its motion; return the error of the speed and its deviation, m/s.

        None if there is no clear measurement. hidden_acceleration_m_s2: largest acceleration that
        samples do not show. least_m_s: lower bound of the speed; slower measurements belong to
        traffic.
        """
        if scan.stamp_s < self._done_s + EVERY_S:
            return None
        self._ends.append(Ends.of(scan))
        self._speeds.append(ahead_m_s)
        if len(self._ends) < SCANS:
            return None
        measured = self.measure(self._ends, rate_rad_s)
        estimated_m_s = float(np.mean(self._speeds))
        self._ends, self._speeds = [], []
        if not measured.reliable or measured.ahead_m_s < least_m_s:
            return None
        off_m_s = measured.ahead_m_s - estimated_m_s
        if not self._believed(off_m_s, scan.stamp_s, hidden_acceleration_m_s2):
            return None
        if abs(off_m_s) < NEAR_M_S:
            self._confirmed_s = scan.stamp_s
        self._done_s = scan.stamp_s
        return off_m_s, measured.spread_m_s

    def _believed(self, off_m_s: float, now_s: float, hidden_acceleration_m_s2: float) -> bool:
        """Return whether a measurement is accepted; against a confirmed speed two must agree."""
        before_m_s, self._last_off_m_s = self._last_off_m_s, off_m_s
        if abs(off_m_s) < FAR_M_S or not np.isfinite(self._confirmed_s):
            return True
        possible_m_s = NEAR_M_S + hidden_acceleration_m_s2 * (now_s - self._confirmed_s)
        # Traffic that moves along gives too low a speed; fixtures never give too high a one.
        return abs(off_m_s - before_m_s) < FAR_M_S and -off_m_s < possible_m_s

    def contradicts(self, off_m_s: float, deviation_m_s: float) -> bool:
        """Return whether two unlikely differences in a row have the same sign.

        off_m_s, deviation_m_s: difference of the speed and its standard deviation.
        """
        before, self._last_deviations = self._last_deviations, off_m_s / deviation_m_s
        both_unlikely = min(abs(before), abs(self._last_deviations)) > UNLIKELY
        return both_unlikely and before * self._last_deviations > 0

    def confirmed(self, now_s: float) -> bool:
        """Return whether fixtures have recently confirmed the speed."""
        return now_s < self._confirmed_s + BELIEVED_S
