"""Grid clustering with automatic parameters, PAG (Lu 2018, section 2.1; Qiu and Zhang 2006)."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import binary_dilation, label

from roadscope.detectors.cloud import Cloud


def cluster_pag(cloud: Cloud) -> np.ndarray:
    """Cluster by PAG (Lu 2018), which has no parameter.

    Returns (N,) int64 labels, -1 for returns that are dropped.
    """
    return pag_labels(cloud.points[:, :2], np.ones(len(cloud)))


def cluster_pag_range(cloud: Cloud) -> np.ndarray:
    """Cluster by PAG with every return counted in proportion to its range.

    A body twice as far returns half as many columns, so plain counting calls distant vehicles
    sparse. Not in the paper. Returns (N,) int64 labels, -1 for returns that are dropped.
    """
    return pag_labels(cloud.points[:, :2], cloud.ranges)


def pag_labels(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Cluster (N, 2) points, metres, with (N,) weights above 0: (N,) int64 labels.

    The grid has K x K cells (eq. 1, K rounded down) over the bounding box of the data: over the
    sensor's full range nearly everything would fall into a few cells.
    """
    if not len(points):
        return np.empty(0, np.int64)
    K = math.isqrt(len(points))
    low = points.min(axis=0)
    extent = points.max(axis=0) - low
    cells = np.minimum((points - low) / np.where(extent > 0, extent, 1.0) * K, K - 1).astype(int)
    flat = cells[:, 0] * K + cells[:, 1]
    counts = np.bincount(flat, weights, K * K).reshape(K, K)
    occupied = np.bincount(flat, minlength=K * K).reshape(K, K) > 0
    return np.asarray(label_cells(counts, occupied).ravel()[flat])


def density_threshold(total: float, grid_num: int) -> float:
    """Return MinPts (eq. 2), the weight of a cell above which it is dense.

    total: weight of all points. grid_num: cells that hold any.

    Both averages in eq. 2 run over the same arithmetic sequence and equal Max - N(N - 1)/2, so
    their quotient is 1 and MinPts is C = Num / Gridnum. For Max below 4, N = 1 and the average
    of no B_m is 0/0: the same limit is taken there.
    """
    return total / grid_num


def label_cells(counts: np.ndarray, occupied: np.ndarray) -> np.ndarray:
    """Join dense cells of a (K, K) grid into clusters: (K, K) int64 labels, -1 for none.

    counts: (K, K) float64, weight of the points in a cell. occupied: (K, K) bool, whether it has
    any.
    A cell is dense above MinPts. A sparse cell beside a dense one (8 neighbours) joins it, once:
    joined cells do not draw in further sparse ones. Connected cells form a cluster.
    """
    dense = counts > density_threshold(float(counts.sum()), int(occupied.sum()))
    around = np.ones((3, 3), bool)
    joined = occupied & binary_dilation(dense, around)
    labels: np.ndarray = label(joined, around)[0].astype(np.int64) - 1
    return labels
