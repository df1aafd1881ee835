"""Clustering by DBSCAN (Ester et al. 1996; Li 2021, section 3)."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import density_labels


def cluster_dbscan(cloud: Cloud, *, eps_m: float = 1.0, min_points: int = 5) -> np.ndarray:
    """Cluster by DBSCAN in the ground plane.

    Returns (N,) int64 labels, negative for outliers.

    In the plane and not in space: layers of one body grow apart with range, 0.8 deg are 1.4 m at
    100 m, while its columns stay close. Labels are those of scikit-learn's DBSCAN on x and y.
    Li 2021 prints no values. `eps_m` is that of the clustering `distance`. `min_points` counts
    the point itself: on a face across the beam at 100 m five columns of the LUX, 0.44 m apart,
    lie within 1 m of the middle one in every layer that meets it.
    """
    if not 0 < eps_m < np.inf:
        raise ValueError(f"eps_m must be a positive length in metres, got {eps_m!r}")
    if not min_points >= 1:
        raise ValueError(f"min_points must be at least 1, got {min_points!r}")
    return density_labels(cloud.points[:, :2], eps_m, min_points)
