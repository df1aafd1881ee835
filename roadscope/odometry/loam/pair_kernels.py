"""Which line or plane of the features before each feature belongs to.

A pair is a point, an anchor on its line or plane, and unit axes across it, (2, 3): two for a
line, one and zeros for a plane. Its distance, Zhang 2022, eq. 7 and 8, is the norm along the axes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.loam.ring_table import NONE, RingTable, nearest, nearest_on

RINGS_AWAY = 2
"""The second ring lies this near to the first at most: features leave rings without any."""
SLIM = 0.05
"""Sine between the sides of a triangle below which it is a line and has no plane."""


class Pairs(NamedTuple):
    """Pairs of K points: points, anchors (K, 3) metres, axes (K, 2, 3)."""

    points: np.ndarray
    anchors: np.ndarray
    axes: np.ndarray


@compiled()
def lines_of(
    points: np.ndarray, labels: np.ndarray, rings: np.ndarray, table: RingTable,
    search: tuple[np.ndarray, float],
) -> Pairs:  # fmt: skip
    """Pair edges with lines through the nearest edge and the nearest on a ring beside its own.

    points: (N, 3), labels: (N,), negative for any, rings: (N,). search: (4, 4) `before_from_now`
    and the farthest that is looked, metres.
    """
    matrix, reach_m = search
    kept, anchors, axes = _room(len(points))
    count, place, most = 0, np.empty(3), reach_m * reach_m
    for n in range(len(points)):
        _place(matrix, points[n], place)
        j, ring = nearest(table, place, labels[n], (rings[n], len(table.lows), 0), most)
        if j == NONE:
            continue
        k, _ = nearest(table, place, labels[n], (ring, RINGS_AWAY, 1), most)
        if k == NONE:
            continue
        kept[count], anchors[count] = points[n], table.points[j]
        count += _across_line(table.points[k] - table.points[j], axes[count])
    return Pairs(kept[:count], anchors[:count], axes[:count])


@compiled()
def planes_of(
    points: np.ndarray, labels: np.ndarray, rings: np.ndarray, table: RingTable,
    search: tuple[np.ndarray, float],
) -> Pairs:  # fmt: skip
    """Pair points with planes through the nearest, another of its ring and one of a ring beside.

    As `lines_of`. The printed numerator of eq. 8 lacks its cross product: a distance from a
    plane is meant (Zhang and Singh 2017, eq. 3).
    """
    matrix, reach_m = search
    kept, anchors, axes = _room(len(points))
    count, place, most = 0, np.empty(3), reach_m * reach_m
    for n in range(len(points)):
        _place(matrix, points[n], place)
        j, ring = nearest(table, place, labels[n], (rings[n], len(table.lows), 0), most)
        if j == NONE:
            continue
        target = (place, np.arctan2(place[1], place[0]))
        k, _ = nearest_on(table, ring, target, labels[n], (most, j))
        m, _ = nearest(table, place, labels[n], (ring, RINGS_AWAY, 1), most)
        if k == NONE or m == NONE:
            continue
        kept[count], anchors[count] = points[n], table.points[j]
        one, other = table.points[k] - table.points[j], table.points[m] - table.points[j]
        count += _across_plane(one, other, axes[count])
    return Pairs(kept[:count], anchors[:count], axes[:count])


@compiled()
def _room(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.empty((count, 3)), np.empty((count, 3)), np.zeros((count, 2, 3))


@compiled()
def _place(matrix: np.ndarray, point: np.ndarray, place: np.ndarray) -> None:
    for i in range(3):
        place[i] = matrix[i, 3]
        for j in range(3):
            place[i] += matrix[i, j] * point[j]


@compiled()
def _across_line(way: np.ndarray, axes: np.ndarray) -> int:
    """Fill two unit axes across a line; return 1, or 0 for a line without direction."""
    length = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    if not length > 0.0:
        return 0
    x, y, z = way / length
    # Any axis that is not along the line will do for the first.
    if abs(z) < 0.9:
        flat = np.sqrt(x * x + y * y)
        axes[0, 0], axes[0, 1], axes[0, 2] = -y / flat, x / flat, 0.0
    else:
        upright = np.sqrt(y * y + z * z)
        axes[0, 0], axes[0, 1], axes[0, 2] = 0.0, -z / upright, y / upright
    _cross(way / length, axes[0], axes[1])
    return 1


@compiled()
def _across_plane(one: np.ndarray, other: np.ndarray, axes: np.ndarray) -> int:
    """Fill the unit normal of a plane; return 1, or 0 for a triangle too slim to have one."""
    normal = np.empty(3)
    _cross(one, other, normal)
    area2 = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2
    sides2 = (one * one).sum() * (other * other).sum()
    if not area2 > SLIM * SLIM * sides2:
        return 0
    axes[0] = normal / np.sqrt(area2)
    axes[1] = 0.0
    return 1


@compiled()
def _cross(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
