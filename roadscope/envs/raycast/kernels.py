"""The ray caster's inner loops: each block of columns against the units that it may hit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.raycast.batch import WIDTH, least, load, put, root
from roadscope.envs.raycast.blocks import (
    SLACK,
    ActorMotion,
    Blocks,
    BlockUnits,
    RayColumns,
    Stances,
    bound_motion,
    bound_stances,
    sort_into_blocks,
    units_by_block,
)
from roadscope.envs.raycast.depth import Depth, Surfaces, clear, load_columns, store
from roadscope.envs.raycast.height_field import cast_ground
from roadscope.envs.raycast.prism_hits import (
    LINES,
    Scratch,
    add_porous,
    add_solid,
    clip,
    mark_touched,
    write_level_lines,
    write_lines,
)
from roadscope.envs.raycast.shapes import STILL, Shapes, fill_planes
from roadscope.envs.traffic.terrain import HeightGrid

_SMALL_TURN_RAD = 0.05
"""Turns below this are computed by a Taylor series."""


class CastWorld(NamedTuple):
    """All surfaces that rays may hit up to the greatest range.

    poses: (K, A, 3) x, y, yaw of the actors at knots_s (K,). seed: of the free paths in foliage.
    uneven: whether the ground is that of the grid, on which units stand as in `Stances`.
    """

    shapes: Shapes
    poses: np.ndarray
    knots_s: np.ndarray
    seed: int
    ground_reflectivity: float
    max_range_m: float
    uneven: bool
    grid: HeightGrid
    shears: np.ndarray
    tilts: np.ndarray


class UnitPose(NamedTuple):
    """Pose of a unit at a block's first column, and its greatest motion within the block.

    x, y: metres. cosine, sine: of the yaw. drift, turn: bounds of its shift, which includes that of
        the rays' origins, and of its turn within the block, metres and radians.
    low, high, slope: of `Stances.bounds`. lever: 1 if the unit turns about its frame's origin as
        it tilts, 0 if it is sheared in its place. flatness: as in `write_lines`.
    """

    x: float
    y: float
    cosine: float
    sine: float
    drift: float
    turn: float
    low: float
    high: float
    slope: float
    lever: float
    flatness: float


@compiled()
def cast_all(rays: RayColumns, world: CastWorld, surfaces: Surfaces, outline: np.ndarray) -> None:
    """Fill the surfaces; add the rays that reach each actor's outline to outline, (A,) or empty."""
    shapes, max_range_m = world.shapes, world.max_range_m
    blocks, motion = sort_into_blocks(rays), bound_motion(world.poses, world.knots_s)
    stances = bound_stances(shapes, world.shears, world.tilts, world.uneven)
    units = units_by_block(rays, blocks, shapes, motion, stances, max_range_m)
    beams = len(rays.slopes)
    depth = Depth(
        np.empty((beams, WIDTH)),
        np.empty((beams, WIDTH)),
        np.empty((beams, WIDTH)),
        np.empty((beams, WIDTH)),
        np.empty((beams, WIDTH)),
        np.empty(beams),
        max_range_m,
    )
    scratch = Scratch(
        np.empty((9, WIDTH)),
        np.empty((9, WIDTH)),
        np.empty((7, WIDTH)),
        np.empty((3 * LINES, WIDTH)),
        np.empty((3 * LINES, WIDTH)),
        np.empty((3, WIDTH)),
        np.zeros((beams, WIDTH)),
    )
    _cast_blocks(
        rays,
        blocks,
        units,
        shapes,
        motion,
        stances,
        world.grid,
        world.seed,
        world.ground_reflectivity,
        scratch,
        depth,
        surfaces,
        outline,
    )


@compiled(borrowing=True)
def _cast_blocks(
    rays: RayColumns,
    blocks: Blocks,
    units: BlockUnits,
    shapes: Shapes,
    motion: ActorMotion,
    stances: Stances,
    grid: HeightGrid,
    seed: int,
    ground_reflectivity: float,
    scratch: Scratch,
    depth: Depth,
    surfaces: Surfaces,
    outline: np.ndarray,
) -> None:
    """Cast all blocks against their units. It makes no arrays, see `borrowing` of `compiled`."""
    for n in range(len(blocks.lows)):
        load_columns(rays, blocks, n, scratch.world)
        clear(rays.slopes, ground_reflectivity, scratch.world, depth)
        if stances.uneven:
            cast_ground(rays.slopes, ground_reflectivity, scratch.world, grid, depth)
        for i in range(units.starts[n], units.starts[n + 1]):
            _cast_unit(
                rays,
                blocks,
                n,
                shapes,
                motion,
                stances,
                units.units[i],
                seed,
                scratch,
                depth,
                outline,
            )
        store(blocks, n, depth, surfaces)


