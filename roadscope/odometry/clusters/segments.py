"""A scan without its ground, in clusters (Zhang 2022, section 2.1, first half)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.range_angle import cluster_range_angle
from roadscope.odometry.above_ground import standing
from roadscope.odometry.loam.returns import Returns


@dataclass(frozen=True, slots=True, eq=False)
class Clustering:
    """The paper's parameters (table 1).

    eps_m: what noise adds to two neighbouring returns' distance. The printed 0.02 m cannot be
        the whole distance, see `cluster_range_angle`.
    angle_deg: the search angle, which bounds links here; `parts` cuts clusters by it.
    min_points: clusters of fewer are outliers.
    """

    eps_m: float = 0.02
    angle_deg: float = 5.0
    min_points: int = 30

    def labels(self, cloud: Cloud) -> np.ndarray:
        """Return the cluster of each return that stands above the ground, (N,); or negative."""
        return cluster_range_angle(
            cloud, eps_m=self.eps_m, angle_deg=self.angle_deg, min_points=self.min_points
        )


@dataclass(frozen=True, slots=True, eq=False)
class Segments(Returns):
    """Returns that stand above the ground, in clusters.

    centres: (K, 3) float64, mean of each cluster's points (eq. 2).
    sizes: (K,) int64, how many points each has.
    whole: (N,) int64, labels of clusters that the search angle did not cut.
    """

    centres: np.ndarray
    sizes: np.ndarray
    whole: np.ndarray


def segments_of(scan: LidarScan, clustering: Clustering) -> Segments:
    """Remove the ground and cluster what is left; returns that are no numbers are left out.

    The ground is found by Himmelsbach 2010, as in the paper; how high the sensor stands above it
    is read from the scan. What hangs high is kept: here it is as good as walls.
    """
    cloud = standing(scan)
    # Outliers carry other negative labels too in clusterings.
    labels = np.maximum(clustering.labels(cloud), -1)
    times_s = scan.time_offset_s[cloud.rows].astype(float)
    centres, sizes = centres_of(cloud.points, labels)
    return Segments(
        cloud.points, cloud.ring, cloud.column, times_s, cloud.rows, labels, centres, sizes,
        labels,
    )  # fmt: skip


def centres_of(points: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean, (K, 3), of the points of each label from 0 on (eq. 2), and their numbers."""
    inside = labels >= 0
    known, place = labels[inside], points[inside]
    sizes = np.bincount(known)
    sums = np.column_stack([np.bincount(known, place[:, i], len(sizes)) for i in range(3)])
    return sums / np.maximum(sizes, 1)[:, None], sizes
