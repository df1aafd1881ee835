"""Clustering by growth within a constrained scan angle (Zhang 2022, section 2.1)."""

from __future__ import annotations

import numpy as np

from roadscope.core import wrap_angle
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import OUTLIER
from roadscope.detectors.clustering.union import join, root_of
from roadscope.detectors.sorting import order_by, starts_of

SPACINGS = 2.0
"""Neighbours on a face across the beam are one spacing apart; one lost return is bridged."""
MOST_SECTORS = 4096
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
    azimuths, ranges, reach = cloud.azimuths, cloud.ranges, SPACINGS * spacing(cloud)
    # Beyond this angle even the nearest return is out of reach; a hair more, for rounding.
    widest = 1e-9 + float(np.arcsin(min(1.0, eps_m / max(ranges.min(), eps_m) + reach)))
    angle = min(float(np.radians(angle_deg)), widest)
    sectors = int(min(2 * np.pi / angle, MOST_SECTORS))
    sectors = sectors if sectors > 2 else 1
    sector = ((azimuths / (2 * np.pi) + 0.5) * sectors).astype(np.int64) % sectors
    order = np.argsort(ranges, kind="stable")
    order = order[order_by(sector[order])]
    starts = np.searchsorted(sector[order], np.arange(sectors + 1))
    rule = float(eps_m), reach, angle
    sets = np.empty(len(cloud), np.int64)
    sets[order] = order[_linked(cloud.points[order], azimuths[order], ranges[order], starts, rule)]
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
def _linked(
    points: np.ndarray,
    azimuths: np.ndarray,
    ranges: np.ndarray,
    starts: np.ndarray,
    rule: tuple[float, float, float],
) -> np.ndarray:
    """Return for each of (N, 3) points one that stands for its component.

    Points are sorted by sector, then by range; starts (S + 1,): where each sector begins. A
    sector is as wide as the angle within which points are linked, so neighbouring ones suffice.
    """
    parents, sectors = np.arange(len(points)), len(starts) - 1
    polar = azimuths, ranges
    around = 1 if sectors > 2 else 0
    for sector in range(sectors):
        for shift in range(-around, around + 1):
            beside = (sector + shift) % sectors
            head, end = starts[beside], starts[beside + 1]
            for row in range(starts[sector], starts[sector + 1]):
                # Each pair is seen from its nearer point, whose range gives the limit.
                while head < end and ranges[head] < ranges[row]:
                    head += 1
                _link(polar, points, parents, (row, head, end), rule)
    for row in range(len(points)):
        parents[row] = root_of(parents, row)
    return parents


@compiled()
def _link(
    polar: tuple[np.ndarray, np.ndarray],
    points: np.ndarray,
    parents: np.ndarray,
    rows: tuple[int, int, int],
    rule: tuple[float, float, float],
) -> None:
    """Join a point with those of a sector from `first` on that satisfy eq. 1.

    polar: (N,) azimuths and ranges of the points.
    """
    azimuths, ranges = polar
    row, first, end = rows
    eps_m, reach, angle = rule
    limit = eps_m + reach * ranges[row]
    farthest = ranges[row] + limit * (1 + 1e-9)
    for other in range(first, end):
        if ranges[other] > farthest:
            break
        if parents[row] == parents[other]:
            continue
        turn = abs(azimuths[row] - azimuths[other])
        if min(turn, 2 * np.pi - turn) > angle:
            continue
        square = 0.0
        for axis in range(3):
            square += (points[row, axis] - points[other, axis]) ** 2
        if square <= limit * limit:
            join(parents, row, other)


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