# Inlined: passing the fields of all records to it takes as long as casting a unit.
@compiled(forceinline=True, borrowing=True)
def _cast_unit(
    rays: RayColumns,
    blocks: Blocks,
    n: int,
    shapes: Shapes,
    motion: ActorMotion,
    stances: Stances,
    unit: int,
    seed: int,
    scratch: Scratch,
    depth: Depth,
    outline: np.ndarray,
) -> None:
    """Cast the rays of block n against the prisms of a unit."""
    actor = shapes.unit_poses[unit]
    first, last = shapes.unit_starts[unit], shapes.unit_starts[unit + 1]
    counted = len(outline) > 0 and actor != STILL
    pose = _unit_pose(rays, blocks, n, motion, stances, actor, unit)
    floors = depth.floors
    low, high = _beams_to_test(
        rays, blocks, n, pose, shapes.unit_circles, shapes.unit_heights, unit, floors, counted
    )
    if low >= high:
        return
    _localise(rays, blocks, n, motion, actor, scratch)
    if stances.uneven:
        _apply_stances(rays, blocks, n, stances, shapes.unit_circles, unit, actor, scratch)
    for m in range(first, last):
        if last - first > 1:
            low, high = _beams_to_test(
                rays, blocks, n, pose, shapes.circles, shapes.heights, m, floors, counted
            )
        if low >= high:
            continue
        if not shapes.ready[m]:
            fill_planes(shapes, m)
        if rays.level:
            upper, lower = write_level_lines(shapes, m, scratch)
        else:
            upper, lower = write_lines(shapes, m, pose.flatness, scratch)
        if upper == 0:
            continue
        for j in range(low, high):
            clip(rays.slopes[j], upper, lower, scratch)
            if counted:
                mark_touched(j, scratch, depth)
            if shapes.extinctions[m] > 0.0:
                add_porous(rays, blocks, n, shapes, m, j, scratch.crossings, seed, depth)
            else:
                add_solid(j, shapes, m, scratch.crossings, depth)
            floors[j] = least(load(depth.q, j))
    if counted:
        outline[actor] += _count_touched(scratch.touched, len(blocks.order) - n * WIDTH)


@compiled(borrowing=True)
def _unit_pose(
    rays: RayColumns,
    blocks: Blocks,
    n: int,
    motion: ActorMotion,
    stances: Stances,
    actor: int,
    unit: int,
) -> UnitPose:
    """Return the pose of a unit at the block's first column, and its change within the block."""
    low, high, slope = stances.bounds[unit, 0], stances.bounds[unit, 1], stances.bounds[unit, 2]
    if actor == STILL:
        flatness = 1.0
        if stances.uneven:
            along, across = stances.shears[unit, 1], stances.shears[unit, 2]
            flatness /= np.sqrt(1.0 + along * along + across * across)
        spread_m = blocks.spreads[n]
        return UnitPose(0.0, 0.0, 1.0, 0.0, spread_m, 0.0, low, high, slope, 0.0, flatness)
    x, y, yaw = _actor_pose(rays, motion, actor, blocks.order[n * WIDTH])
    duration = 2.0 * blocks.times[n, 1]
    drift = blocks.spreads[n] + motion.speeds[actor, 0] * duration
    turn = motion.speeds[actor, 1] * duration
    return UnitPose(x, y, np.cos(yaw), np.sin(yaw), drift, turn, low, high, slope, 1.0, 1.0)


@compiled(forceinline=True, borrowing=True)
def _actor_pose(
    rays: RayColumns, motion: ActorMotion, actor: int, c: int
) -> tuple[float, float, float]:
    """Return x, y and yaw of an actor at the time of column c."""
    poses, k, f = motion.poses, rays.knots[c], rays.fractions[c]
    after = min(k + 1, len(poses) - 1)
    x, y, yaw = poses[k, actor, 0], poses[k, actor, 1], poses[k, actor, 2]
    return (
        x + f * (poses[after, actor, 0] - x),
        y + f * (poses[after, actor, 1] - y),
        yaw + f * (poses[after, actor, 2] - yaw),
    )


