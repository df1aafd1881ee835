"""Whether a sensor that is being followed is as fast as what stands says."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.inertial.speed_search import Ends, standing_speed_of

SCANS, EVERY_S = 5, 0.5
FAR_M_S = 2.5
"""So far off is another world: that of the traffic."""
NEAR_M_S, BELIEVED_S = 1.0, 2.0
"""A look so near confirms a speed; and that lasts for two looks."""
UNLIKELY = 3.0
"""Standard deviations of what is held and what is seen together."""


class SpeedCheck:
    """Looks once a second at a few scans by themselves, and again at once if they tell nothing.

    One look in some hundreds errs grossly, two in a row hardly by the same unless both see a wall
    that fades away along the road: where it does travels with the sensor, but is felt not to.
    """

    def __init__(self) -> None:
        self._ends: list[Ends] = []
        self._speeds: list[float] = []
        self._done_s, self._confirmed_s = -np.inf, -np.inf
        self._far_m_s, self._deviations = np.inf, 0.0

    def off(
        self,
        scan: LidarScan,
        ahead_m_s: float,
        rate_rad_s: float,
        unfelt_m_s2: float,
        least_m_s: float = -np.inf,
    ) -> tuple[float, float] | None:
        """Take a scan and what motion is held true; return how much faster it is, and how sure.

        Both m/s, the latter a standard deviation. None where that is not clear, or was not looked
        at. unfelt_m_s2: what acceleration may have gone unnoticed since the speed was confirmed.
        least_m_s: what looks slower moves along.
        """
        if scan.stamp_s < self._done_s + EVERY_S:
            return None
        self._ends.append(Ends.of(scan))
        self._speeds.append(ahead_m_s)
        if len(self._ends) < SCANS:
            return None
        seen = standing_speed_of(self._ends, rate_rad_s)
        held_m_s = float(np.mean(self._speeds))
        self._ends, self._speeds = [], []
        if not seen.known or seen.ahead_m_s < least_m_s:
            return None
        off_m_s = seen.ahead_m_s - held_m_s
        if not self._believed(off_m_s, scan.stamp_s, unfelt_m_s2):
            return None
        if abs(off_m_s) < NEAR_M_S:
            self._confirmed_s = scan.stamp_s
        self._done_s = scan.stamp_s
        return off_m_s, seen.spread_m_s

    def _believed(self, off_m_s: float, now_s: float, unfelt_m_s2: float) -> bool:
        """Say whether a look is; against a speed once confirmed it takes two that are possible."""
        before_m_s, self._far_m_s = self._far_m_s, off_m_s
        if abs(off_m_s) < FAR_M_S or not np.isfinite(self._confirmed_s):
            return True
        possible_m_s = NEAR_M_S + unfelt_m_s2 * (now_s - self._confirmed_s)
        # What moves along looks slower than it should; no fixture looks faster.
        return abs(off_m_s - before_m_s) < FAR_M_S and -off_m_s < possible_m_s

    def contradicts(self, off_m_s: float, deviation_m_s: float) -> bool:
        """Say whether two looks in a row are unlikely to one side: what is held is held too firmly.

        off_m_s, deviation_m_s: how much faster it is, and how much that is likely to be.
        """
        before, self._deviations = self._deviations, off_m_s / deviation_m_s
        sure = min(abs(before), abs(self._deviations)) > UNLIKELY
        return sure and before * self._deviations > 0

    def confirmed(self, now_s: float) -> bool:
        """Say whether what stands has lately told the speed that is held."""
        return now_s < self._confirmed_s + BELIEVED_S
