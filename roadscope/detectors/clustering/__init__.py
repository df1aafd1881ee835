"""Clusterings by name: which returns belong together."""

from collections.abc import Callable, Mapping

import numpy as np

from roadscope._lazy import lazy_names
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.breakpoint import cluster_breakpoint
from roadscope.detectors.clustering.density import (
    OUTLIER,
    cluster_dbscan,
    cluster_distance,
    density_labels,
    single_linkage,
)
from roadscope.detectors.clustering.pag import cluster_pag, cluster_pag_range
from roadscope.detectors.clustering.range_angle import cluster_range_angle

Clustering = Callable[[Cloud], np.ndarray]
"""Cloud of N returns -> (N,) int64 labels, negative for outliers."""


def cluster_one(cloud: Cloud) -> np.ndarray:
    """Put all returns into one cluster, as a lower mark.

    Returns (N,) int64 labels, all 0.
    """
    return np.zeros(len(cloud), np.int64)


CLUSTERINGS: Mapping[str, Callable[..., np.ndarray]] = {
    "pag": cluster_pag,
    "pag-range": cluster_pag_range,
    "distance": cluster_distance,
    "breakpoint": cluster_breakpoint,
    "dbscan": cluster_dbscan,
    "range-angle": cluster_range_angle,
    "one": cluster_one,
}
"""Name -> a `Clustering`; keyword arguments beyond the cloud are its options."""

__all__ = [
    "CLUSTERINGS",
    "OUTLIER",
    "Clustering",
    "cluster_breakpoint",
    "cluster_dbscan",
    "cluster_distance",
    "cluster_one",
    "cluster_pag",
    "cluster_pag_range",
    "cluster_range_angle",
    "density_labels",
    "single_linkage",
]

_PARTS = {
    "breakpoint": "INCIDENCE_RAD MAX_STEPS reach",
    "pag": "density_threshold label_cells pag_labels",
    "range_angle": "SPACINGS TURN_ERROR quick_azimuth spacing",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
