"""The ray caster's inner loops: one block of columns against one prism.

A ray of a column has the direction ahead + s * up, where s is the slope of its beam. Along the ray,
let q be the reciprocal of the distance to the plane of a face, in units of that direction's length.
In one column q is linear in s: a line. A face that is turned towards the sensor gives an upper
line, a face that is turned away gives a lower line. A ray enters a prism at the least q of its
upper lines and leaves it at the greatest q of its lower lines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.raycast.batch import WIDTH, count, load, pick, put, spread
from roadscope.envs.raycast.blocks import Blocks, RayColumns
from roadscope.envs.raycast.depth import Depth
from roadscope.envs.raycast.shapes import Shapes
from roadscope.envs.world.prisms import MAX_EDGES

LINES = MAX_EDGES + 2
"""Most faces of a prism: its sides, bottom and top."""
SPLITMIX_STEP = np.uint64(0x9E3779B97F4A7C15)
"""Increment of a random state before it is scrambled (Steele, Lea and Flood's SplitMix, 2014)."""
LEAF_COSINE = 0.5
"""Mean cosine of incidence on leaves with uniformly distributed directions."""

_TINY = 1e-300
"""Replaces a distance of zero in divisions, metres."""


class Scratch(NamedTuple):
    """Work space of one block, rows of `WIDTH`.

    world: (9, WIDTH) x y of origin, ahead, up, then z of the three, in the world's frame.
    local: (9, WIDTH) the same in the unit's frame.
    turns: (7, WIDTH) x, y, cosine and sine of yaw of the unit; its height, rise and lean.
    upper, lower: (14 * 3, WIDTH) three rows for each line of a prism: its constant, its slope, and
    in upper lines the distance of the origin from the plane of the face. A face that is turned
    towards some columns and away from others has a line in both; in the columns where it does not
    belong, that line is never the least or the greatest.
    crossings: (3, WIDTH) q where rays enter and leave, and the distance of the origin from the
    plane of the face through which they enter.
    touched: (B, WIDTH) 1 for rays that reach the outline of a body.
    """

    world: np.ndarray
    local: np.ndarray
    turns: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    crossings: np.ndarray
    touched: np.ndarray


@compiled(borrowing=True)
def write_level_lines(shapes: Shapes, m: int, scratch: Scratch) -> tuple[int, int]:
    """Write the lines of a prism for level columns; return the numbers of upper and lower ones.

    The sides are upright, so their lines do not depend on s: one upper and one lower line stand for
    all sides.
    """
    local, planes = scratch.local, shapes.planes
    x, y, ahead_x, ahead_y = load(local, 0), load(local, 1), load(local, 2), load(local, 3)
    enter, leave, plane_distance = spread(np.inf), spread(0.0), spread(0.0)
    for k in range(shapes.corners[m]):
        nx, ny = planes[m, k, 0], planes[m, k, 1]
        distance = planes[m, k, 2] - nx * x - ny * y
        distance = pick(distance == 0.0, spread(_TINY), distance)
        line = (nx * ahead_x + ny * ahead_y) / distance
        towards = distance < 0.0
        nearer = towards & (line < enter)
        enter = pick(nearer, line, enter)
        plane_distance = pick(nearer, 0.0 - distance, plane_distance)
        leave = pick((distance > 0.0) & (line > leave), line, leave)
    if count(leave <= enter) == 0:
        return 0, 0
    put(scratch.upper, 0, enter)
    put(scratch.upper, 1, spread(0.0))
    put(scratch.upper, 2, plane_distance)
    put(scratch.lower, 0, leave)
    put(scratch.lower, 1, spread(0.0))
    return _write_bottom_and_top(shapes.heights, m, 1, 1, 1.0, scratch)


@compiled(borrowing=True)
def write_lines(shapes: Shapes, m: int, flatness: float, scratch: Scratch) -> tuple[int, int]:
    """Write the lines of a prism; return the numbers of upper and lower ones.

    flatness: cosine of the slope of bottom and top in a frame that is sheared.
    """
    local, planes = scratch.local, shapes.planes
    x, y, ahead_x, ahead_y = load(local, 0), load(local, 1), load(local, 2), load(local, 3)
    up_x, up_y = load(local, 4), load(local, 5)
    upper = lower = 0
    for k in range(shapes.corners[m]):
        nx, ny = planes[m, k, 0], planes[m, k, 1]
        distance = planes[m, k, 2] - nx * x - ny * y
        upper, lower = _write_line(
            distance, nx * ahead_x + ny * ahead_y, nx * up_x + ny * up_y, 1.0, upper, lower, scratch
        )
    return _write_bottom_and_top(shapes.heights, m, upper, lower, flatness, scratch)


@compiled(forceinline=True, borrowing=True)
def _write_bottom_and_top(
    heights: np.ndarray, m: int, upper: int, lower: int, flatness: float, scratch: Scratch
) -> tuple[int, int]:
    """Write the lines of bottom and top after the given numbers of lines."""
    z, ahead_z, up_z = load(scratch.local, 6), load(scratch.local, 7), load(scratch.local, 8)
    upper, lower = _write_line(
        z - heights[m, 0], 0.0 - ahead_z, 0.0 - up_z, flatness, upper, lower, scratch
    )
    return _write_line(heights[m, 1] - z, ahead_z, up_z, flatness, upper, lower, scratch)


@compiled(forceinline=True, borrowing=True)
def _write_line(
    distance: float, a: float, b: float, metres: float, upper: int, lower: int, scratch: Scratch
) -> tuple[int, int]:
    """Write the line q = (a + b s) / distance as an upper line, a lower one or both.

    distance, a, b: batches; a negative distance means that the face is turned towards the column.
    metres: length of one unit of distance. upper, lower: numbers of lines so far.
    Returns the new numbers of lines.
    """
    distance = pick(distance == 0.0, spread(_TINY), distance)
    towards = distance < 0.0
    inverse = 1.0 / distance
    facing = count(towards)
    if facing > 0:
        put(scratch.upper, 3 * upper, pick(towards, a * inverse, spread(np.inf)))
        put(scratch.upper, 3 * upper + 1, pick(towards, b * inverse, spread(0.0)))
        put(scratch.upper, 3 * upper + 2, (0.0 - distance) * metres)
        upper += 1
    if facing < WIDTH:
        put(scratch.lower, 3 * lower, pick(towards, spread(-np.inf), a * inverse))
        put(scratch.lower, 3 * lower + 1, pick(towards, spread(0.0), b * inverse))
        lower += 1
    return upper, lower


@compiled(forceinline=True, borrowing=True)
def clip(s: float, upper: int, lower: int, scratch: Scratch) -> None:
    """Write q where the rays of slope s enter and leave; q of entering is inf for those inside."""
    uppers, lowers = scratch.upper, scratch.lower
    enter = load(uppers, 0) + s * load(uppers, 1)
    plane_distance = load(uppers, 2)
    for k in range(1, upper):
        line = load(uppers, 3 * k) + s * load(uppers, 3 * k + 1)
        nearer = line < enter
        enter = pick(nearer, line, enter)
        plane_distance = pick(nearer, load(uppers, 3 * k + 2), plane_distance)
    leave = spread(0.0)
    for k in range(lower):
        line = load(lowers, 3 * k) + s * load(lowers, 3 * k + 1)
        leave = pick(line > leave, line, leave)
    put(scratch.crossings, 0, enter)
    put(scratch.crossings, 1, leave)
    put(scratch.crossings, 2, plane_distance)


@compiled(forceinline=True, borrowing=True)
def add_solid(j: int, shapes: Shapes, m: int, crossings: np.ndarray, depth: Depth) -> None:
    """Write a solid prism into the depth buffer where it is the nearest surface."""
    enter, q = load(crossings, 0), load(depth.q, j)
    nearer = (load(crossings, 1) <= enter) & (q < enter) & (enter < np.inf)
    put(depth.q, j, pick(nearer, enter, q))
    put(depth.plane_distances, j, pick(nearer, load(crossings, 2), load(depth.plane_distances, j)))
    owner, reflectivity = 1.0 * shapes.owners[m], 1.0 * shapes.reflectivities[m]
    put(depth.owners, j, pick(nearer, spread(owner), load(depth.owners, j)))
    put(depth.reflectivity, j, pick(nearer, spread(reflectivity), load(depth.reflectivity, j)))


@compiled(forceinline=True, borrowing=True)
def mark_touched(j: int, scratch: Scratch, depth: Depth) -> None:
    """Mark the rays that hit the prism within the greatest range, occluded or not."""
    enter, leave = load(scratch.crossings, 0), load(scratch.crossings, 1)
    hit = (leave <= enter) & (load(depth.far, j) < enter) & (enter < np.inf)
    put(scratch.touched, j, pick(hit, spread(1.0), load(scratch.touched, j)))


@compiled(borrowing=True)
def add_porous(
    rays: RayColumns,
    blocks: Blocks,
    n: int,
    shapes: Shapes,
    m: int,
    j: int,
    crossings: np.ndarray,
    seed: int,
    depth: Depth,
) -> None:
    """Write a porous prism into the depth buffer: rays hit it after a random path or not at all."""
    for i in range(min(WIDTH, len(blocks.order) - n * WIDTH)):
        enter, leave = crossings[0, i], crossings[1, i]
        if leave <= enter < np.inf and enter > depth.q[j, i]:
            c = blocks.order[n * WIDTH + i]
            path = free_path(seed, shapes.sources[m], c, j, rays.stamps_s[c])
            reach = depth.far[j, i] * depth.max_range_m
            q_hit = reach / (reach / enter + path / shapes.extinctions[m])
            if q_hit >= leave and q_hit > depth.q[j, i]:
                depth.q[j, i] = q_hit
                depth.plane_distances[j, i] = LEAF_COSINE * reach / q_hit
                depth.owners[j, i] = shapes.owners[m]
                depth.reflectivity[j, i] = shapes.reflectivities[m]


@compiled(borrowing=True)
def free_path(seed: int, source: int, column: int, beam: int, stamp_s: float) -> float:
    """Return a pseudo-random path length, exponential with rate 1; a function of the arguments."""
    state = np.uint64(seed)
    for part in (source, column, beam, np.int64(np.rint(stamp_s * 1e9))):
        state = mix(state + np.uint64(part) + SPLITMIX_STEP)
    uniform = (np.float64(state >> np.uint64(11)) + 1.0) * 2.0**-53
    path: float = -np.log(uniform)
    return path


@compiled(borrowing=True)
def mix(state: np.uint64) -> np.uint64:
    """Scramble 64 bits (the finaliser of SplitMix)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))
