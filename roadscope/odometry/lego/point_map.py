"""A map of points, from which lines and planes are fitted to the nearest of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core.arguments import check_positive
from roadscope.core.jit import compiled
from roadscope.odometry.cloud_kernels import placed, thinned
from roadscope.odometry.cubes import EMPTY, Index, cube_of, slot_of
from roadscope.odometry.eigen_kernels import eigen3
from roadscope.odometry.loam.feature_match import FeatureMatch, Pairs, settle
from roadscope.odometry.loam.features import Features

# --------------------------------------------------------------------------------------------------
# The nearest points of a map, and the line or plane through them.

CUBE_M = 1.0
"""Search radius for nearest points, as in LOAM."""
NEAREST = 5
"""Number of nearest points of a line or plane."""
LONG = 3.0
"""Least ratio of the greatest eigenvalue of a line's points to the next, and of the second of a
plane's to the least."""
THICK_M, WIDE_M = 0.1, 0.1
"""Largest root mean square distance of a plane's points from it, and the least from their line:
points of a single ring lie on a line and have no plane."""


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
def nearest_points(grid: PointGrid, point: np.ndarray, nearest: np.ndarray) -> int:
    """Fill the nearest points of a place, nearest first; return how many are within `CUBE_M`."""
    count, squares = 0, np.full(len(nearest), CUBE_M * CUBE_M)
    for cube in range(27):
        key = _key(point, cube % 3 - 1, cube // 3 % 3 - 1, cube // 9 - 1)
        k = grid.heads[slot_of(grid.keys, key)] if key >= 0 else np.int64(EMPTY)
        while k != EMPTY:
            squared = _squared(grid.points[k], point)
            if squared < squares[-1]:
                at = len(nearest) - 1
                while at > 0 and squares[at - 1] > squared:
                    squares[at], nearest[at] = squares[at - 1], nearest[at - 1]
                    at -= 1
                squares[at], nearest[at] = squared, k
                count = min(count + 1, len(nearest))
            k = grid.nexts[k]
    return count


@compiled()
def lines_among(grid: PointGrid, points: np.ndarray, pose: np.ndarray) -> Pairs:
    """Pair (N, 3) points with the lines on which the nearest points of the map lie.

    pose: (4, 4) `map_from_sensor`. Points without such a line are left out.
    """
    matched, anchors = np.empty((len(points), 3)), np.empty((len(points), 3))
    axes, count = np.zeros((len(points), 2, 3)), 0
    values, vectors = np.empty(3), np.empty((3, 3))
    for n in range(len(points)):
        if not _scatter(grid, points[n], pose, anchors[count], values, vectors):
            continue
        if values[2] > LONG * values[1]:
            matched[count] = points[n]
            axes[count, 0], axes[count, 1] = vectors[0], vectors[1]
            count += 1
    return Pairs(matched[:count], anchors[:count], axes[:count])


@compiled()
def planes_among(grid: PointGrid, points: np.ndarray, pose: np.ndarray) -> Pairs:
    """Pair (N, 3) points with the planes on which the nearest points of the map lie."""
    matched, anchors = np.empty((len(points), 3)), np.empty((len(points), 3))
    axes, count = np.zeros((len(points), 2, 3)), 0
    values, vectors = np.empty(3), np.empty((3, 3))
    for n in range(len(points)):
        if not _scatter(grid, points[n], pose, anchors[count], values, vectors):
            continue
        if values[0] < THICK_M * THICK_M and values[1] > max(WIDE_M * WIDE_M, LONG * values[0]):
            matched[count] = points[n]
            axes[count, 0] = vectors[0]
            count += 1
    return Pairs(matched[:count], anchors[:count], axes[:count])


@compiled()
def _scatter(
    grid: PointGrid,
    point: np.ndarray,
    pose: np.ndarray,
    mean: np.ndarray,
    values: np.ndarray,
    vectors: np.ndarray,
) -> bool:
    """Write mean, eigenvalues and eigenvectors of a point's nearest points; False if too few."""
    place, nearest = np.empty(3), np.empty(NEAREST, np.int64)
    for i in range(3):
        place[i] = pose[i, 3]
        for j in range(3):
            place[i] += pose[i, j] * point[j]
    if nearest_points(grid, place, nearest) < NEAREST:
        return False
    matrix = np.zeros((3, 3))
    for i in range(3):
        mean[i] = 0.0
        for k in nearest:
            mean[i] += grid.points[k, i] / NEAREST
    for k in nearest:
        for i in range(3):
            for j in range(3):
                off = (grid.points[k, i] - mean[i]) * (grid.points[k, j] - mean[j])
                matrix[i, j] += off / NEAREST
    eigen3(matrix, values, vectors)
    return True


# --------------------------------------------------------------------------------------------------
# A map of points, from which lines and planes are fitted to the nearest of them.

SLOTS, POINTS = 1 << 13, 1 << 13
"""Initial capacity of a map."""


class PointMap:
    """Points in cubes, no two of one cube nearer than a distance.

    thin_m: that distance, metres.
    """

    def __init__(self, *, thin_m: float) -> None:
        check_positive(thin_m=thin_m)
        self.thin_m = thin_m
        self.clear()

    def clear(self) -> None:
        """Forget all points."""
        self.grid = _empty(SLOTS, POINTS)

    def __len__(self) -> int:
        return int(self.grid.used[1])

    @property
    def points(self) -> np.ndarray:
        """(M, 3) metres, in the order in which they were added."""
        return self.grid.points[: len(self)]

    def add(self, points: np.ndarray) -> None:
        """Add (N, 3) points, metres, except those that are near others."""
        slots, capacity = len(self.grid.keys), len(self.grid.points)
        cells, count = self.grid.used
        # At most half of the hash table is used; each point may need a new cube.
        if 2 * (cells + len(points)) > slots or count + len(points) > capacity:
            old = self.points
            while slots < 4 * (cells + len(points)):
                slots *= 2
            while capacity < 2 * (count + len(points)):
                capacity *= 2
            self.grid = _empty(slots, capacity)
            grid_insert(self.grid, old, 0.0)
        grid_insert(self.grid, np.ascontiguousarray(points, float), self.thin_m)

    def lines(self, points: np.ndarray, pose: np.ndarray) -> Pairs:
        """Pair (N, 3) points, sensor frame, with lines of the map; pose: `map_from_sensor`."""
        return lines_among(self.grid, points, pose)

    def planes(self, points: np.ndarray, pose: np.ndarray) -> Pairs:
        """Pair (N, 3) points, sensor frame, with planes of the map; pose: `map_from_sensor`."""
        return planes_among(self.grid, points, pose)


def _empty(slots: int, capacity: int) -> PointGrid:
    return PointGrid(
        np.full(slots, EMPTY, np.int64),
        np.full(slots, EMPTY, np.int64),
        np.empty((capacity, 3)),
        np.empty(capacity, np.int64),
        np.zeros(2, np.int64),
    )


# --------------------------------------------------------------------------------------------------
# Keyframes: sets of features with their poses (Shan and Englot 2018).

EDGES_M, PLANES_M = 0.2, 0.4
"""Least distance of two edges, and of two planes, of a map."""
MATCHED_M = 0.8
"""Of the planes, one in each cube of this size is matched."""
MOST_SEARCHES = 8
"""Most searches for neighbours in one match."""
ANY_RANGE_M = (0.0, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Edges (E, 3) and planes (P, 3) of a scan, metres, lidar frame, and its place.

    map_from_lidar: (4, 4). few: rows of planes that are matched with maps. driven_m: distance
    driven so far.
    """

    edges: np.ndarray
    planes: np.ndarray
    few: np.ndarray
    map_from_lidar: np.ndarray
    driven_m: float

    @property
    def place(self) -> np.ndarray:
        """(3,) metres, in the map's frame."""
        return self.map_from_lidar[:3, 3]


def keyframe(features: Features, map_from_lidar: np.ndarray, driven_m: float) -> Keyframe:
    """Return a scan's features as a keyframe, thinned."""
    edges = features.edges[thinned(features.edges, EDGES_M, *ANY_RANGE_M)]
    planes = features.planes[thinned(features.planes, PLANES_M, *ANY_RANGE_M)]
    few = thinned(planes, MATCHED_M, *ANY_RANGE_M)
    return Keyframe(edges, planes, few, map_from_lidar, driven_m)


class KeyframeMap:
    """Edges and planes of keyframes, together."""

    def __init__(self, keyframes: Iterable[Keyframe] = ()) -> None:
        self.edges, self.planes = PointMap(thin_m=EDGES_M), PointMap(thin_m=PLANES_M)
        for each in keyframes:
            self.add(each)

    def add(self, new: Keyframe) -> None:
        """Add a keyframe's features."""
        self.edges.add(placed(new.edges, new.map_from_lidar))
        self.planes.add(placed(new.planes, new.map_from_lidar))

    def match(self, new: Keyframe, start: np.ndarray) -> FeatureMatch:
        """Match a keyframe with lines and planes of the map; start: (4, 4) `map_from_lidar`."""
        planes = new.planes[new.few]
        searches = [
            lambda pose: self.edges.lines(new.edges, pose),
            lambda pose: self.planes.planes(planes, pose),
        ]
        return settle(searches, start, most=MOST_SEARCHES)
