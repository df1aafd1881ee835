"""Clusters of returns, and their outlines as the sensor measures them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.core import wrap_angle
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.sorting import order_by, order_within, starts_of

# --------------------------------------------------------------------------------------------------
# The outline of a cluster.

DEPTH_M = 0.6
"""Returns up to this far behind the nearest one of a column may lie on the same face: three
standard deviations of the LUX's range noise to either side."""


def contours(cloud: Cloud, labels: np.ndarray) -> list[np.ndarray]:
    """Return the outline of each cluster, (M, 2) points in order of azimuth.

    labels: (N,) int64, negative for none. Outlines are in metres, ego frame, by rising label,
    from right to left as the sensor sees them.

    Lu 2018 takes points (x, y) in the order of the scan and does not say how the four layers are
    combined. Here a column gives one point, at the median range of the cluster's returns on the
    face nearest to the sensor. What is behind that face, such as a windscreen or a roof, is no part
    of the outline.
    """
    return outlines(cloud, labels, by_cluster(cloud, labels))


def by_cluster(cloud: Cloud, labels: np.ndarray) -> np.ndarray:
    """Return the rows, (K,) int64, with labels (N,) from 0 up, sorted by label, then by column."""
    member = np.flatnonzero(labels >= 0)
    member = member[order_by(cloud.column[member])]
    return np.asarray(member[order_by(labels[member])])


def outlines(cloud: Cloud, labels: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Return the outline of each cluster, as `contours` does.

    labels: (N,) int64. rows: (K,) int64, what `by_cluster` returns for them.
    """
    if not len(rows):
        return []
    label, column = labels[rows], cloud.column[rows]
    places = cloud.points[rows, :2]
    x, y = places.T - cloud.origin[:, None]
    ranges = np.hypot(x, y)
    columns = starts_of(label, column)
    order = order_within(ranges, columns)
    ranges, starts = ranges[order], columns[:-1]
    face = ranges <= np.repeat(ranges[starts], np.diff(columns)) + DEPTH_M
    counts = np.add.reduceat(face.astype(np.int64), starts)
    # Rows are sorted by range within a column: the face comes first, its median in its middle.
    lower, upper = order[starts + (counts - 1) // 2], order[starts + counts // 2]
    points = (places[lower] + places[upper]) / 2
    return _by_azimuth(points, starts_of(label[starts]), cloud.origin)


def _by_azimuth(points: np.ndarray, starts: np.ndarray, origin: np.ndarray) -> list[np.ndarray]:
    """Split into clusters, each sorted by azimuth from the origin, then by x and y.

    Azimuths are relative to the middle of a cluster, so that the step from pi to -pi does not
    matter.
    """
    counts = np.diff(starts)
    x, y = (points - origin).T
    middle_x, middle_y = np.add.reduceat(x, starts[:-1]), np.add.reduceat(y, starts[:-1])
    middle = np.repeat(np.arctan2(middle_y / counts, middle_x / counts), counts)
    azimuths = wrap_angle(np.arctan2(y, x) - middle)
    order = order_within(azimuths, starts)
    same = azimuths[order[1:]] == azimuths[order[:-1]]
    same[starts[1:-1] - 1] = False
    if same.any():
        order = np.lexsort((y, x, azimuths, np.repeat(np.arange(len(counts)), counts)))
    ordered, ends = points[order], starts.tolist()
    return [ordered[i:j] for i, j in pairwise(ends)]


# --------------------------------------------------------------------------------------------------
# Clusters: the returns to which a shape is fitted.


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """One cluster of a scan.

    points: (N, 3) float64, metres, ego frame, sorted by column.
    ring, column: (N,) int64, beam and azimuth step of each return.
    outline: (M, 2) float64, metres, the face that is turned to the sensor, one point a column in
        order of azimuth.
    origin: (2,) float64, metres, the sensor in the ego frame.
    """

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    outline: np.ndarray
    origin: np.ndarray


def clusters(cloud: Cloud, labels: np.ndarray) -> Iterator[Cluster]:
    """Yield the clusters of a cloud with (N,) labels; negative labels are outliers and dropped.

    They are made one by one: thousands at once, as in fog, would start a long garbage collection.
    """
    rows = by_cluster(cloud, labels)
    points, ring, column = cloud.points[rows], cloud.ring[rows], cloud.column[rows]
    ends = starts_of(labels[rows]).tolist()
    for (i, j), outline in zip(pairwise(ends), outlines(cloud, labels, rows), strict=True):
        yield Cluster(points[i:j], ring[i:j], column[i:j], outline, cloud.origin)


@compiled()
def diagonal(points: np.ndarray) -> float:
    """Return the diagonal of the box, along x and y, around points (N, 2 or 3), N at least 1."""
    x, y = points[0, 0], points[0, 1]
    left, right, low, high = x, x, y, y
    for i in range(1, len(points)):
        x, y = points[i, 0], points[i, 1]
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return float(np.hypot(right - left, high - low))
