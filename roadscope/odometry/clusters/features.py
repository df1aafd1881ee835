"""Features of clusters, and dynamic clusters (Zhang 2022, section 2.2, eq. 4 and 6)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.clusters.segments import Segments
from roadscope.odometry.loam.features import (
    SECTORS,
    FeatureLimits,
    Features,
    RingOrderedScan,
    cluster_roughness,
    extract,
    sectors_of,
    sweep_of,
)

# --------------------------------------------------------------------------------------------------
# Edges and planes of each cluster, by how rough it is (Zhang 2022, section 2.2, eq. 6).

Reading = Literal["ring", "cluster"]
WINDOW_M = 0.15
"""Least extent of the neighbours on a ring: at close range, five of them lie within the noise."""
LEAST, MOST = 5, 64
"""Fewest and most neighbours on each side; the fewest are LOAM's."""
NOISE_M = 0.03
"""Range noise of a VLP-16 by its data sheet."""
SMOOTH = 5e-3
"""Roughness between planes and edges, LOAM's."""
BY_RING = FeatureLimits(edge_above=1.0, plane_below=1.0)
BY_CLUSTER = FeatureLimits(edge_above=-np.inf, plane_below=np.inf)
"""Limits of roughness that is divided by `limit_of`, and none for that of whole clusters."""


