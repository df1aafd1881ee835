"""Clustering by a fixed distance threshold: the comparison method of Lu 2018."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import density_labels


def cluster_distance(cloud: Cloud, *, distance_m: float = 1.0) -> np.ndarray:
    """Link returns nearer than or at a distance, 1 m, in the ground plane.

    Returns (N,) int64 labels, none negative; `distance_m` is the distance.

    1 m is above the spacing of LUX columns on a face across the beam at full range (0.87 m at
    200 m) and below the gap between vehicles in neighbouring lanes (3.5 m less 1.9 m of width).
    """
    return single_linkage(cloud.points[:, :2], distance_m)


def single_linkage(points: np.ndarray, distance: float) -> np.ndarray:
    """Label the connected components of (N, 2) points linked up to `distance`, (N,) int64.

    points, distance: of one unit. No link is missed.
    That is DBSCAN with every point a core point.
    """
    return density_labels(points, distance, 1)
