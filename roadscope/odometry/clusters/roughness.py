"""Edges and planes of each cluster, by how rough it is (Zhang 2022, section 2.2, eq. 6)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.clusters.segments import Segments
from roadscope.odometry.loam.feature_kernels import Sweep, sectors_of, sweep_of
from roadscope.odometry.loam.features import SECTORS, Features, Limits, cluster_roughness, extract

Reading = Literal["ring", "cluster"]
WINDOW_M = 0.15
"""Neighbours on the ring reach so far at least: close by, five of them lie within the noise."""
LEAST, MOST = 5, 64
"""Neighbours to each side; the fewest are LOAM's."""
NOISE_M = 0.03
"""Range noise that a VLP-16's data sheet admits."""
SMOOTH = 5e-3
"""Roughness between planes and edges, LOAM's."""
BY_RING = Limits(edge_above=1.0, plane_below=1.0)
BY_CLUSTER = Limits(edge_above=-np.inf, plane_below=np.inf)


def cluster_features(
    points: np.ndarray, segments: Segments, reading: Reading, *, sectors: bool
) -> Features:
    """Return the roughest and the smoothest returns of each cluster as edges and planes.

    points: (N, 3) metres, of all segments, deskewed. sectors: whether clusters are divided by
        LOAM's sectors of rings.

    Readings taken. The paper says a few of each cluster, whatever its size: with LOAM's numbers,
    2 and 4, a turn of clusters no wider than the search angle gives as many features as LOAM's
    sectors do. Clusters of any width are divided, so that a wall gives more than a post. `ring`
    sums eq. 6 over neighbours on the ring, also beyond the search angle, `cluster` over the whole
    cluster as it is printed.
    """
    sweep = sweep_of(points, segments.ring, segments.column)
    parts = SECTORS * (int(segments.ring.max(initial=0)) + 1) if sectors else 1
    part = sectors_of(sweep, SECTORS) if sectors else 0
    groups = np.where(segments.labels >= 0, segments.labels * parts + part, -1)
    if reading == "cluster":
        rough, limits = cluster_roughness(points, segments.labels), BY_CLUSTER
    else:
        rough = ring_roughness(sweep, segments.whole) / limit_of(points)
        limits = BY_RING
    found = extract(
        points, segments.ring, segments.column, groups, rough=rough, limits=limits, by_cluster=True
    )
    return replace(
        found, edge_labels=found.edge_labels // parts, plane_labels=found.plane_labels // parts
    )


def limit_of(points: np.ndarray) -> np.ndarray:
    """Return the roughness, (N,), above which a return is of an edge, and below which of a plane.

    LOAM's, but not less than two standard deviations of a range.
    """
    limits: np.ndarray = np.maximum(SMOOTH, 2 * NOISE_M / np.linalg.norm(points, axis=1))
    return limits


def ring_roughness(sweep: Sweep, labels: np.ndarray, window_m: float = WINDOW_M) -> np.ndarray:
    """Return c, (N,), eq. 6 over neighbours of the cluster on the ring, as many to either side.

    labels: (N,), the cluster. Neighbours are five, or as many as lie within the window of those
    that have more. nan where the cluster does not go on for five.
    """
    return _roughness(sweep.points.astype(float), sweep.ring, sweep.order, labels, window_m)


@compiled()
def _roughness(
    points: np.ndarray, ring: np.ndarray, order: np.ndarray, labels: np.ndarray, window_m: float
) -> np.ndarray:
    size, rough = len(order), np.full(len(points), np.nan)
    sums = np.zeros((size + 1, 3))
    for k in range(size):
        sums[k + 1] = sums[k] + points[order[k]]
    # Neighbours of one ring and one cluster have one number.
    own = labels * (ring.max() + 1) + ring if size else labels
    for k in range(size):
        before = _reach(points, own, order, (k, -1), window_m)
        after = _reach(points, own, order, (k, 1), window_m)
        beside, n = min(before, after), order[k]
        if beside < LEAST:
            continue
        square = 0.0
        for i in range(3):
            whole = sums[k + beside + 1, i] - sums[k - beside, i]
            square += (whole - (2 * beside + 1) * points[n, i]) ** 2
        x, y, z = points[n]
        rough[n] = np.sqrt(square / (x * x + y * y + z * z)) / (2 * beside)
    return rough


@compiled()
def _reach(
    points: np.ndarray, own: np.ndarray, order: np.ndarray, start: tuple[int, int], window_m: float
) -> int:
    """Return how many neighbours of one number are to one side, in the window or the first."""
    k, way = start
    n = order[k]
    for step in range(1, MOST + 1):
        other = k + way * step
        if not 0 <= other < len(order) or own[order[other]] != own[n]:
            return step - 1
        m, square = order[other], 0.0
        for i in range(3):
            square += (points[m, i] - points[n, i]) ** 2
        if step > LEAST and square > window_m * window_m:
            return step - 1
    return MOST
