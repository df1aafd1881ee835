"""Clustering by growth within a constrained scan angle (Zhang 2022, section 2.1)."""

from __future__ import annotations

import numpy as np

from roadscope.core import wrap_angle
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import OUTLIER
from roadscope.detectors.clustering.polar_cells import Rule, linked_sets
from roadscope.detectors.sorting import starts_of

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
    with the linked components, whichever seeds are taken first.
    """
    for name, value in (("eps_m", eps_m), ("angle_deg", angle_deg), ("min_points", min_points)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive, got {value!r}")
    if not len(cloud):
        return np.empty(0, np.int64)
    reach = SPACINGS * spacing(cloud)
    # Beyond this angle even the nearest return is out of reach; a hair more, for rounding.
    nearest = max(float(cloud.ranges.min()), eps_m)
    widest = 1e-9 + float(np.arcsin(min(1.0, eps_m / nearest + reach)))
    rule = Rule(float(eps_m), reach, min(float(np.radians(angle_deg)), widest))
    sets = linked_sets(cloud.points, cloud.origin, cloud.ring, rule)
    return _large_ones(sets, min_points)


def spacing(cloud: Cloud) -> float:
    """Return the angle in radians between neighbouring returns, beams or columns, the wider.

    It is measured on the returns: neither the cloud nor the paper's input names the beams.
    """
    rises, ranges = np.diff(cloud.points[:, 2]), cloud.ranges
    beams = np.diff(cloud.ring)
    nearer = np.minimum(ranges[1:], ranges[:-1])
    upright = (np.diff(cloud.column) == 0) & (beams > 0) & (nearer > 0)
    upright &= np.abs(np.diff(ranges)) < UPRIGHT * nearer
    first = cloud.select(starts_of(cloud.column)[:-1])
    steps = np.abs(wrap_angle(np.diff(first.azimuths)))
    columns = np.abs(np.diff(first.column))
    found = (rises[upright] / beams[upright] / nearer[upright], steps / np.maximum(columns, 1))
    return max((float(np.median(angles)) for angles in found if len(angles)), default=0.0)


@compiled()
def _large_ones(sets: np.ndarray, min_points: int) -> np.ndarray:
    """Return labels by first appearance of sets of at least `min_points`, else `OUTLIER`."""
    counts, numbers = np.zeros(len(sets), np.int64), np.full(len(sets), OUTLIER)
    for item in sets:
        counts[item] += 1
    labels, found = np.full(len(sets), OUTLIER), 0
    for row in range(len(sets)):
        item = sets[row]
        if counts[item] < min_points:
            continue
        if numbers[item] == OUTLIER:
            numbers[item] = found
            found += 1
        labels[row] = numbers[item]
    return labels
