"""Depth buffer of a block of rays: starts with the ground, ends as surfaces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import GROUND, SKY
from roadscope.core.jit import compiled
from roadscope.envs.raycast.batch import (
    WIDTH,
    flip,
    least,
    load,
    pick,
    put,
    put_narrow,
    root,
    spread,
)
from roadscope.envs.raycast.blocks import Blocks, RayColumns

NOTHING = SKY
"""Owner of a ray without any hit."""


class Depth(NamedTuple):
    """Nearest hits so far in a block, beam by beam, `WIDTH` columns each.

    q: (B, WIDTH) as in `kernels`. far: (B, WIDTH) q at the greatest range. plane_distances:
    (B, WIDTH) distance of the ray's origin from the plane of the surface, metres. owners,
    reflectivity: (B, WIDTH) of the surface. floors: (B,) least q of each beam: surfaces with a
    lesser q are hidden in all columns. `store` turns q into ranges and plane_distances into
    cosines.
    """

    q: np.ndarray
    far: np.ndarray
    plane_distances: np.ndarray
    owners: np.ndarray
    reflectivity: np.ndarray
    floors: np.ndarray
    max_range_m: float


class Surfaces(NamedTuple):
    """Nearest surfaces of all rays, (B, C) each, otherwise as in `raycast.Hits`."""

    ranges: np.ndarray
    owners: np.ndarray
    cosines: np.ndarray
    reflectivity: np.ndarray


@compiled(borrowing=True)
def load_columns(rays: RayColumns, blocks: Blocks, n: int, world: np.ndarray) -> None:
    """Copy the block's columns to `Scratch.world`; an unfinished block repeats its last one."""
    for i in range(WIDTH):
        c = blocks.order[min(n * WIDTH + i, len(blocks.order) - 1)]
        world[0, i], world[1, i] = rays.origins[c, 0], rays.origins[c, 1]
        world[2, i], world[3, i] = rays.ahead[c, 0], rays.ahead[c, 1]
        world[4, i], world[5, i] = rays.up[c, 0], rays.up[c, 1]
        world[6, i] = rays.origins[c, 2]
        world[7, i], world[8, i] = rays.ahead[c, 2], rays.up[c, 2]


@compiled(borrowing=True)
def clear(slopes: np.ndarray, ground_reflectivity: float, world: np.ndarray, depth: Depth) -> None:
    """Reset the buffer to the ground, or to no hit at the greatest range."""
    scale = 1.0 / depth.max_range_m
    height = load(world, 6)
    above, down = height > 0.0, -1.0 / height
    for j in range(len(slopes)):
        s = slopes[j]
        x = load(world, 2) + s * load(world, 4)
        y = load(world, 3) + s * load(world, 5)
        z = load(world, 7) + s * load(world, 8)
        far = root(x * x + y * y + z * z) * scale
        ground = z * down
        hit = (ground >= far) & above
        q = pick(hit, ground, far)
        put(depth.far, j, far)
        put(depth.q, j, q)
        put(depth.plane_distances, j, height)
        put(depth.owners, j, pick(hit, spread(1.0 * GROUND), spread(1.0 * NOTHING)))
        put(depth.reflectivity, j, pick(hit, spread(ground_reflectivity), spread(0.0)))
        depth.floors[j] = least(q)


@compiled(borrowing=True)
def store(blocks: Blocks, n: int, depth: Depth, surfaces: Surfaces) -> None:
    """Write the depth buffer as ranges, owners, cosines and reflectivities."""
    for j in range(len(depth.q)):
        reach = load(depth.far, j) * depth.max_range_m / load(depth.q, j)
        hit = load(depth.owners, j) > 1.0 * NOTHING
        put(depth.q, j, pick(hit, reach, spread(0.0)))
        put(
            depth.plane_distances, j, pick(hit, load(depth.plane_distances, j) / reach, spread(0.0))
        )
    order, start = blocks.order, n * WIDTH
    if start + WIDTH <= len(order):
        first, last = order[start], order[start + WIDTH - 1]
        if _are_adjacent(order, start, 1):
            return _store_adjacent(first, False, depth, surfaces)
        if _are_adjacent(order, start, -1):
            return _store_adjacent(last, True, depth, surfaces)
    for i in range(min(WIDTH, len(order) - start)):
        c = order[start + i]
        for j in range(len(depth.q)):
            surfaces.ranges[j, c] = depth.q[j, i]
            surfaces.cosines[j, c] = depth.plane_distances[j, i]
            surfaces.owners[j, c] = np.int32(depth.owners[j, i])
            surfaces.reflectivity[j, c] = depth.reflectivity[j, i]
    return None


@compiled(borrowing=True)
def _are_adjacent(order: np.ndarray, start: int, step: int) -> bool:
    """Return whether the block's columns are adjacent in that direction."""
    gaps = 0
    for i in range(start + 1, start + WIDTH):
        gaps += order[i] - order[i - 1] != step
    return gaps == 0


@compiled(borrowing=True)
def _store_adjacent(first: int, reverse: bool, depth: Depth, surfaces: Surfaces) -> None:
    """Write the block to the columns from `first` on, in reverse order if `reverse`."""
    for j in range(len(depth.q)):
        ranges, cosines = load(depth.q, j), load(depth.plane_distances, j)
        owners, reflectivity = load(depth.owners, j), load(depth.reflectivity, j)
        if reverse:
            ranges, cosines = flip(ranges), flip(cosines)
            owners, reflectivity = flip(owners), flip(reflectivity)
        put_narrow(surfaces.ranges, j, first, ranges)
        put_narrow(surfaces.cosines, j, first, cosines)
        put_narrow(surfaces.owners, j, first, owners)
        put_narrow(surfaces.reflectivity, j, first, reflectivity)
