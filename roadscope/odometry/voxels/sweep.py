"""A scan thinned to cubes, and its deskewing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.cloud_kernels import cubed, deskewed, thinned

BOUNDS_M = (1.5, 120.0)
"""Nearer is the own vehicle; farther, beams are too far apart for surfaces. Chosen by hand."""
ENOUGH = 500
"""Least number of matched returns: roads have more at the usual size of cubes, rooms have not."""
CROWDED = 30
"""Ratio of all returns to matched ones in a room; sensors with few beams have few on roads too."""


@dataclass(frozen=True, slots=True, eq=False)
class ThinnedScan:
    """A scan thinned to one return in each cube.

    scan: the whole. rows: (K,) of the selected returns. members: (N,) number of the selected one
    in the cube of each return, or -1. matched_rows: rows of the K that are matched; all are added
    to the map. close: whether walls are near all around, so that few cubes contain many returns: a
    room or a corridor.
    """

    scan: LidarScan
    rows: np.ndarray
    members: np.ndarray
    matched_rows: np.ndarray
    close: bool

    @staticmethod
    def of(scan: LidarScan, insert_m: float, match_m: float) -> ThinnedScan:
        """Return a scan thinned to cubes of two sizes, metres; smaller ones if too few match."""
        rows, members = cubed(scan.points, insert_m, *BOUNDS_M)
        matched_rows = thinned(scan.points[rows], match_m, *BOUNDS_M)
        close = len(matched_rows) < min(ENOUGH, len(rows), len(scan) / CROWDED)
        while len(matched_rows) < min(ENOUGH, len(rows)) and match_m > insert_m:
            match_m /= 2
            matched_rows = thinned(scan.points[rows], match_m, *BOUNDS_M)
        return ThinnedScan(scan, rows, members, matched_rows, close)

    def at_stamp(self, twist: np.ndarray) -> np.ndarray:
        """Return (K, 3) points in the LiDAR's frame at the stamp, for a (6,) twist."""
        return deskewed(self.scan.points[self.rows], self.scan.time_offset_s[self.rows], twist)

    def spread(self, marks: np.ndarray) -> np.ndarray:
        """Return (N,) marks of the whole scan from (K,) marks of the selected returns."""
        if not len(marks):
            return np.zeros(len(self.members), bool)
        whole: np.ndarray = (self.members >= 0) & marks[self.members]
        return whole