@compiled(borrowing=True)
def _localise(
    rays: RayColumns, blocks: Blocks, n: int, motion: ActorMotion, actor: int, scratch: Scratch
) -> None:
    """Write the block's columns in the unit's frame at each column's time."""
    world, local, turns = scratch.world, scratch.local, scratch.turns
    if actor == STILL:
        for k in range(9):
            put(local, k, load(world, k))
        return
    for k in range(6, 9):
        put(local, k, load(world, k))
    _write_turns(rays, blocks, n, motion, actor, turns)
    cosine, sine = load(turns, 2), load(turns, 3)
    dx, dy = load(world, 0) - load(turns, 0), load(world, 1) - load(turns, 1)
    put(local, 0, cosine * dx + sine * dy)
    put(local, 1, cosine * dy - sine * dx)
    for k in (2, 4):
        dx, dy = load(world, k), load(world, k + 1)
        put(local, k, cosine * dx + sine * dy)
        put(local, k + 1, cosine * dy - sine * dx)


@compiled(borrowing=True)
def _apply_stances(
    rays: RayColumns,
    blocks: Blocks,
    n: int,
    stances: Stances,
    circles: np.ndarray,
    unit: int,
    actor: int,
    scratch: Scratch,
) -> None:
    """Shear or tilt the block's columns in the unit's frame, as the unit stands on the terrain."""
    local = scratch.local
    if actor == STILL:
        z, along, across = stances.shears[unit, 0], stances.shears[unit, 1], stances.shears[unit, 2]
        z -= along * circles[unit, 0] + across * circles[unit, 1]
        put(local, 6, load(local, 6) - z)
        for k in range(3):
            x, y = load(local, 2 * k), load(local, 2 * k + 1)
            put(local, 6 + k, load(local, 6 + k) - along * x - across * y)
        return
    _write_tilts(rays, blocks, n, stances.tilts, actor, scratch.turns)
    put(local, 6, load(local, 6) - load(scratch.turns, 4))
    rise, lean = load(scratch.turns, 5), load(scratch.turns, 6)
    pitch_length = root(1.0 + rise * rise)
    length = root(1.0 + rise * rise + lean * lean)
    # The body is pitched first, then rolled about its own axis, as the plane through the wheels.
    cos_pitch, sin_pitch = 1.0 / pitch_length, rise / pitch_length
    cos_roll, sin_roll = pitch_length / length, lean / length
    for k in range(3):
        x, y, z = load(local, 2 * k), load(local, 2 * k + 1), load(local, 6 + k)
        put(local, 2 * k, cos_pitch * x + sin_pitch * z)
        z = cos_pitch * z - sin_pitch * x
        put(local, 2 * k + 1, cos_roll * y + sin_roll * z)
        put(local, 6 + k, cos_roll * z - sin_roll * y)


@compiled(borrowing=True)
def _write_tilts(
    rays: RayColumns, blocks: Blocks, n: int, tilts: np.ndarray, actor: int, turns: np.ndarray
) -> None:
    """Write height, rise and lean of the actor at each column's time."""
    for i in range(WIDTH):
        c = blocks.order[min(n * WIDTH + i, len(blocks.order) - 1)]
        k, f = rays.knots[c], rays.fractions[c]
        after = min(k + 1, len(tilts) - 1)
        for part in range(3):
            start = tilts[k, actor, part]
            turns[4 + part, i] = start + f * (tilts[after, actor, part] - start)


@compiled(borrowing=True)
def _write_turns(
    rays: RayColumns, blocks: Blocks, n: int, motion: ActorMotion, actor: int, turns: np.ndarray
) -> None:
    """Write x, y, cosine and sine of yaw of the actor at each column's time."""
    first = last = cosine = sine = cosine0 = sine0 = np.inf
    for i in range(WIDTH):
        c = blocks.order[min(n * WIDTH + i, len(blocks.order) - 1)]
        x, y, yaw = _actor_pose(rays, motion, actor, c)
        if yaw != last:
            if abs(yaw - first) < _SMALL_TURN_RAD:
                cosine, sine = _turned_slightly(cosine0, sine0, yaw - first)
            else:
                cosine0, sine0 = np.cos(yaw), np.sin(yaw)
                first, cosine, sine = yaw, cosine0, sine0
            last = yaw
        turns[0, i], turns[1, i], turns[2, i], turns[3, i] = x, y, cosine, sine


