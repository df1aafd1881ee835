"""How rough a scan is along its rings, and which returns stand out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

JUMP = 0.1
"""A return farther than its neighbour by this share of the nearer range lies behind an edge."""
ADJACENT = 10
"""Columns between two returns up to which the nearer one may hide what is beside the farther."""
GRAZING = 0.97
"""Cosine of the angle to the beam, 14 deg, below which a surface is nearly parallel to it."""
SAME_M = 0.25
"""Neighbours along a ring that lie farther apart than this belong to different surfaces."""


class Sweep(NamedTuple):
    """A scan ring by ring.

    points: (N, 3) metres. ring, column: (N,). order: (N,) int64 rows, by ring, then by column.
    """

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    order: np.ndarray


def sweep_of(points: np.ndarray, ring: np.ndarray, column: np.ndarray) -> Sweep:
    """Return a scan ring by ring."""
    return Sweep(points, ring, column, ring_order(ring, column))


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
            return np.argsort(keys, kind="mergesort")
    return order


@compiled()
def roughness_along(sweep: Sweep, neighbours: int) -> np.ndarray:
    """Return (N,) roughness among so many neighbours either way on the ring; nan at its ends."""
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
def unreliable(sweep: Sweep, neighbours: int) -> np.ndarray:
    """Return (N,) bool: beside what hides a part of their surface, or on one along the beam."""
    points, ring, column, order = sweep
    bad, along_before = np.zeros(len(points), np.bool_), False
    for k in range(1, len(order)):
        n, m = order[k - 1], order[k]
        if ring[n] != ring[m]:
            along_before = False
            continue
        rn, rm = _norm(points[n]), _norm(points[m])
        along = abs(rn - rm) > GRAZING * _apart(points[n], points[m])
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
def _apart(a: np.ndarray, b: np.ndarray) -> float:
    x, y, z = np.float64(a[0]) - b[0], np.float64(a[1]) - b[1], np.float64(a[2]) - b[2]
    return math.sqrt(x * x + y * y + z * z)


@compiled()
def sectors_of(sweep: Sweep, sectors: int) -> np.ndarray:
    """Return the group, (N,) int64, of each return: so many a ring, of equal numbers."""
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


@compiled()
def members(group: np.ndarray, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places in the order, (K,), group by group, and where groups start, (G + 1,).

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
    return places, starts


@compiled()
def picked(
    sweep: Sweep, rough: np.ndarray, usable: np.ndarray, groups: tuple[np.ndarray, np.ndarray],
    rule: tuple[int, float, float, int],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the rows of the roughest of each group, and their ranks in it, (K,) int64.

    rule: how many at most, beyond which bound, 1 for the roughest or -1 for the smoothest, and
    how many beside one that is picked are no longer usable, which is noted there.
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
def _block(sweep: Sweep, usable: np.ndarray, top: int, neighbours: int) -> None:
    """Note that a return and those beside it on the same surface are taken."""
    points, ring, order = sweep.points, sweep.ring, sweep.order
    usable[order[top]] = False
    for way in (-1, 1):
        for step in range(1, neighbours + 1):
            k = top + way * step
            if not 0 <= k < len(order):
                break
            n, m = order[k - way], order[k]
            if ring[n] != ring[m] or _apart(points[n], points[m]) > SAME_M:
                break
            usable[m] = False
