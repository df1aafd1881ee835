"""How far the returns of a scan scatter along the beam."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan
from roadscope.core.jit import compiled
from roadscope.detectors.sorting import median_of

MOST_M = 0.15
"""Data sheets tell .02 to .03 m, of a LUX .1: more than half as much again is a fault."""
LEAST_TRIPLES = 200
"""Fewer tell nothing."""
ENOUGH = 4000
"""About so many returns are looked at: those of every second ring, or third, and so on."""
OF_NORMAL = np.sqrt(6.0) * 0.6745
"""Median of a second difference of independent normal errors, in their standard deviation."""


def scattered(scan: LidarScan) -> str:
    """Say so where ranges scatter by far more than LiDARs' do; empty where they do not.

    Most returns lie on faces that go on for three columns, where ranges hardly bend: the median of
    second differences along the rings tells their noise.
    """
    found_m = scatter_m(scan)
    return f"ranges scatter by {found_m:.2f} m" if found_m > MOST_M else ""


def scatter_m(scan: LidarScan) -> float:
    """Return the standard deviation of a scan's ranges, metres; 0 where too few returns tell it."""
    bends = _bends(scan.points, scan.ring, scan.column, max(1, len(scan) // ENOUGH))
    return median_of(bends) / OF_NORMAL if len(bends) >= LEAST_TRIPLES else 0.0


@compiled()
def _bends(points: np.ndarray, ring: np.ndarray, column: np.ndarray, every: int) -> np.ndarray:
    """Return (T,) second differences of ranges of three returns of a ring, as far apart each.

    every: of so many rings one is looked at, but of four at least.
    """
    lowest = np.int64(ring.min()) if len(ring) else 0
    rings = np.int64(ring.max()) + 1 - lowest if len(ring) else 0
    step = max(1, min(every, int(rings) // 4))
    ranges, columns = np.full((rings, 2), np.nan), np.zeros((rings, 2), np.int64)
    bends, found = np.empty(len(ring)), 0
    for row in range(len(ring)):
        here, square = np.int64(ring[row]) - lowest, 0.0
        if here % step:
            continue
        for axis in range(3):
            square += points[row, axis] * points[row, axis]
        last, before = columns[here, 1], columns[here, 0]
        bend = abs(np.sqrt(square) - 2 * ranges[here, 1] + ranges[here, 0])
        # What has no numbers, and a ring's first two returns, compare as false.
        place = np.int64(column[row])
        if place - last == last - before and place != last and bend < np.inf:
            bends[found] = bend
            found += 1
        ranges[here, 0], columns[here, 0] = ranges[here, 1], last
        ranges[here, 1], columns[here, 1] = np.sqrt(square), place
    return bends[:found]