@compiled(forceinline=True, borrowing=True)
def _turned_slightly(cosine: float, sine: float, turn: float) -> tuple[float, float]:
    """Return cosine and sine after a small turn in radians, by Taylor series to the last bits."""
    square = turn * turn
    c = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)))
    s = turn * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    return cosine * c - sine * s, sine * c + cosine * s


@compiled(forceinline=True, borrowing=True)
def _beams_to_test(
    rays: RayColumns,
    blocks: Blocks,
    n: int,
    pose: UnitPose,
    circles: np.ndarray,
    heights: np.ndarray,
    row: int,
    floors: np.ndarray,
    counted: bool,
) -> tuple[int, int]:
    """Return the half-open range of beams that may hit a cylinder before their nearest hit so far.

    row: of the cylinder in circles and heights. counted: keep beams with nearer hits too, because
    the outlines of the unit are counted.
    """
    cx, cy = circles[row, 0], circles[row, 1]
    x, y, cosine, sine = pose.x, pose.y, pose.cosine, pose.sine
    # A tilted unit reaches farther; bounds: sin(slope) <= slope, and 1 - cos(slope) <= slope^2.
    arm = pose.lever * (abs(cx) + abs(cy))
    bend = pose.lever * pose.slope * max(abs(heights[row, 0]), abs(heights[row, 1]))
    sag = pose.slope * (arm + circles[row, 2] + bend)
    dx = x + cosine * cx - sine * cy - blocks.centres[n, 0]
    dy = y + sine * cx + cosine * cy - blocks.centres[n, 1]
    reach = circles[row, 2] + pose.drift + pose.turn * (abs(cx) + abs(cy))
    reach += bend + pose.slope * pose.slope * arm
    distance = np.sqrt(dx * dx + dy * dy)
    near, far = (distance - reach) * (1.0 - SLACK), (distance + reach) * (1.0 + SLACK)
    beams = len(floors)
    if near <= 0.0:
        return 0, beams
    z, lift = blocks.centres[n, 2], blocks.lifts[n]
    bottom = heights[row, 0] + pose.low - sag - z - lift
    top = heights[row, 1] + pose.high + sag - z + lift
    bottom /= near if bottom < 0.0 else far
    top /= near if top > 0.0 else far
    climbs = blocks.climbs
    r = 0 if rays.level else n
    low = _first_above(climbs, r, 1, bottom - SLACK * abs(bottom))
    high = _first_above(climbs, r, 0, top + SLACK * abs(top))
    if low >= high or _outside_wedge(rays, blocks, n, dx, dy, distance, reach, low, high):
        return 0, 0
    if not counted:
        while low < high and floors[low] * near >= climbs[r, 2, low]:
            low += 1
        while low < high and floors[high - 1] * near >= climbs[r, 2, high - 1]:
            high -= 1
    return low, high


@compiled(forceinline=True, borrowing=True)
def _first_above(climbs: np.ndarray, row: int, bound: int, value: float) -> int:
    """Return the first beam whose bound is above the value; bounds never fall from beam to beam."""
    low, high = 0, climbs.shape[2]
    while low < high:
        middle = (low + high) >> 1
        if climbs[row, bound, middle] > value:
            high = middle
        else:
            low = middle + 1
    return low


@compiled(forceinline=True, borrowing=True)
def _outside_wedge(
    rays: RayColumns,
    blocks: Blocks,
    n: int,
    dx: float,
    dy: float,
    distance: float,
    reach: float,
    low: int,
    high: int,
) -> bool:
    """Return whether the circle lies outside the block's wedge for beams low to high."""
    wedges = blocks.wedges
    steep = max(abs(rays.slopes[low]), abs(rays.slopes[high - 1])) * blocks.horizontal_lengths[n, 1]
    shortest = blocks.horizontal_lengths[n, 0] - steep
    if wedges[n, 2] <= 0.0 or shortest <= 0.0:
        return False
    wide = (reach + (distance + reach) * steep / shortest) * (1.0 + SLACK)
    if wide >= distance:
        return False
    along = np.sqrt(distance * distance - wide * wide)
    ahead = dx * wedges[n, 0] + dy * wedges[n, 1]
    outside: bool = ahead < wedges[n, 2] * along - wedges[n, 3] * wide - SLACK * distance
    return outside


@compiled(borrowing=True)
def _count_touched(touched: np.ndarray, columns: int) -> int:
    """Return the number of marks of real columns, and clear all marks."""
    total = 0.0
    for j in range(len(touched)):
        for i in range(min(WIDTH, columns)):
            total += touched[j, i]
    touched[:] = 0.0
    return int(total)
