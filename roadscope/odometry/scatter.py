"""Range noise of a scan."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan
from roadscope.core.jit import compiled
from roadscope.detectors.sorting import median_of

LARGEST_NOISE_M = 0.15
"""Greatest plausible range noise; data sheets state 0.02 to 0.03 m, and 0.1 m for a LUX."""
LEAST_TRIPLES = 200
"""Least number of second differences for an estimate. Chosen by hand."""
USED_RETURNS = 4000
"""About so many returns are used: those of every second ring, or third, and so on. Chosen by
hand."""
MEDIAN_OF_NORMAL = np.sqrt(6.0) * 0.6745
"""Median of absolute second differences of independent normal errors, in standard deviations of
these errors."""


def excessive_noise(scan: LidarScan) -> str:
    """Return a reason if ranges have more noise than a LiDAR's, otherwise an empty text.

    Most returns lie on surfaces that extend over three columns, with almost linear ranges: the
    median of second differences along the rings measures the noise.
    """
    deviation_m = range_noise_m(scan)
    return f"ranges scatter by {deviation_m:.2f} m" if deviation_m > LARGEST_NOISE_M else ""


def range_noise_m(scan: LidarScan) -> float:
    """Return the standard deviation of a scan's ranges, metres; 0 for too few returns."""
    every = max(1, len(scan) // USED_RETURNS)
    bends = _second_differences(scan.points, scan.ring, scan.column, every)
    return median_of(bends) / MEDIAN_OF_NORMAL if len(bends) >= LEAST_TRIPLES else 0.0


@compiled()
def _second_differences(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, every: int
) -> np.ndarray:
    """Return (T,) absolute second differences of ranges of equally spaced returns of a ring.

    every: one of that many rings is used, but at least four rings.
    """
    lowest = np.int64(ring.min()) if len(ring) else 0
    rings = np.int64(ring.max()) + 1 - lowest if len(ring) else 0
    step = max(1, min(every, int(rings) // 4))
    ranges, columns = np.full((rings, 2), np.nan), np.zeros((rings, 2), np.int64)
    bends, count = np.empty(len(ring)), 0
    for row in range(len(ring)):
        here, square = np.int64(ring[row]) - lowest, 0.0
        if here % step:
            continue
        for axis in range(3):
            square += points[row, axis] * points[row, axis]
        last, before = columns[here, 1], columns[here, 0]
        bend = abs(np.sqrt(square) - 2 * ranges[here, 1] + ranges[here, 0])
        # Comparisons with NaN, also for the first two returns of a ring, are false.
        place = np.int64(column[row])
        if place - last == last - before and place != last and bend < np.inf:
            bends[count] = bend
            count += 1
        ranges[here, 0], columns[here, 0] = ranges[here, 1], last
        ranges[here, 1], columns[here, 1] = np.sqrt(square), place
    return bends[:count]
