"""Returns that belong together: what a shape is fitted to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.shape.contour import by_cluster, outlines
from roadscope.detectors.sorting import starts_of


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
    """Split a cloud by its (N,) labels; negative ones are outliers and dropped.

    One at a time: thousands at once, as fog gives, would set off a long garbage collection.
    """
    rows = by_cluster(cloud, labels)
    points, ring, column = cloud.points[rows], cloud.ring[rows], cloud.column[rows]
    ends = starts_of(labels[rows]).tolist()
    for (i, j), outline in zip(pairwise(ends), outlines(cloud, labels, rows), strict=True):
        yield Cluster(points[i:j], ring[i:j], column[i:j], outline, cloud.origin)
