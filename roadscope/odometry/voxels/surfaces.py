"""A map of surfaces in voxels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import BITS, EMPTY, HALF, Index, cube_of, slot_of
from roadscope.odometry.eigen_kernels import eigen3

# --------------------------------------------------------------------------------------------------
# A hash table of voxels of several sizes, with the moments of their points.

SIZES_M = (1.0, 2.0, 4.0)
"""Edges of the voxels; each point is in one of each size, its level."""
LEAST = 5
"""Points from which a voxel has a surface."""
MOST = 120.0
"""Most points of a voxel; then its surface stays unchanged. Otherwise it would follow the drift of
a sensor that measures it all the time, as at the end of a corridor."""
GROWN = 1.15
"""A surface is fitted again when its number of points has grown by this factor."""
THIN_M = 0.1
"""Root mean square thickness up to which points are a surface or an edge: rough ground, leaves."""
WIDE = 0.12
"""Least extent along a surface, a share of the voxel's size. One beam's trace across a road is a
line that moves with the sensor: it has no width and must not count as an edge."""
WIDE_M, WIDE_LEVEL_M = 0.2, 0.5
"""Least extent in metres, larger for level surfaces: noise along slanting beams tilts narrow ones
in the same direction, and pitch and height depend on the ground."""
WHOLE_LEVEL = 0.22
"""Upper limit of that extent for level surfaces, a share of the voxel's size: an evenly covered
voxel has 0.29. Indoors, larger voxels contain walls too."""
LEVEL = 0.9
"""Least cosine of the angle between the vertical and the normal of a level surface."""
UPRIGHT = 0.8
"""Least cosine of the angle between an edge and the vertical: poles and trunks. Level lines are
mostly traces of beams."""
FLOOR_M = 0.01
"""Standard deviation of a point from a perfectly known surface: deskewing, roughness."""
ROUGH_M = 0.03
"""Further standard deviation of a point that belongs to a surface: kerbs, errors of the map."""


class Voxels(NamedTuple):
    """A table of M slots, by open addressing.

    keys: (M,) int64. counts: (M,) points. sums: (M, 3), squares: (M, 6), of the points less the
        voxel's centre. fitted: (M,) count when its surface was last fitted.
    means: (M, 3) metres. axes: (M, 3, 3) unit vectors as rows. spreads: (M, 3) m^2, variances of
        the points along them, ascending. fixed_axes: (M,) how many of the axes hold other points in
        place: 0, 1 for a surface, 2 for an edge.
    used: (1,) slots taken.
    """

    keys: np.ndarray
    counts: np.ndarray
    sums: np.ndarray
    squares: np.ndarray
    fitted: np.ndarray
    means: np.ndarray
    axes: np.ndarray
    spreads: np.ndarray
    fixed_axes: np.ndarray
    used: np.ndarray


def empty_voxels(slots: int) -> Voxels:
    """Return a table without voxels; slots: a power of 2."""
    return Voxels(
        np.full(slots, EMPTY, np.int64),
        np.zeros(slots),
        np.zeros((slots, 3)),
        np.zeros((slots, 6)),
        np.zeros(slots),
        np.zeros((slots, 3)),
        np.zeros((slots, 3, 3)),
        np.zeros((slots, 3)),
        np.zeros(slots, np.int8),
        np.zeros(1, np.int64),
    )


@compiled(borrowing=True)
def key_of(x: float, y: float, z: float, level: int) -> Index:
    """Return the key of the voxel of a level that holds a point; negative if it is too far off."""
    cube = cube_of(x, y, z, SIZES_M[level])
    return cube if cube == EMPTY else (np.int64(level) << 3 * BITS) | cube


@compiled()
def insert(voxels: Voxels, points: np.ndarray) -> None:
    """Add (N, 3) points, metres, and fit the surfaces of the voxels that have grown."""
    _insert(voxels, points, np.empty((3, 3)), np.empty(3), np.empty((3, 3)))


@compiled(borrowing=True)
def _insert(
    voxels: Voxels, points: np.ndarray, matrix: np.ndarray, values: np.ndarray, vectors: np.ndarray
) -> None:
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        for level in range(len(SIZES_M)):
            key = key_of(x, y, z, level)
            if key < 0:
                continue
            slot = slot_of(voxels.keys, key)
            if voxels.keys[slot] == EMPTY:
                voxels.keys[slot] = key
                voxels.used[0] += 1
            _add(voxels, slot, key, x, y, z)
            count = voxels.counts[slot]
            if count >= LEAST and count >= GROWN * voxels.fitted[slot]:
                _fit(voxels, slot, key, matrix, values, vectors)


@compiled(borrowing=True)
def _centre(key: Index, axis: int) -> float:
    size = SIZES_M[key >> 3 * BITS]
    return (((key >> (2 - axis) * BITS) & (2 * HALF - 1)) - HALF + 0.5) * size


@compiled(borrowing=True)
def _add(voxels: Voxels, slot: Index, key: Index, x: float, y: float, z: float) -> None:
    if voxels.counts[slot] >= MOST:
        return
    x, y, z = x - _centre(key, 0), y - _centre(key, 1), z - _centre(key, 2)
    sums, squares = voxels.sums[slot], voxels.squares[slot]
    voxels.counts[slot] += 1.0
    sums[0] += x
    sums[1] += y
    sums[2] += z
    squares[0] += x * x
    squares[1] += x * y
    squares[2] += x * z
    squares[3] += y * y
    squares[4] += y * z
    squares[5] += z * z


@compiled(borrowing=True)
def _fit(
    voxels: Voxels,
    slot: Index,
    key: Index,
    matrix: np.ndarray,
    values: np.ndarray,
    vectors: np.ndarray,
) -> None:
    """Fit a surface or an edge to the points of a voxel; the last three arrays are scratch."""
    n, sums, squares = voxels.counts[slot], voxels.sums[slot], voxels.squares[slot]
    k = 0
    for i in range(3):
        for j in range(i, 3):
            matrix[i, j] = matrix[j, i] = squares[k] / n - sums[i] / n * (sums[j] / n)
            k += 1
    eigen3(matrix, values, vectors)
    # `wide` and `thin` are variances, m^2, like the eigenvalues.
    wide = max(WIDE * SIZES_M[key >> 3 * BITS], WIDE_M) ** 2
    if abs(vectors[0, 2]) > LEVEL:
        wide = max(wide, min(WIDE_LEVEL_M, WHOLE_LEVEL * SIZES_M[key >> 3 * BITS]) ** 2)
    thin = THIN_M * THIN_M
    edge = values[1] < thin and abs(vectors[2, 2]) > UPRIGHT and values[2] > wide
    surface = values[0] < thin and values[1] > wide
    voxels.fixed_axes[slot] = 2 if edge else 1 if surface else 0
    for i in range(3):
        voxels.means[slot, i] = sums[i] / n + _centre(key, i)
        voxels.spreads[slot, i] = max(values[i], 0.0)
        for j in range(3):
            voxels.axes[slot, i, j] = vectors[i, j]
    voxels.fitted[slot] = n


@compiled()
def copy_near(old: Voxels, new: Voxels, centre: np.ndarray, reach_m: float) -> None:
    """Copy the voxels within a reach, in x and y, of a place into an empty table."""
    for slot in range(len(old.keys)):
        key = old.keys[slot]
        if key == EMPTY:
            continue
        away = max(abs(_centre(key, 0) - centre[0]), abs(_centre(key, 1) - centre[1]))
        if away > reach_m:
            continue
        to = slot_of(new.keys, key)
        new.keys[to] = key
        new.used[0] += 1
        new.counts[to], new.fitted[to] = old.counts[slot], old.fitted[slot]
        new.sums[to], new.squares[to] = old.sums[slot], old.squares[slot]
        new.means[to], new.axes[to] = old.means[slot], old.axes[slot]
        new.spreads[to], new.fixed_axes[to] = old.spreads[slot], old.fixed_axes[slot]


# --------------------------------------------------------------------------------------------------
# A map of surfaces in voxels.

SLOTS = 1 << 15
"""Slots of a new table."""
FULL = 0.5
"""Share of used slots at which far voxels are dropped, and the table grows if necessary."""


class VoxelMap:
    """Surfaces in voxels of several sizes, learned from points; far voxels are dropped.

    reach_m: radius of the map in x and y around the place of the last added points.
    """

    def __init__(self, *, reach_m: float) -> None:
        self.reach_m = reach_m
        self.clear()

    def clear(self) -> None:
        """Remove all voxels."""
        self.voxels = empty_voxels(SLOTS)

    def __len__(self) -> int:
        return int(self.voxels.used[0])

    def add(self, points: np.ndarray, centre: np.ndarray) -> None:
        """Add (N, 3) points, metres, measured from a place, (3,) metres, map frame."""
        most_new = len(SIZES_M) * len(points)
        if len(self) + most_new > FULL * len(self.voxels.keys):
            self._clear_up(centre, most_new)
        insert(self.voxels, points)

    def _clear_up(self, centre: np.ndarray, new_voxels: int) -> None:
        """Drop far voxels, so that the table has space for new ones."""
        slots = len(self.voxels.keys)
        while True:
            remaining = empty_voxels(slots)
            if len(self) <= FULL * slots or slots > len(self.voxels.keys):
                copy_near(self.voxels, remaining, np.ascontiguousarray(centre), self.reach_m)
                if remaining.used[0] + new_voxels <= 0.7 * FULL * slots:
                    self.voxels = remaining
                    return
            slots *= 2
