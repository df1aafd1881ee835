"""What is used of a scan, free of the sensor's own motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.cloud_kernels import cubed, deskewed, thinned

BOUNDS_M = (1.5, 120.0)
"""Nearer is the own vehicle; farther, beams lie too far apart to tell a surface."""
ENOUGH = 500
"""Returns to be matched: a road has more of them at a cube's usual size, a room has not."""
CROWDED = 30
"""Returns of a scan for each of those in a room; who sends out few beams has few on roads too."""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A scan thinned to one return in each cube.

    scan: the whole. rows: (K,) of the returns kept. members: (N,) which of the K each return of
    the scan belongs to, or -1. few: rows of the K that are matched; all are put into the map.
    close: whether walls are so near all around that cubes of the usual size leave few returns of
        many: a room, or a corridor.
    """

    scan: LidarScan
    rows: np.ndarray
    members: np.ndarray
    few: np.ndarray
    close: bool

    @staticmethod
    def of(scan: LidarScan, insert_m: float, match_m: float) -> Sweep:
        """Thin a scan to cubes of two sizes, metres; where few are met, what is matched less."""
        rows, members = cubed(scan.points, insert_m, BOUNDS_M)
        few = thinned(scan.points[rows], match_m, BOUNDS_M)
        close = len(few) < min(ENOUGH, len(rows), len(scan) / CROWDED)
        while len(few) < min(ENOUGH, len(rows)) and match_m > insert_m:
            match_m /= 2
            few = thinned(scan.points[rows], match_m, BOUNDS_M)
        return Sweep(scan, rows, members, few, close)

    def at_stamp(self, twist: np.ndarray) -> np.ndarray:
        """Return (K, 3) points as seen at the stamp by a LiDAR that moves at a (6,) twist."""
        return deskewed(self.scan.points[self.rows], self.scan.time_offset_s[self.rows], twist)

    def spread(self, marks: np.ndarray) -> np.ndarray:
        """Return (N,) bool of the whole scan from (K,) of the returns kept."""
        if not len(marks):
            return np.zeros(len(self.members), bool)
        whole: np.ndarray = (self.members >= 0) & marks[self.members]
        return whole
