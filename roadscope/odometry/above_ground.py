"""Returns above the ground, and the height of the LiDAR above it."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.ground import polar_above_ground

BOUNDS_M = (0.5, 120.0)
"""Least and greatest range of the returns that are used, metres. Chosen by hand."""

NEAR_M, DEEPEST_M = 20.0, 5.0
"""The ground is searched within the first in range, and down to the second below the sensor. Chosen
by hand."""
BIN_M = 0.05
"""Thickness of the layers in which returns are counted. Chosen by hand."""
LEAST = 0.02
"""The ground is visible if at least this share of the counted returns is in two adjacent layers.
Chosen by hand."""


@compiled()
def sensor_height(points: np.ndarray) -> float:
    """Return the height of the LiDAR above the ground, metres; nan without visible ground.

    points: (N, 3) metres, lidar frame, z up to within a few degrees. The ground is the lowest
    pair of adjacent layers with at least half as many returns as the fullest pair.
    """
    bins = int(DEEPEST_M / BIN_M)
    counts, sums, low = np.zeros(bins + 1, np.int64), np.zeros(bins + 1), 0
    for n in range(len(points)):
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        if not (-DEEPEST_M < z < 0.0 and x * x + y * y < NEAR_M * NEAR_M):
            continue
        b = min(int(-z / BIN_M), bins - 1)
        counts[b] += 1
        sums[b] += z
        low += 1
    most = 0
    for b in range(bins):
        most = max(most, counts[b] + counts[b + 1])
    if most < LEAST * low or most == 0:
        return np.nan
    for back in range(bins):
        b = bins - 1 - back
        if 2 * (counts[b] + counts[b + 1]) >= most:
            # Returns of the ground fill more than a layer: the pair above may have more of them.
            if b > 0 and counts[b - 1] > counts[b + 1]:
                b -= 1
            mean: float = -(sums[b] + sums[b + 1]) / (counts[b] + counts[b + 1])
            return mean
    return np.nan


def standing(scan: LidarScan) -> Cloud:
    """Return the returns above the ground, lidar frame; all returns without visible ground.

    Ground by lines in polar segments (Himmelsbach 2010). Returns nearer or farther than the
    bounds, and those that are not finite, are left out; high objects are kept.
    """
    ranges = np.einsum("ni,ni->n", scan.points, scan.points)
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero((ranges >= BOUNDS_M[0] ** 2) & (ranges <= BOUNDS_M[1] ** 2))
    near = scan.select(rows)
    height_m = sensor_height(near.points)
    level = Pose.planar(0.0, 0.0, 0.0, height_m if np.isfinite(height_m) else 0.0)
    cloud = Cloud.of(near, level)
    if np.isfinite(height_m):
        cloud = cloud.select(polar_above_ground(cloud, ceiling_m=np.inf))
    lowered = cloud.points - level.translation
    return Cloud(lowered, cloud.ring, cloud.column, rows[cloud.rows], cloud.origin)
