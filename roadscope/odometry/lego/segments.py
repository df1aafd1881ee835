"""A scan as an image of beams and columns: its ground, and objects that are not small."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan
from roadscope.core.jit import compiled
from roadscope.odometry.loam.features import FeatureLimits, Features, extract
from roadscope.odometry.loam.progress import ScanReturns

# --------------------------------------------------------------------------------------------------
# The range image, its ground and its objects.

NONE = -1
"""Stands for a return or an object where there is none."""
LEVEL = math.tan(math.radians(10.0))
"""Slope of the steepest ground, 10 deg as in LeGO-LOAM."""
OBJECT_ANGLE_RAD = math.radians(10.0)
"""Two returns belong to one object if the angle between the line through them and the farther
one's beam is larger than this (10 deg by Bogoslavskyi and Stachniss 2016)."""


class RangeImage(NamedTuple):
    """Returns by beam and column.

    points: (N, 3) metres, lidar frame. rows: (R, C) int64, the return of each cell, -1 without
    one; ring 0 is the lowest.
    """

    points: np.ndarray
    rows: np.ndarray


def range_image(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, least_m: float, most_m: float
) -> RangeImage:
    """Return (N, 3) points with (N,) ring and column as an image, without those out of bounds.

    Where a beam has several returns in a column the last is taken.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        ranges = np.linalg.norm(points.astype(float), axis=1)
        inside = np.flatnonzero((ranges >= least_m) & (ranges <= most_m))
    shape = (int(ring.max(initial=-1)) + 1, int(column.max(initial=-1)) + 1)
    rows = np.full(shape, NONE, np.int64)
    rows[ring[inside], column[inside]] = inside
    return RangeImage(points, rows)


@compiled()
def ground_of(image: RangeImage) -> np.ndarray:
    """Return which points belong to the ground, (N,) bool.

    Column by column upwards: two returns, one after the other and below the sensor, between which
    it does not rise or fall by more than 10 deg (Himmelsbach 2010, as LeGO-LOAM uses it).
    """
    points, rows = image
    ground = np.zeros(len(points), np.bool_)
    for c in range(rows.shape[1]):
        below = NONE
        for r in range(rows.shape[0]):
            n = rows[r, c]
            if n == NONE:
                continue
            if points[n, 2] >= 0.0:
                break
            if below != NONE:
                x, y = points[n, 0] - points[below, 0], points[n, 1] - points[below, 1]
                rise = points[n, 2] - points[below, 2]
                if abs(rise) <= LEVEL * math.sqrt(x * x + y * y):
                    ground[n] = ground[below] = True
            below = n
    return ground


@compiled()
def objects_of(image: RangeImage, ground: np.ndarray, least: int) -> np.ndarray:
    """Return the object, (N,) int64 from 0 on, of each point; -1 for ground and small objects.

    Objects spread from return to return beside or above one another where the line between both
    is steep to the beam; those with fewer than `least` returns are dropped.
    """
    points, rows = image
    rings, columns = rows.shape
    labels, queue = np.full(len(points), NONE, np.int64), np.empty(len(points), np.int64)
    cells = np.empty((len(points), 2), np.int64)
    for r in range(rings):
        for c in range(columns):
            if rows[r, c] != NONE:
                cells[rows[r, c], 0], cells[rows[r, c], 1] = r, c
    count, visited = 0, ground.copy()
    for r in range(rings):
        for c in range(columns):
            n = rows[r, c]
            if n == NONE or visited[n]:
                continue
            size, done, queue[0], visited[n] = 1, 0, n, True
            while done < size:
                size = _spread(image, visited, cells[queue[done]], queue, size)
                done += 1
            if size >= least:
                labels[queue[:size]] = count
                count += 1
    return labels


@compiled()
def _spread(
    image: RangeImage, visited: np.ndarray, cell: np.ndarray, queue: np.ndarray, size: int
) -> int:
    """Append the neighbours of the same object to a queue of a size; return its new size."""
    points, rows = image
    r, c = cell
    n = rows[r, c]
    for side in range(4):
        up = r + (1 if side == 0 else -1 if side == 1 else 0)
        if up < 0 or up >= rows.shape[0]:
            continue
        m = rows[up, (c + (1 if side == 2 else -1 if side == 3 else 0)) % rows.shape[1]]
        if m != NONE and not visited[m] and _one_object(points[n], points[m]):
            visited[m] = True
            queue[size] = m
            size += 1
    return size


@compiled()
def _one_object(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether the angle at the farther return, between its beam and the other, is large."""
    ax, ay, az = np.float64(a[0]), np.float64(a[1]), np.float64(a[2])
    bx, by, bz = np.float64(b[0]), np.float64(b[1]), np.float64(b[2])
    aa, bb = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    ab = ax * bx + ay * by + az * bz
    # Both times the farther range: the offset across its beam, and along it.
    across = math.sqrt(max(aa * bb - ab * ab, 0.0))
    return math.atan2(across, max(aa, bb) - ab) > OBJECT_ANGLE_RAD


# --------------------------------------------------------------------------------------------------
# The returns that LeGO-LOAM uses: ground, and objects that are not small.

BOUNDS_M = (1.0, 120.0)
"""Least and greatest range of returns; nearer is the own vehicle."""
LEAST = 30
"""Objects of fewer returns, such as leaves, are not found again in the next scan."""
GROUND, OBJECT = 0, 1
"""Labels: features are matched only within the same label."""
LIMITS = FeatureLimits(
    sharp=2, edges=40, flat=4, planes=80, edge_above=5e-3, plane_below=5e-3, thin_m=0.0
)
"""Features of each sixth of a ring; their numbers are as published. The bound of the roughness is
our reading, LOAM's 5e-3. The paper prints 0.1, which by its formula is a tenth of the range; only
edges that hide something are that rough."""


def ground_and_objects(scan: LidarScan, *, least: int = LEAST) -> ScanReturns:
    """Return ground, and objects of at least that many returns, of a scan."""
    image = range_image(scan.points, scan.ring, scan.column, *BOUNDS_M)
    ground = ground_of(image)
    rows = np.flatnonzero(ground | (objects_of(image, ground, least) >= 0))
    return ScanReturns(
        scan.points[rows].astype(float),
        scan.ring[rows].astype(np.int64),
        scan.column[rows].astype(np.int64),
        scan.time_offset_s[rows].astype(float),
        rows,
        np.where(ground[rows], GROUND, OBJECT),
    )


def features_of(returns: ScanReturns, points: np.ndarray) -> Features:
    """Return edges of objects, and planes; the matched planes belong to the ground.

    points: (N, 3) metres, deskewed to the scan's stamp.
    """
    ground = returns.labels == GROUND
    return extract(
        points,
        returns.ring,
        returns.column,
        returns.labels,
        limits=LIMITS,
        edge_rows=~ground,
        flat_rows=ground,
    )
