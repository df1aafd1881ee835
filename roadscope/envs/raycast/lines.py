"""The ray caster's inner loops: one block of columns against the units it may see.

A column spans a plane, and its ray of slope s is met at parameter u where a half-plane
n.p <= c becomes (A + B s) u <= C with A = n.ahead, B = n.up, C = c - n.origin. With q = 1/u this
is q <= (A + B s) / C for faces turned to the origin (C < 0) and q >= (A + B s) / C for the others:
per face one straight line over s, no division per ray. A prism is met where the least upper line
is not below the greatest lower one, and the nearest surface is the one with the greatest q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.raycast.blocks import Blocks, Rays
from roadscope.envs.raycast.depth import Depth
from roadscope.envs.raycast.lanes import WIDTH, count, load, pick, put, spread
from roadscope.envs.raycast.shapes import Shapes
from roadscope.envs.world.prisms import MAX_EDGES

LINES = MAX_EDGES + 2
LEAF_COSINE = 0.5
"""Mean cosine of incidence on leaves that face every way alike."""

_TINY = 1e-300


class Scratch(NamedTuple):
    """Work space of one block, rows of `WIDTH`.

    world: (9, WIDTH) x y of origin, ahead, up, then z of the three, in the world's frame.
    local: (6, WIDTH) x y of origin, ahead, up in the unit's frame.
    turns: (4, WIDTH) x, y, cosine and sine of yaw of the unit.
    upper, lower: (14 * 3, WIDTH) lines of a prism: constants, slopes, distance of the origin
    from the face; where a face is turned the other way, a line that never binds.
    met: (3, WIDTH) where rays enter and leave, and the distance of the face they enter by.
    touched: (B, WIDTH) 1 for rays that reach the outline of a body.
    """

    world: np.ndarray
    local: np.ndarray
    turns: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    met: np.ndarray
    touched: np.ndarray


@compiled(borrowing=True)
def draw_level(shapes: Shapes, m: int, scratch: Scratch) -> tuple[int, int]:
    """Write the lines of a prism whose sides are upright to level columns.

    The lines of all sides are flat then, so the binding ones are known before any beam is.
    """
    local, planes = scratch.local, shapes.planes
    x, y, ahead_x, ahead_y = load(local, 0), load(local, 1), load(local, 2), load(local, 3)
    enter, leave, face = spread(np.inf), spread(0.0), spread(0.0)
    for k in range(shapes.corners[m]):
        nx, ny = planes[m, k, 0], planes[m, k, 1]
        room = planes[m, k, 2] - nx * x - ny * y
        room = pick(room == 0.0, spread(_TINY), room)
        line = (nx * ahead_x + ny * ahead_y) / room
        turned = room < 0.0
        nearer = turned & (line < enter)
        enter = pick(nearer, line, enter)
        face = pick(nearer, 0.0 - room, face)
        leave = pick((room > 0.0) & (line > leave), line, leave)
    if count(leave <= enter) == 0:
        return 0, 0
    put(scratch.upper, 0, enter)
    put(scratch.upper, 1, spread(0.0))
    put(scratch.upper, 2, face)
    put(scratch.lower, 0, leave)
    put(scratch.lower, 1, spread(0.0))
    return _draw_lids(shapes.heights, m, 1, 1, scratch)


@compiled(borrowing=True)
def draw(shapes: Shapes, m: int, scratch: Scratch) -> tuple[int, int]:
    """Write the prism's lines; return how many upper and lower ones there are."""
    local, planes = scratch.local, shapes.planes
    x, y, ahead_x, ahead_y = load(local, 0), load(local, 1), load(local, 2), load(local, 3)
    up_x, up_y = load(local, 4), load(local, 5)
    upper = lower = 0
    for k in range(shapes.corners[m]):
        nx, ny = planes[m, k, 0], planes[m, k, 1]
        room = planes[m, k, 2] - nx * x - ny * y
        upper, lower = _draw_line(
            room, nx * ahead_x + ny * ahead_y, nx * up_x + ny * up_y, upper, lower, scratch
        )
    return _draw_lids(shapes.heights, m, upper, lower, scratch)


@compiled(forceinline=True, borrowing=True)
def _draw_lids(
    heights: np.ndarray, m: int, upper: int, lower: int, scratch: Scratch
) -> tuple[int, int]:
    """Write the lines of bottom and top after the given numbers of lines."""
    z, ahead_z, up_z = load(scratch.world, 6), load(scratch.world, 7), load(scratch.world, 8)
    upper, lower = _draw_line(z - heights[m, 0], 0.0 - ahead_z, 0.0 - up_z, upper, lower, scratch)
    return _draw_line(heights[m, 1] - z, ahead_z, up_z, upper, lower, scratch)


