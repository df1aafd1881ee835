"""Edges and planes of a scan, by how rough it is (Zhang and Singh 2017; Zhang 2022, eq. 6).

J. Zhang and S. Singh, "Low-drift and real-time lidar odometry and mapping", Autonomous Robots
41, 2017, section 5.1: largest roughness is an edge, smallest a plane; sectors of each ring give
so many at most; what is beside an occlusion or lies along the beam is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.odometry.cloud_kernels import thinned
from roadscope.odometry.loam.feature_kernels import (
    Sweep,
    members,
    picked,
    roughness_along,
    sectors_of,
    sweep_of,
    unreliable,
)

NEIGHBOURS = 5
SECTORS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Returns that stand out, in the frame of the scan's stamp; what is matched comes first.

    edges: (E, 3), planes: (P, 3) float64, metres. edge_labels: (E,), plane_labels: (P,) int64,
        the cluster. edge_rings, plane_rings: int64. edge_rows, plane_rows: int64, in the scan.
    sharp, flat: so many of the first edges and planes are matched; all are matched against.
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
        """Return the same returns at other places: (N, 3) points of the whole scan, metres."""
        edges, planes = points[self.edge_rows], points[self.plane_rows]
        return replace(self, edges=edges.astype(float), planes=planes.astype(float))


@dataclass(frozen=True, slots=True)
class Limits:
    """How many features a group, a sector of a ring or a cluster, gives at most.

    sharp, edges: the roughest, rougher than `edge_above`; the first `sharp` are matched.
    flat, planes: the smoothest, smoother than `plane_below`; likewise.
    thin_m: planes that are matched against are one a cube of this size; 0: all of them.
    """

    sharp: int = 2
    edges: int = 20
    flat: int = 4
    planes: int = 1 << 30
    edge_above: float = 5e-3
    plane_below: float = 5e-3
    thin_m: float = 0.2


LIMITS = Limits()


def roughness(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, *, neighbours: int = NEIGHBOURS
) -> np.ndarray:
    """Return c of (N, 3) points, (N,): how far the mean neighbour on the ring lies off, by range.

    nan where the ring does not go on for so many returns both ways. Zhang and Singh 2017, eq. 1;
    our reading of Zhang 2022, eq. 6.
    """
    return roughness_along(sweep_of(points, ring, column), neighbours)


def cluster_roughness(points: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return c of (N, 3) points, (N,), as Zhang 2022, eq. 6, says literally: over whole clusters.

    The sum over a cluster is its size times the way from its centre: c is the distance from
    the centre by the range, no curvature. nan for points of negative label.
    """
    rough = np.full(len(points), np.nan)
    inside = np.flatnonzero(labels >= 0)
    own = points[inside].astype(float)
    _, place, counts = np.unique(labels[inside], return_inverse=True, return_counts=True)
    centres = np.column_stack([np.bincount(place, own[:, i]) for i in range(3)])
    if len(inside):
        off = own - (centres / counts[:, None])[place]
        rough[inside] = np.linalg.norm(off, axis=1) / np.linalg.norm(own, axis=1)
    return rough


def extract(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, labels: np.ndarray, *,
    rough: np.ndarray | None = None, limits: Limits = LIMITS, by_cluster: bool = False,
    leave_out: bool = True, edge_rows: np.ndarray | None = None,
    flat_rows: np.ndarray | None = None,
) -> Features:  # fmt: skip
    """Return the features of (N, 3) points with (N,) ring, column and label.

    labels: negative for returns that give no features. rough: (N,); None: among neighbours on
        the ring. by_cluster: the limits hold for each cluster rather than each sector of a ring.
    leave_out: without what is beside occlusions or along the beam. edge_rows, flat_rows: (N,)
        bool, which may be edges, and planes that are matched; None: all.
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
        sweep, rough, for_edges, groups, (limits.edges, limits.edge_above, 1.0, NEIGHBOURS)
    )
    usable &= for_edges | ~taken
    for_flat = usable.copy() if flat_rows is None else usable & flat_rows
    flat, _ = picked(
        sweep, rough, for_flat, groups, (limits.flat, limits.plane_below, -1.0, NEIGHBOURS)
    )
    planes = _planes(sweep, rough, usable, groups, limits)
    planes = np.concatenate([flat, planes[~np.isin(planes, flat)]])
    edges = edges[np.argsort(ranks >= limits.sharp, kind="stable")]
    return Features(
        points[edges].astype(float), points[planes].astype(float),
        labels[edges].astype(np.int64), labels[planes].astype(np.int64),
        ring[edges].astype(np.int64), ring[planes].astype(np.int64),
        edges, planes, int((ranks < limits.sharp).sum()), len(flat),
    )  # fmt: skip


def _planes(
    sweep: Sweep, rough: np.ndarray, usable: np.ndarray, groups: tuple[np.ndarray, np.ndarray],
    limits: Limits,
) -> np.ndarray:  # fmt: skip
    """Return the rows of what planes are matched against: all that is smooth, and by no edge."""
    smooth = usable & (rough < limits.plane_below)
    rows = np.flatnonzero(smooth)
    places, starts = groups
    if limits.planes < np.diff(starts).max(initial=0):
        rows = _smoothest(sweep.order[places], starts, (rough, smooth), limits.planes)
    if limits.thin_m > 0:
        rows = rows[thinned(sweep.points[rows], limits.thin_m, (0.0, np.inf))]
    return rows


def _smoothest(
    rows: np.ndarray, starts: np.ndarray, known: tuple[np.ndarray, np.ndarray], most: int
) -> np.ndarray:
    """Return the smoothest rows of each group, so many at most, that are smooth."""
    rough, smooth = known
    group = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    rows, group = rows[smooth[rows]], group[smooth[rows]]
    order = np.lexsort((rough[rows], group))
    rows, group = rows[order], group[order]
    rank = np.arange(len(rows)) - np.searchsorted(group, group)
    kept: np.ndarray = rows[rank < most]
    return kept
