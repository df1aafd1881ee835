"""Where rays first hit uneven ground: exact hits on a bilinear height field.

A ray is followed from tile to tile and, where it comes below the greatest height of a tile, from
cell to cell. Over one cell its height above the ground is a quadratic in t.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import GROUND
from roadscope.core.jit import compiled
from roadscope.envs.raycast.batch import WIDTH, least, load
from roadscope.envs.raycast.depth import NOTHING, Depth
from roadscope.envs.traffic.terrain import CELL_M, TILE, HeightGrid


class FieldRay(NamedTuple):
    """A ray over the grid: at t it is at (u + t du, v + t dv), in cells, and z + t dz, in metres.

    t is the distance along the ray in units of the length of its direction, so it is 1 / q.
    """

    u: float
    v: float
    z: float
    du: float
    dv: float
    dz: float


@compiled(borrowing=True)
def cast_ground(
    slopes: np.ndarray,
    ground_reflectivity: float,
    world: np.ndarray,
    grid: HeightGrid,
    depth: Depth,
) -> None:
    """Reset the buffer to the ground of the grid, or to no hit at the greatest range.

    slopes: (B,). world: as in `kernels.Scratch`. depth: `far` is filled in already.
    """
    for j in range(len(slopes)):
        s = slopes[j]
        for i in range(WIDTH):
            ray = FieldRay(
                (world[0, i] - grid.x) / CELL_M,
                (world[1, i] - grid.y) / CELL_M,
                world[6, i],
                (world[2, i] + s * world[4, i]) / CELL_M,
                (world[3, i] + s * world[5, i]) / CELL_M,
                world[7, i] + s * world[8, i],
            )
            far = depth.far[j, i]
            t, fall, length = _first_hit(grid.heights, grid.tops, ray, 1.0 / far)
            hit = t > 0.0
            depth.q[j, i] = 1.0 / t if hit else far
            depth.plane_distances[j, i] = t * fall / length
            depth.owners[j, i] = GROUND if hit else NOTHING
            depth.reflectivity[j, i] = ground_reflectivity if hit else 0.0
        depth.floors[j] = least(load(depth.q, j))


@compiled(borrowing=True)
def _first_hit(
    heights: np.ndarray, tops: np.ndarray, ray: FieldRay, end: float
) -> tuple[float, float, float]:
    """Return t of the first hit up to the end, 0 without one; fall and length as `_hit_in_cell`.

    heights, tops: as in `HeightGrid`.
    """
    t, end = _clip(ray.u, ray.du, heights.shape[0] - 1, 0.0, end)
    t, end = _clip(ray.v, ray.dv, heights.shape[1] - 1, t, end)
    if t >= end:
        return 0.0, 0.0, 1.0
    i = _cell(ray.u + t * ray.du, TILE, 0, tops.shape[0])
    j = _cell(ray.v + t * ray.dv, TILE, 0, tops.shape[1])
    if _height_above(heights, ray, t) <= 0.0:
        return 0.0, 0.0, 1.0
    while 0 <= i < tops.shape[0] and 0 <= j < tops.shape[1] and t < end:
        leave_u = _leaving(ray.u, ray.du, i, TILE)
        leave_v = _leaving(ray.v, ray.dv, j, TILE)
        leave = max(t, min(end, min(leave_u, leave_v)))
        if ray.z + ray.dz * (leave if ray.dz < 0.0 else t) <= tops[i, j]:
            hit, fall, length = _hit_in_tile(heights, ray, i, j, t, leave)
            if hit > 0.0:
                return hit, fall, length
        t = leave
        if leave_u <= leave_v:
            i += 1 if ray.du > 0.0 else -1
        else:
            j += 1 if ray.dv > 0.0 else -1
    return 0.0, 0.0, 1.0


@compiled(borrowing=True)
def _hit_in_tile(
    heights: np.ndarray, ray: FieldRay, tile_i: int, tile_j: int, t: float, end: float
) -> tuple[float, float, float]:
    """Return the same as `_first_hit`, for a ray that is over one tile from t to the end."""
    low_i, low_j = TILE * tile_i, TILE * tile_j
    i = _cell(ray.u + t * ray.du, 1, low_i, low_i + TILE)
    j = _cell(ray.v + t * ray.dv, 1, low_j, low_j + TILE)
    while low_i <= i < low_i + TILE and low_j <= j < low_j + TILE:
        leave_u, leave_v = _leaving(ray.u, ray.du, i, 1), _leaving(ray.v, ray.dv, j, 1)
        leave = max(t, min(end, min(leave_u, leave_v)))
        hit, fall, length = _hit_in_cell(heights, ray, i, j, t, leave)
        if hit > 0.0:
            return hit, fall, length
        if leave >= end:
            break
        t = leave
        if leave_u <= leave_v:
            i += 1 if ray.du > 0.0 else -1
        else:
            j += 1 if ray.dv > 0.0 else -1
    return 0.0, 0.0, 1.0


@compiled(borrowing=True)
def _hit_in_cell(
    heights: np.ndarray, ray: FieldRay, i: int, j: int, t: float, end: float
) -> tuple[float, float, float]:
    """Return t of the hit, 0 without one, and at the hit the ray's fall and the normal's length.

    The fall is what the ray loses of its height above the ground per t, metres. The normal is the
    one whose z is 1. The ray is over the cell from t to the end.
    """
    h, along, across = heights[i, j], heights[i + 1, j], heights[i, j + 1]
    twist = heights[i + 1, j + 1] - along - across + h
    along, across = along - h, across - h
    u, v = ray.u + t * ray.du - i, ray.v + t * ray.dv - j
    over = ray.z + t * ray.dz - (h + along * u + across * v + twist * u * v)
    climb = ray.dz - (along + twist * v) * ray.du - (across + twist * u) * ray.dv
    bend = -twist * ray.du * ray.dv
    after = 0.0
    if over > 0.0:
        square = climb * climb - 4.0 * over * bend
        if square < 0.0:
            return 0.0, 0.0, 1.0
        fall = np.sqrt(square) - climb
        if fall <= 0.0:
            return 0.0, 0.0, 1.0
        after = 2.0 * over / fall
        if t + after > end:
            return 0.0, 0.0, 1.0
    u, v = u + after * ray.du, v + after * ray.dv
    along, across = along + twist * v, across + twist * u
    fall = along * ray.du + across * ray.dv - ray.dz
    x, y = along / CELL_M, across / CELL_M
    return t + after, fall, np.sqrt(1.0 + x * x + y * y)


@compiled(borrowing=True)
def _height_above(heights: np.ndarray, ray: FieldRay, t: float) -> float:
    """Return the height of a ray above the ground, metres."""
    u, v = ray.u + t * ray.du, ray.v + t * ray.dv
    i, j = _cell(u, 1, 0, heights.shape[0] - 1), _cell(v, 1, 0, heights.shape[1] - 1)
    u, v = u - i, v - j
    near = heights[i, j] * (1.0 - v) + heights[i, j + 1] * v
    far = heights[i + 1, j] * (1.0 - v) + heights[i + 1, j + 1] * v
    over: float = ray.z + t * ray.dz - near * (1.0 - u) - far * u
    return over


@compiled(forceinline=True, borrowing=True)
def _clip(u: float, du: float, size: int, start: float, end: float) -> tuple[float, float]:
    """Return the part of a ray from start to end with 0 <= u + t du <= size."""
    if du == 0.0:
        return start, (end if 0.0 <= u <= size else -1.0)
    one, other = -u / du, (size - u) / du
    return max(start, min(one, other)), min(end, max(one, other))


@compiled(forceinline=True, borrowing=True)
def _cell(u: float, size: int, low: int, high: int) -> int:
    """Return the number of the cell of `size` in which u lies, limited to low up to high - 1."""
    return min(max(int(np.floor(u / size)), low), high - 1)


@compiled(forceinline=True, borrowing=True)
def _leaving(u: float, du: float, cell: int, size: int) -> float:
    """Return t at which a ray leaves a cell of `size` in one direction."""
    if du == 0.0:
        return np.inf
    return ((cell + (1 if du > 0.0 else 0)) * size - u) / du