def cluster_features(
    points: np.ndarray, segments: Segments, reading: Reading, *, sectors: bool
) -> Features:
    """Return the roughest and the smoothest returns of each cluster as edges and planes.

    points: (N, 3) metres, of all segments, deskewed. sectors: whether clusters are divided by
        LOAM's sectors of rings.

    Our readings. The paper takes a few returns of each cluster, whatever its size. We take LOAM's
    numbers, 2 and 4: if clusters are no wider than the search angle, a full turn of them gives as
    many features as LOAM's sectors do. Clusters of any width are divided into sectors, so that a
    wall gives more features than a post. `ring` sums eq. 6 over neighbours on the ring, also beyond
    the search angle; `cluster` sums it over the whole cluster, as it is printed.
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
    features = extract(
        points, segments.ring, segments.column, groups, rough=rough, limits=limits, by_cluster=True
    )
    return replace(
        features,
        edge_labels=features.edge_labels // parts,
        plane_labels=features.plane_labels // parts,
    )


def limit_of(points: np.ndarray) -> np.ndarray:
    """Return the roughness, (N,), above which a return is of an edge, and below which of a plane.

    LOAM's, but not less than two standard deviations of a range.
    """
    limits: np.ndarray = np.maximum(SMOOTH, 2 * NOISE_M / np.linalg.norm(points, axis=1))
    return limits


def ring_roughness(
    sweep: RingOrderedScan, labels: np.ndarray, window_m: float = WINDOW_M
) -> np.ndarray:
    """Return c, (N,), eq. 6 over neighbours of the cluster on the ring, as many to either side.

    labels: (N,), the cluster. Five on each side are neighbours, and further ones that lie within
    the window. nan where the cluster has fewer than five on a side.
    """
    ring, order = sweep.ring, sweep.order
    # Returns of one ring and one cluster have the same number.
    own = labels * (ring.max(initial=0) + 1) + ring
    rough = np.full(len(order), np.nan)
    rough[order] = _roughness(sweep.points[order].astype(float), own[order], window_m)
    return rough


@compiled()
def _roughness(points: np.ndarray, own: np.ndarray, window_m: float) -> np.ndarray:
    """Return eq. 6 of points in the order of a sweep; own: (N,), equal among neighbours."""
    rough = np.full(len(points), np.nan)
    sums = np.zeros((len(points) + 1, 3))
    for k in range(len(points)):
        for i in range(3):
            sums[k + 1, i] = sums[k, i] + points[k, i]
    for k in range(len(points)):
        beside = _neighbours(points, own, k, -1, MOST, window_m)
        if beside >= LEAST:
            beside = _neighbours(points, own, k, 1, beside, window_m)
        if beside < LEAST:
            continue
        square = 0.0
        for i in range(3):
            whole = sums[k + beside + 1, i] - sums[k - beside, i]
            square += (whole - (2 * beside + 1) * points[k, i]) ** 2
        x, y, z = points[k]
        rough[k] = np.sqrt(square / (x * x + y * y + z * z)) / (2 * beside)
    return rough


@compiled()
def _neighbours(
    points: np.ndarray, own: np.ndarray, k: int, side: int, most: int, window_m: float
) -> int:
    """Return the number of neighbours in the same group to one side, at most so many.

    The first five count in any case, farther ones if they lie within the window.
    """
    for step in range(1, most + 1):
        m = k + side * step
        if not 0 <= m < len(own) or own[m] != own[k]:
            return step - 1
        if step > LEAST:
            dx, dy = points[m, 0] - points[k, 0], points[m, 1] - points[k, 1]
            dz = points[m, 2] - points[k, 2]
            if dx * dx + dy * dy + dz * dz > window_m * window_m:
                return step - 1
    return most


# --------------------------------------------------------------------------------------------------
# Matching clusters of two scans, and which of them move (Zhang 2022, eq. 4).

NO_PARTNER = -1
"""Partner of a cluster without a partner."""
REACH_M = 5.0
"""Greatest distance of a partner, as with features: predictions have smaller errors."""


@dataclass(frozen=True, slots=True, eq=False)
class ClusterMatch:
    """The clusters of a scan matched with those of the previous scan.

    partners: (K,) int64, cluster of the scan before; -1 where there is none.
    moved_m: (K,) float64, motion of the centre after ego-motion compensation, in space or from
        above as asked for; inf without a partner.
    dynamic: (K,) bool, moved farther than the threshold, or has no partner: walls that only one
        of the scans shows are dropped too, as the paper says.
    """

    partners: np.ndarray
    moved_m: np.ndarray
    dynamic: np.ndarray


def match_clusters(
    now: np.ndarray,
    before: np.ndarray,
    before_from_now: np.ndarray,
    thresholds_m: np.ndarray | float,
    *,
    dimensions: int = 3,
) -> ClusterMatch:
    """Compensate (K, 3) centres for ego motion (eq. 4) and match each with the nearest of before.

    before: (L, 3). thresholds_m: (K,) or one for all. One to one: the nearest of all pairs is taken
    first, then the nearest of the remaining ones, and so on: our reading of the paper's nearest
    neighbour iteration. dimensions: in which the motion of a centre is measured, 3 or 2 (x and y).
    """
    moved = now @ before_from_now[:3, :3].T + before_from_now[:3, 3]
    partners = one_to_one(moved, before, REACH_M)
    distances = np.full(len(now), np.inf)
    matched = partners != NO_PARTNER
    offsets = moved[matched] - before[partners[matched]]
    distances[matched] = np.linalg.norm(offsets[:, :dimensions], axis=1)
    return ClusterMatch(partners, distances, distances > thresholds_m)


@compiled()
def one_to_one(now: np.ndarray, before: np.ndarray, reach_m: float) -> np.ndarray:
    """Return for each of (K, 3) places the one of (L, 3) it is matched with, (K,) int64; or -1.

    The nearest pair of all is matched first, then the nearest of what is left, and so on; of equal
    pairs the first. No sorting is needed: two places that are each other's nearest among those left
    would be matched in any case before either could get another partner.
    """
    partners, sought = np.full(len(now), NO_PARTNER), np.ones(len(now), np.bool_)
    taken, changed = np.zeros(len(before), np.bool_), True
    theirs, ours = np.empty(len(now), np.int64), np.empty(len(before), np.int64)
    while changed:
        theirs[:], ours[:], changed = NO_PARTNER, NO_PARTNER, False
        _nearest(now, before, reach_m * reach_m, sought, taken, theirs, ours)
        for k in range(len(now)):
            sought[k] = sought[k] and theirs[k] != NO_PARTNER
            if sought[k] and ours[theirs[k]] == k:
                partners[k], taken[theirs[k]], sought[k], changed = theirs[k], True, False, True
    return partners


@compiled()
def _nearest(
    now: np.ndarray,
    before: np.ndarray,
    most: float,
    sought: np.ndarray,
    taken: np.ndarray,
    theirs: np.ndarray,
    ours: np.ndarray,
) -> None:
    """Write the nearest free place of the other set: for `now` to theirs, for `before` to ours.

    most: greatest squared distance. sought: (K,) bool, which of `now` are free. taken: (L,) bool,
    which of `before` are not.
    """
    least = np.full(len(before), most)
    for k in range(len(now)):
        if not sought[k]:
            continue
        shortest = most
        for j in range(len(before)):
            square = 0.0
            for i in range(3):
                square += (now[k, i] - before[j, i]) ** 2
            if taken[j] or not square <= most:
                continue
            if square < shortest or theirs[k] == NO_PARTNER:
                shortest, theirs[k] = square, j
            if square < least[j] or ours[j] == NO_PARTNER:
                least[j], ours[j] = square, k


# --------------------------------------------------------------------------------------------------
# Features of some clusters only, under the label of the same cluster in the scan before.


def of_partners(
    now: Features, before: Features, match: ClusterMatch, *, still_only: bool
) -> tuple[Features, Features]:
    """Return the features of clusters that both scans have, with the labels of the scan before.

    still_only: without clusters that are dynamic.
    """
    common = ~match.dynamic if still_only else match.partners != NO_PARTNER
    partners = np.where(common, match.partners, NO_PARTNER)
    return relabelled(now, partners), relabelled(before, _partner_labels(partners, before))


def relabelled(features: Features, labels: np.ndarray) -> Features:
    """Return features with other labels, (K,) by their own; without those that get -1."""
    edges, planes = labels[features.edge_labels], labels[features.plane_labels]
    sharp, flat = edges != NO_PARTNER, planes != NO_PARTNER
    return replace(
        features,
        edges=features.edges[sharp],
        edge_labels=edges[sharp],
        edge_rings=features.edge_rings[sharp],
        edge_rows=features.edge_rows[sharp],
        planes=features.planes[flat],
        plane_labels=planes[flat],
        plane_rings=features.plane_rings[flat],
        plane_rows=features.plane_rows[flat],
        sharp=int(sharp[: features.sharp].sum()),
        flat=int(flat[: features.flat].sum()),
    )


def _partner_labels(partners: np.ndarray, before: Features) -> np.ndarray:
    """Return for each label of the scan before: itself if it is a partner, else -1."""
    most = max(
        before.edge_labels.max(initial=-1),
        before.plane_labels.max(initial=-1),
        partners.max(initial=-1),
    )
    labels = np.full(most + 1, NO_PARTNER)
    labels[partners[partners != NO_PARTNER]] = partners[partners != NO_PARTNER]
    return labels
