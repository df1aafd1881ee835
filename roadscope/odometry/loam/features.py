"""Edges and planes of a scan by roughness (Zhang and Singh 2017; Zhang 2022, eq. 6)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.sorting import stable_order
from roadscope.odometry.cloud_kernels import thinned

# --------------------------------------------------------------------------------------------------
# Roughness along rings, and the choice of features.

JUMP = 0.1
"""A return farther than its neighbour by this share of the nearer range is behind an edge."""
ADJACENT = 10
"""Greatest number of columns between two returns of which the nearer may hide a part of the farther
surface."""
GRAZING = 0.97
"""Cosine of the angle to the beam, 14 deg, below which a surface is nearly parallel to it."""
SAME_M = 0.25
"""Neighbours along a ring that lie farther apart than this belong to different surfaces."""


class RingOrderedScan(NamedTuple):
    """A scan ring by ring.

    points: (N, 3) metres. ring, column: (N,). order: (N,) int64 rows, by ring, then by column.
    """

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    order: np.ndarray


def sweep_of(points: np.ndarray, ring: np.ndarray, column: np.ndarray) -> RingOrderedScan:
    """Return a scan ring by ring."""
    return RingOrderedScan(points, ring, column, ring_order(ring, column))


@compiled()
def ring_order(ring: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return the rows, (N,) int64, ring by ring, by column within a ring."""
    starts = np.zeros(ring.max() + 2 if len(ring) else 1, np.int64)
    for n in range(len(ring)):
        starts[ring[n] + 1] += 1
    starts = np.cumsum(starts)
    order = np.empty(len(ring), np.int64)
    for n in range(len(ring)):
        order[starts[ring[n]]] = n
        starts[ring[n]] += 1
    for k in range(1, len(order)):
        a, b = order[k - 1], order[k]
        if ring[a] == ring[b] and column[a] > column[b]:
            keys = ring.astype(np.int64) * (np.int64(column.max()) + 1) + column
            return stable_order(keys)
    return order


@compiled()
def roughness_along(sweep: RingOrderedScan, neighbours: int) -> np.ndarray:
    """Return (N,) roughness among that many neighbours on each side; nan at the ends of a ring."""
    points, ring, order = sweep.points, sweep.ring, sweep.order
    rough = np.full(len(points), np.nan)
    for k in range(neighbours, len(order) - neighbours):
        n = order[k]
        if ring[order[k - neighbours]] != ring[n] or ring[order[k + neighbours]] != ring[n]:
            continue
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        sx = sy = sz = 0.0
        for other in range(k - neighbours, k + neighbours + 1):
            m = order[other]
            sx += points[m, 0] - x
            sy += points[m, 1] - y
            sz += points[m, 2] - z
        reach = np.sqrt(x * x + y * y + z * z)
        rough[n] = np.sqrt(sx * sx + sy * sy + sz * sz) / (2 * neighbours * reach)
    return rough


@compiled()
def unreliable(sweep: RingOrderedScan, neighbours: int) -> np.ndarray:
    """Return (N,) whether a return is beside an occlusion or on a surface along the beam."""
    points, ring, column, order = sweep
    bad, along_before = np.zeros(len(points), np.bool_), False
    for k in range(1, len(order)):
        n, m = order[k - 1], order[k]
        if ring[n] != ring[m]:
            along_before = False
            continue
        rn, rm = _norm(points[n]), _norm(points[m])
        along = abs(rn - rm) > GRAZING * _distance(points[n], points[m])
        bad[n] |= along and along_before
        along_before = along
        if column[m] - column[n] > ADJACENT or abs(rn - rm) <= JUMP * min(rn, rm):
            continue
        for step in range(neighbours + 1):
            other = k - 1 - step if rn > rm else k + step
            if not 0 <= other < len(order) or ring[order[other]] != ring[n]:
                break
            bad[order[other]] = True
    return bad


@compiled()
def _norm(point: np.ndarray) -> float:
    x, y, z = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    return math.sqrt(x * x + y * y + z * z)


@compiled()
def _distance(a: np.ndarray, b: np.ndarray) -> float:
    x, y, z = np.float64(a[0]) - b[0], np.float64(a[1]) - b[1], np.float64(a[2]) - b[2]
    return math.sqrt(x * x + y * y + z * z)


@compiled()
def sectors_of(sweep: RingOrderedScan, sectors: int) -> np.ndarray:
    """Return the group, (N,) int64, of each return: each ring is cut into equal sectors."""
    ring, order = sweep.ring, sweep.order
    group, start = np.empty(len(order), np.int64), 0
    while start < len(order):
        end = start
        while end < len(order) and ring[order[end]] == ring[order[start]]:
            end += 1
        for k in range(start, end):
            part = (k - start) * sectors // (end - start)
            group[order[k]] = np.int64(ring[order[start]]) * sectors + part
        start = end
    return group


