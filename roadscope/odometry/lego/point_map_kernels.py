"""The nearest points of a map, and the line or plane through them.

J. Zhang and S. Singh, "Low-drift and real-time lidar odometry and mapping", Autonomous Robots 41,
2017, section 6: eigenvalues of the nearest points' scatter tell whether they lie on a line or on
a plane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, Index, cube_of, slot_of
from roadscope.odometry.eigen_kernels import eigen3
from roadscope.odometry.loam.pair_kernels import Pairs

CUBE_M = 1.0
"""Nearest points are looked for up to here; LOAM takes none farther."""
NEAREST = 5
LONG = 3.0
"""A line's greatest eigenvalue is so many times the next."""
THICK_M, WIDE_M = 0.1, 0.1
"""Root mean square distance of a plane's points from it, at most, and from the line along which
they spread, at least: those of one beam's trace lie on a line and have no plane."""


class PointGrid(NamedTuple):
    """Points in cubes of `CUBE_M`.

    keys, heads: (S,) int64, of cubes by open addressing, and the last point of each. points:
    (M, 3) metres. nexts: (M,) int64, the point before it in its cube or -1. used: (2,) int64,
    cubes and points.
    """

    keys: np.ndarray
    heads: np.ndarray
    points: np.ndarray
    nexts: np.ndarray
    used: np.ndarray


@compiled()
def grid_insert(grid: PointGrid, points: np.ndarray, thin_m: float) -> None:
    """Add (N, 3) points, except those nearer than a distance to one of the same cube."""
    for n in range(len(points)):
        key = _key(points[n], 0, 0, 0)
        if key < 0:
            continue
        slot = slot_of(grid.keys, key)
        if _nearer(grid, slot, points[n], thin_m):
            continue
        if grid.keys[slot] == EMPTY:
            grid.keys[slot] = key
            grid.used[0] += 1
        k = grid.used[1]
        grid.points[k] = points[n]
        grid.nexts[k], grid.heads[slot] = grid.heads[slot], k
        grid.used[1] += 1


@compiled()
def _key(place: np.ndarray, dx: int, dy: int, dz: int) -> Index:
    """Return the key of the cube that holds a place, or of one beside it; negative if far off."""
    x, y, z = place[0] + dx * CUBE_M, place[1] + dy * CUBE_M, place[2] + dz * CUBE_M
    return cube_of(x, y, z, CUBE_M)


@compiled()
def _nearer(grid: PointGrid, slot: Index, place: np.ndarray, thin_m: float) -> bool:
    k = grid.heads[slot]
    while k != EMPTY:
        if _squared(grid.points[k], place) < thin_m * thin_m:
            return True
        k = grid.nexts[k]
    return False


@compiled()
def _squared(a: np.ndarray, b: np.ndarray) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return float(x * x + y * y + z * z)


@compiled()
def nearest_points(grid: PointGrid, place: np.ndarray, found: np.ndarray) -> int:
    """Fill the nearest points of a place, nearest first; return how many are within `CUBE_M`."""
    count, away = 0, np.full(len(found), CUBE_M * CUBE_M)
    for cube in range(27):
        key = _key(place, cube % 3 - 1, cube // 3 % 3 - 1, cube // 9 - 1)
        k = grid.heads[slot_of(grid.keys, key)] if key >= 0 else np.int64(EMPTY)
        while k != EMPTY:
            squared = _squared(grid.points[k], place)
            if squared < away[-1]:
                at = len(found) - 1
                while at > 0 and away[at - 1] > squared:
                    away[at], found[at] = away[at - 1], found[at - 1]
                    at -= 1
                away[at], found[at] = squared, k
                count = min(count + 1, len(found))
            k = grid.nexts[k]
    return count


@compiled()
def lines_among(grid: PointGrid, points: np.ndarray, pose: np.ndarray) -> Pairs:
    """Pair (N, 3) points with the lines on which the nearest points of the map lie.

    pose: (4, 4) `map_from_sensor`. Points without such a line are left out.
    """
    kept, anchors = np.empty((len(points), 3)), np.empty((len(points), 3))
    axes, count = np.zeros((len(points), 2, 3)), 0
    values, vectors = np.empty(3), np.empty((3, 3))
    for n in range(len(points)):
        if not _scatter(grid, points[n], pose, (anchors[count], values, vectors)):
            continue
        if values[2] > LONG * values[1]:
            kept[count] = points[n]
            axes[count, 0], axes[count, 1] = vectors[0], vectors[1]
            count += 1
    return Pairs(kept[:count], anchors[:count], axes[:count])


@compiled()
def planes_among(grid: PointGrid, points: np.ndarray, pose: np.ndarray) -> Pairs:
    """Pair (N, 3) points with the planes on which the nearest points of the map lie."""
    kept, anchors = np.empty((len(points), 3)), np.empty((len(points), 3))
    axes, count = np.zeros((len(points), 2, 3)), 0
    values, vectors = np.empty(3), np.empty((3, 3))
    for n in range(len(points)):
        if not _scatter(grid, points[n], pose, (anchors[count], values, vectors)):
            continue
        if values[0] < THICK_M * THICK_M and values[1] > max(WIDE_M * WIDE_M, LONG * values[0]):
            kept[count] = points[n]
            axes[count, 0] = vectors[0]
            count += 1
    return Pairs(kept[:count], anchors[:count], axes[:count])


@compiled()
def _scatter(
    grid: PointGrid, point: np.ndarray, pose: np.ndarray,
    told: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> bool:  # fmt: skip
    """Fill mean, eigenvalues and eigenvectors of a point's nearest; False if they are too few."""
    mean, values, vectors = told
    place, found = np.empty(3), np.empty(NEAREST, np.int64)
    for i in range(3):
        place[i] = pose[i, 3]
        for j in range(3):
            place[i] += pose[i, j] * point[j]
    if nearest_points(grid, place, found) < NEAREST:
        return False
    matrix = np.zeros((3, 3))
    for i in range(3):
        mean[i] = 0.0
        for k in found:
            mean[i] += grid.points[k, i] / NEAREST
    for k in found:
        for i in range(3):
            for j in range(3):
                off = (grid.points[k, i] - mean[i]) * (grid.points[k, j] - mean[j])
                matrix[i, j] += off / NEAREST
    eigen3(matrix, values, vectors)
    return True