@compiled(forceinline=True, borrowing=True)
def _draw_line(
    room: float, a: float, b: float, upper: int, lower: int, scratch: Scratch
) -> tuple[int, int]:
    """Write the line (a + b s) / room among those it may bind with; all three are lanes."""
    room = pick(room == 0.0, spread(_TINY), room)
    turned = room < 0.0
    inverse = 1.0 / room
    behind = count(turned)
    if behind > 0:
        put(scratch.upper, 3 * upper, pick(turned, a * inverse, spread(np.inf)))
        put(scratch.upper, 3 * upper + 1, pick(turned, b * inverse, spread(0.0)))
        put(scratch.upper, 3 * upper + 2, 0.0 - room)
        upper += 1
    if behind < WIDTH:
        put(scratch.lower, 3 * lower, pick(turned, spread(-np.inf), a * inverse))
        put(scratch.lower, 3 * lower + 1, pick(turned, spread(0.0), b * inverse))
        lower += 1
    return upper, lower


@compiled(forceinline=True, borrowing=True)
def clip(s: float, upper: int, lower: int, scratch: Scratch) -> None:
    """Find where the rays of slope s enter and leave; entering is inf where they are inside."""
    uppers, lowers = scratch.upper, scratch.lower
    enter = load(uppers, 0) + s * load(uppers, 1)
    face = load(uppers, 2)
    for k in range(1, upper):
        line = load(uppers, 3 * k) + s * load(uppers, 3 * k + 1)
        nearer = line < enter
        enter = pick(nearer, line, enter)
        face = pick(nearer, load(uppers, 3 * k + 2), face)
    leave = spread(0.0)
    for k in range(lower):
        line = load(lowers, 3 * k) + s * load(lowers, 3 * k + 1)
        leave = pick(line > leave, line, leave)
    put(scratch.met, 0, enter)
    put(scratch.met, 1, leave)
    put(scratch.met, 2, face)


@compiled(forceinline=True, borrowing=True)
def meet(j: int, shapes: Shapes, m: int, met: np.ndarray, depth: Depth) -> None:
    """Enter a solid prism into the depth buffer."""
    enter, q = load(met, 0), load(depth.q, j)
    nearer = (load(met, 1) <= enter) & (q < enter) & (enter < np.inf)
    put(depth.q, j, pick(nearer, enter, q))
    put(depth.faces, j, pick(nearer, load(met, 2), load(depth.faces, j)))
    owner, reflectivity = 1.0 * shapes.owners[m], 1.0 * shapes.reflectivities[m]
    put(depth.owners, j, pick(nearer, spread(owner), load(depth.owners, j)))
    put(depth.reflectivity, j, pick(nearer, spread(reflectivity), load(depth.reflectivity, j)))


@compiled(forceinline=True, borrowing=True)
def touch(j: int, scratch: Scratch, depth: Depth) -> None:
    """Mark the rays that meet the prism within the greatest range, whatever is in front."""
    enter, leave = load(scratch.met, 0), load(scratch.met, 1)
    met = (leave <= enter) & (load(depth.far, j) < enter) & (enter < np.inf)
    put(scratch.touched, j, pick(met, spread(1.0), load(scratch.touched, j)))


@compiled(borrowing=True)
def enter_porous(
    rays: Rays,
    blocks: Blocks,
    n: int,
    shapes: Shapes,
    m: int,
    j: int,
    entered: np.ndarray,
    seed: int,
    depth: Depth,
) -> None:
    """Enter a porous prism: each ray meets it after a path of its own, or passes through."""
    for i in range(min(WIDTH, len(blocks.order) - n * WIDTH)):
        enter, leave = entered[0, i], entered[1, i]
        if leave <= enter < np.inf and enter > depth.q[j, i]:
            c = blocks.order[n * WIDTH + i]
            path = free_path(seed, shapes.sources[m], c, j, rays.stamps_s[c])
            reach = depth.far[j, i] * depth.max_range_m
            met = reach / (reach / enter + path / shapes.extinctions[m])
            if met >= leave and met > depth.q[j, i]:
                depth.q[j, i] = met
                depth.faces[j, i] = LEAF_COSINE * reach / met
                depth.owners[j, i] = shapes.owners[m]
                depth.reflectivity[j, i] = shapes.reflectivities[m]


@compiled(borrowing=True)
def free_path(seed: int, source: int, column: int, beam: int, stamp_s: float) -> float:
    """Draw an exponentially distributed path with rate 1 that depends on the arguments alone."""
    state = np.uint64(seed)
    for part in (source, column, beam, np.int64(np.rint(stamp_s * 1e9))):
        state = mix(state + np.uint64(part) + np.uint64(0x9E3779B97F4A7C15))
    uniform = (np.float64(state >> np.uint64(11)) + 1.0) * 2.0**-53
    path: float = -np.log(uniform)
    return path


@compiled(borrowing=True)
def mix(state: np.uint64) -> np.uint64:
    """Scramble 64 bits (the finaliser of Steele, Lea and Flood's SplitMix, 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))
