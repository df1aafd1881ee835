"""Whether a sensor that is being followed is as fast as what stands says."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.inertial.speed_search import Ends, standing_speed_of

SCANS, EVERY_S = 5, 0.5
FAR_M_S = 2.5
"""So far off is another world: that of the traffic."""


class SpeedCheck:
    """Looks once a second at a few scans by themselves, and again at once if they tell nothing."""

    def __init__(self) -> None:
        self._ends: list[Ends] = []
        self._speeds: list[float] = []
        self._done_s = -np.inf

    def off(self, scan: LidarScan, ahead_m_s: float, rate_rad_s: float) -> float | None:
        """Take a scan and what motion is held true; return how much faster it is, m/s.

        None where that is not clear, or was not looked at.
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
        if not seen.known:
            return None
        self._done_s = scan.stamp_s
        return seen.ahead_m_s - held_m_s
