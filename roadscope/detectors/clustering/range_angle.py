"""Clustering by growth within a constrained scan angle (Zhang 2022, section 2.1)."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import OUTLIER
from roadscope.detectors.clustering.polar_cells import Rule, linked_sets
from roadscope.detectors.sorting import median_of

SPACINGS = 2.0
"""Neighbours on a face across the beam are one spacing apart; one lost return is bridged."""
UPRIGHT = 0.05
"""Two returns of a column whose ranges differ by less than this share lie on an upright face."""


def cluster_range_angle(
    cloud: Cloud, *, eps_m: float = 0.02, angle_deg: float = 5.0, min_points: int = 30
) -> np.ndarray:
    """Grow clusters within a scan angle (Zhang 2022).

    Returns (N,) int64 labels, negative where a cluster has fewer than `min_points`.

    LiDAR returns nearer than or at epsilon in space (eq. 1), and within `angle_deg` of one
    another as the sensor turns, are linked.

    Readings taken. The printed epsilon of 0.02 m is less than the gap between two beams of the
    paper's VLP-16 from 0.6 m on and between two columns from 6 m on; here it is what noise adds
    to two spacings of the returns at the lesser of the two ranges, where the spacing is the
    wider of those between beams and between columns. The paper grows from a seed and then from
    the farthest returns in six directions until no return satisfies eq. 1 any more; that ends
    with the linked components, whichever seeds are taken first. The angle bounds links: a cluster
    goes on as long as returns follow one another. Zhang 2022's odometry cuts it by the angle.
    """
    for name, value in (("eps_m", eps_m), ("angle_deg", angle_deg), ("min_points", min_points)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive, got {value!r}")
    if not len(cloud):
        return np.empty(0, np.int64)
    reach = SPACINGS * spacing(cloud)
    # Beyond this angle even the nearest return is out of reach; a hair more, for rounding.
    nearest = max(float(_least_range(cloud.points, cloud.origin)), eps_m)
    share = eps_m / nearest + reach
    widest = np.pi if share >= 1.0 else 1e-9 + float(np.arcsin(share))
    angle = float(np.radians(angle_deg))
    within = min(angle, widest)
    cosine = float(np.cos(within)) if within < np.pi else -2.0
    rule = Rule(float(eps_m), reach, within, cosine)
    sets = linked_sets(cloud.points, cloud.origin, cloud.ring, rule)
    return _large_ones(sets, min_points)


def spacing(cloud: Cloud) -> float:
    """Return the angle in radians between neighbouring returns, beams or columns, the wider.

    It is measured on the returns: neither the cloud nor the paper's input names the beams.
    """
    return float(_spacing(cloud.points, cloud.ring, cloud.column, cloud.origin))


@compiled()
def _least_range(points: np.ndarray, origin: np.ndarray) -> float:
    """Return the horizontal distance of the nearest of (N, 3) points, metres."""
    least = np.inf
    for row in range(len(points)):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        least = min(least, x * x + y * y)
    return float(np.sqrt(least))


@compiled()
def _spacing(points: np.ndarray, ring: np.ndarray, column: np.ndarray, origin: np.ndarray) -> float:
    """Return the greater of two medians: of angles between beams and between columns."""
    rises, steps = np.empty(len(ring)), np.empty(len(ring))
    upright, turns, azimuth, opener = 0, 0, 0.0, -1
    here = 0.0
    for row in range(len(ring)):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        last, here = here, np.sqrt(x * x + y * y)
        if row == 0 or column[row] != column[row - 1]:
            before, azimuth = azimuth, np.arctan2(y, x)
            if opener >= 0:
                turn = abs((azimuth - before + np.pi) % (2 * np.pi) - np.pi)
                steps[turns] = turn / max(abs(column[row] - column[opener]), 1)
                turns += 1
            opener = row
        elif ring[row] > ring[row - 1]:
            nearer = min(here, last)
            if nearer > 0 and abs(here - last) < UPRIGHT * nearer:
                beams = ring[row] - ring[row - 1]
                rises[upright] = (points[row, 2] - points[row - 1, 2]) / beams / nearer
                upright += 1
    widest = 0.0
    if upright:
        widest = max(widest, median_of(rises[:upright]))
    if turns:
        widest = max(widest, median_of(steps[:turns]))
    return float(widest)


@compiled()
def _large_ones(sets: np.ndarray, min_points: int) -> np.ndarray:
    """Return labels by first appearance of sets of at least `min_points`, else `OUTLIER`."""
    counts, labels, found = np.zeros(len(sets), np.int64), np.empty(len(sets), np.int64), 0
    for item in sets:
        counts[item] += 1
    for row in range(len(sets)):
        item = sets[row]
        if counts[item] >= min_points:
            # From here on it is the number of the cluster that is kept, below all counts.
            counts[item] = -1 - found
            found += 1
        labels[row] = -1 - counts[item] if counts[item] < 0 else OUTLIER
    return labels