class Groups(NamedTuple):
    """Returns by group: places (K,) in the order, group by group; starts (G + 1,) of the groups."""

    places: np.ndarray
    starts: np.ndarray


class PickRule(NamedTuple):
    """Which returns of a group are picked.

    most: greatest number. bound: roughness above which returns are picked, or below which. sign: 1
    for the roughest, which are above it, -1 for the smoothest. neighbours: number on each side of a
    picked one that become unusable.
    """

    most: int
    bound: float
    sign: float
    neighbours: int


@compiled()
def members(group: np.ndarray, order: np.ndarray) -> Groups:
    """Return the members of each group.

    Negative groups are left out.
    """
    starts = np.zeros(max(group.max() + 2, 1) if len(group) else 1, np.int64)
    for n in range(len(group)):
        if group[n] >= 0:
            starts[group[n] + 1] += 1
    starts = np.cumsum(starts)
    ahead, places = starts.copy(), np.empty(starts[-1], np.int64)
    for k in range(len(order)):
        g = group[order[k]]
        if g >= 0:
            places[ahead[g]] = k
            ahead[g] += 1
    return Groups(places, starts)


@compiled()
def picked(
    sweep: RingOrderedScan, rough: np.ndarray, usable: np.ndarray, groups: Groups, rule: PickRule
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows that a rule picks from each group, and their ranks in it, (K,) int64.

    usable: (N,) bool; returns beside a picked one are marked as unusable in it.
    """
    most, bound, sign, neighbours = rule
    order, (places, starts) = sweep.order, groups
    rows, ranks, count = np.empty(len(order), np.int64), np.empty(len(order), np.int64), 0
    for g in range(len(starts) - 1):
        for rank in range(most):
            top, best = -1, sign * bound
            for at in range(starts[g], starts[g + 1]):
                n = order[places[at]]
                if usable[n] and sign * rough[n] > best:
                    top, best = places[at], sign * rough[n]
            if top < 0:
                break
            rows[count], ranks[count] = order[top], rank
            count += 1
            _block(sweep, usable, top, neighbours)
    return rows[:count], ranks[:count]


@compiled()
def _block(sweep: RingOrderedScan, usable: np.ndarray, top: int, neighbours: int) -> None:
    """Mark a return and those beside it on the same surface as unusable."""
    points, ring, order = sweep.points, sweep.ring, sweep.order
    usable[order[top]] = False
    for side in (-1, 1):
        for step in range(1, neighbours + 1):
            k = top + side * step
            if not 0 <= k < len(order):
                break
            n, m = order[k - side], order[k]
            if ring[n] != ring[m] or _distance(points[n], points[m]) > SAME_M:
                break
            usable[m] = False


# --------------------------------------------------------------------------------------------------
# Edges and planes of a scan.

NEIGHBOURS = 5
SECTORS = 6
"""Neighbours on each side of a return, and sectors of a ring; LOAM's."""


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Edges and planes in the frame of the scan's stamp; those that are matched come first.

    edges: (E, 3), planes: (P, 3) float64, metres. edge_labels: (E,), plane_labels: (P,) int64,
        the cluster. edge_rings, plane_rings: int64. edge_rows, plane_rows: int64, in the scan.
    sharp, flat: how many edges and planes, counted from the first, are searched among all edges and
        planes of the scan before.
    """

    edges: np.ndarray
    planes: np.ndarray
    edge_labels: np.ndarray
    plane_labels: np.ndarray
    edge_rings: np.ndarray
    plane_rings: np.ndarray
    edge_rows: np.ndarray
    plane_rows: np.ndarray
    sharp: int
    flat: int

    def at(self, points: np.ndarray) -> Features:
        """Return the same features at other positions: (N, 3) points of the whole scan, metres."""
        edges, planes = points[self.edge_rows], points[self.plane_rows]
        return replace(self, edges=edges.astype(float), planes=planes.astype(float))


@dataclass(frozen=True, slots=True)
class FeatureLimits:
    """Most features of a group, which is a sector of a ring or a cluster.

    sharp, edges: the roughest, rougher than `edge_above`; the first `sharp` are matched.
    flat, planes: the smoothest, smoother than `plane_below`; the first `flat` are matched.
    thin_m: of the planes that features of the next scan are matched with, one in each cube of this
        size is used; 0: all.
    """

    sharp: int = 2
    edges: int = 20
    flat: int = 4
    planes: int = 1 << 30
    edge_above: float = 5e-3
    plane_below: float = 5e-3
    thin_m: float = 0.2


LIMITS = FeatureLimits()


def roughness(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, *, neighbours: int = NEIGHBOURS
) -> np.ndarray:
    """Return c of (N, 3) points, (N,): distance of the mean neighbour on the ring, over range.

    nan where the ring has fewer neighbours on a side. Zhang and Singh 2017, eq. 1;
    our reading of Zhang 2022, eq. 6.
    """
    return roughness_along(sweep_of(points, ring, column), neighbours)


def cluster_roughness(points: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return c of (N, 3) points, (N,), by Zhang 2022, eq. 6, literally: over whole clusters.

    The sum over a cluster is its size times the offset from its centre. So c is the distance from
    the centre divided by the range, and not a curvature. nan for points of negative label.
    """
    rough = np.full(len(points), np.nan)
    inside = np.flatnonzero(labels >= 0)
    own = points[inside].astype(float)
    _, place, counts = np.unique(labels[inside], return_inverse=True, return_counts=True)
    centres = np.column_stack([np.bincount(place, own[:, i]) for i in range(3)])
    if len(inside):
        offsets = own - (centres / counts[:, None])[place]
        rough[inside] = np.linalg.norm(offsets, axis=1) / np.linalg.norm(own, axis=1)
    return rough


def extract(
    points: np.ndarray,
    ring: np.ndarray,
    column: np.ndarray,
    labels: np.ndarray,
    *,
    rough: np.ndarray | None = None,
    limits: FeatureLimits = LIMITS,
    by_cluster: bool = False,
    leave_out: bool = True,
    edge_rows: np.ndarray | None = None,
    flat_rows: np.ndarray | None = None,
) -> Features:
    """Return the features of (N, 3) points with (N,) ring, column and label.

    labels: negative for returns that give no features. rough: (N,) roughness; None: that among
        neighbours on the ring. by_cluster: the limits hold for each cluster rather than each sector
        of a ring. leave_out: without returns beside occlusions or on surfaces along the beam.
        edge_rows, flat_rows: (N,) bool, which may be edges, and planes that are matched; None: all.
    """
    sweep = sweep_of(points, ring, column)
    rough = roughness_along(sweep, NEIGHBOURS) if rough is None else rough
    usable = (labels >= 0) & np.isfinite(rough)
    if leave_out:
        usable &= ~unreliable(sweep, NEIGHBOURS)
    group = labels.astype(np.int64) if by_cluster else sectors_of(sweep, SECTORS)
    groups = members(group, sweep.order)
    for_edges = usable.copy() if edge_rows is None else usable & edge_rows
    taken = for_edges.copy()
    edges, ranks = picked(
        sweep, rough, for_edges, groups, PickRule(limits.edges, limits.edge_above, 1.0, NEIGHBOURS)
    )
    usable &= for_edges | ~taken
    for_flat = usable.copy() if flat_rows is None else usable & flat_rows
    flat, _ = picked(
        sweep, rough, for_flat, groups, PickRule(limits.flat, limits.plane_below, -1.0, NEIGHBOURS)
    )
    planes = _planes(sweep, rough, usable, groups, limits)
    planes = np.concatenate([flat, planes[~np.isin(planes, flat)]])
    edges = edges[np.argsort(ranks >= limits.sharp, kind="stable")]
    return Features(
        points[edges].astype(float),
        points[planes].astype(float),
        labels[edges].astype(np.int64),
        labels[planes].astype(np.int64),
        ring[edges].astype(np.int64),
        ring[planes].astype(np.int64),
        edges,
        planes,
        int((ranks < limits.sharp).sum()),
        len(flat),
    )


def _planes(
    sweep: RingOrderedScan,
    rough: np.ndarray,
    usable: np.ndarray,
    groups: Groups,
    limits: FeatureLimits,
) -> np.ndarray:
    """Return the rows of planes to match the next scan with: smooth returns not beside edges."""
    smooth = usable & (rough < limits.plane_below)
    rows = np.flatnonzero(smooth)
    places, starts = groups
    if limits.planes < np.diff(starts).max(initial=0):
        rows = _smoothest(sweep.order[places], starts, rough, smooth, limits.planes)
    if limits.thin_m > 0:
        rows = rows[thinned(sweep.points[rows], limits.thin_m, 0.0, np.inf)]
    return rows


def _smoothest(
    rows: np.ndarray, starts: np.ndarray, rough: np.ndarray, smooth: np.ndarray, most: int
) -> np.ndarray:
    """Return the smoothest rows of each group, at most that many, among smooth ones."""
    chosen = [np.empty(0, np.int64)]
    for group in np.split(rows, starts[1:-1]):
        group = group[smooth[group]]
        chosen.append(group[np.argsort(rough[group], kind="stable")[:most]])
    return np.concatenate(chosen)
