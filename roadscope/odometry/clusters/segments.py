"""A scan without its ground, in clusters (Zhang 2022, section 2.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import LidarScan
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.range_angle import (
    SPACINGS,
    TURN_ERROR,
    cluster_range_angle,
    quick_azimuth,
)
from roadscope.odometry.above_ground import standing
from roadscope.odometry.loam.progress import ScanReturns

# --------------------------------------------------------------------------------------------------
# Clustering (Zhang 2022, section 2.1, first half).


@dataclass(frozen=True, slots=True)
class Clustering:
    """The paper's parameters (table 1).

    eps_m: part of the distance of two neighbouring returns that is noise. The printed 0.02 m
        cannot be the whole distance, see `cluster_range_angle`.
    angle_deg: the search angle, which bounds links here; `parts` cuts clusters by it.
    min_points: clusters of fewer are outliers.
    spacings: by how many spacings of the returns epsilon grows with range; 0: as printed.
    """

    eps_m: float = 0.02
    angle_deg: float = 5.0
    min_points: int = 30
    spacings: float = SPACINGS

    def labels(self, cloud: Cloud) -> np.ndarray:
        """Return the cluster of each return that stands above the ground, (N,); or negative."""
        return cluster_range_angle(
            cloud,
            eps_m=self.eps_m,
            angle_deg=self.angle_deg,
            min_points=self.min_points,
            spacings=self.spacings,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Segments(ScanReturns):
    """Returns that stand above the ground, in clusters.

    centres: (K, 3) float64, mean of each cluster's points (eq. 2).
    sizes: (K,) int64, how many points each has.
    whole: (N,) int64, labels of clusters that the search angle did not cut.
    """

    centres: np.ndarray
    sizes: np.ndarray
    whole: np.ndarray


def segments_of(scan: LidarScan, clustering: Clustering) -> Segments:
    """Return the clusters of a scan without its ground; returns that are not finite are left out.

    The ground is found by Himmelsbach 2010, as in the paper; the height of the sensor is estimated
    from the scan. High objects are kept: here they are as useful as walls.
    """
    cloud = standing(scan)
    # Outliers carry other negative labels too in clusterings.
    labels = np.maximum(clustering.labels(cloud), -1)
    times_s = scan.time_offset_s[cloud.rows].astype(float)
    centres, sizes = centres_of(cloud.points, labels)
    return Segments(
        cloud.points, cloud.ring, cloud.column, times_s, cloud.rows, labels, centres, sizes, labels
    )


def centres_of(points: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean, (K, 3), of the points of each label from 0 on (eq. 2), and their numbers."""
    inside = labels >= 0
    known, place = labels[inside], points[inside]
    sizes = np.bincount(known)
    sums = np.column_stack([np.bincount(known, place[:, i], len(sizes)) for i in range(3)])
    return sums / np.maximum(sizes, 1)[:, None], sizes


# --------------------------------------------------------------------------------------------------
# Clusters cut by the search angle, in two scans alike (Zhang 2022, section 2.1).

EDGE = 2 * TURN_ERROR
"""Sine of the angle to the edge of a window below which the azimuth must be computed."""


def parts(segments: Segments, angle_deg: float, before_from_now: np.ndarray) -> Segments:
    """Return the clusters cut into windows of the angle, from the position of the previous scan.

    before_from_now: (4, 4), as predicted; the identity for the scan before itself.

    Our reading: the paper's search angle bounds a cluster, and any return may begin one. Clusters
    of two scans should be the same pieces of a wall, with centres that stay where they are while
    the sensor moves. Therefore a full turn is divided into windows of that angle, from straight
    behind on, around the same place in both scans. A part may have fewer than `min_points` points;
    its cluster has as many.
    """
    count = int(np.ceil(360.0 / angle_deg - 1e-9))
    labels, sums, sizes = _cut(segments.points, segments.whole, before_from_now, count)
    return replace(segments, labels=labels, centres=sums / sizes[:, None], sizes=sizes)


@compiled()
def _cut(
    points: np.ndarray, whole: np.ndarray, motion: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the part of each point, (N,) int64, numbered in order; -1 for outliers.

    Also the sum of the points of each part, (K, 3), and their number, (K,) int64.
    """
    capacity = (whole.max() + 1) * count if len(whole) else 0
    numbers, part_count = np.full(capacity, -1), 0
    labels, sums, sizes = (
        np.full(len(whole), -1),
        np.zeros((capacity, 3)),
        np.zeros(capacity, np.int64),
    )
    window, first, last = -1, (0.0, 0.0), (0.0, 0.0)
    for n in range(len(whole)):
        if whole[n] < 0:
            continue
        x, y = motion[0, 3], motion[1, 3]
        for i in range(3):
            x += motion[0, i] * points[n, i]
            y += motion[1, i] * points[n, i]
        # Most points are in the window of the previous one, which two products show.
        beside = EDGE * (abs(x) + abs(y))
        if not (first[0] * y - first[1] * x > beside and last[1] * x - last[0] * y > beside):
            window = int((quick_azimuth(x, y) / (2 * np.pi) + 0.5) * count) % count
            first, last = _window_start(window, count), _window_start(window + 1, count)
        place = whole[n] * count + window
        if numbers[place] < 0:
            numbers[place] = part_count
            part_count += 1
        part = numbers[place]
        labels[n] = part
        sizes[part] += 1
        for i in range(3):
            sums[part, i] += points[n, i]
    return labels, sums[:part_count].copy(), sizes[:part_count].copy()


@compiled(borrowing=True)
def _window_start(window: int, count: int) -> tuple[float, float]:
    """Return the direction at which a window begins; zeros if windows are half a turn or wider."""
    if count <= 2:
        return 0.0, 0.0
    angle = 2 * np.pi * (window / count - 0.5)
    return np.cos(angle), np.sin(angle)
