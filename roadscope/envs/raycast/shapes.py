"""Prisms as half-planes and circles, grouped by the body they belong to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.world.prisms import MAX_EDGES, Prisms

CACHED_SHAPES = 4
"""Most scenes whose shapes are cached; a vehicle that appears makes a new scene."""
STILL = -1
"""Value in `unit_poses` of a unit that does not move; its shapes are in the world frame."""


class Shapes(NamedTuple):
    """M prisms in U units; a unit is a body, or one prism of the scenery.

    planes: (M, 12, 3) half-planes n.p <= c of the sides, in the frame of the unit: x and y of the
        outward normal n of length 1, and c in metres.
    ready: (M,) bool, whether the planes are filled in: they are computed when a ray comes near.
    corners: (M,) int32, valid rows of planes.
    heights: (M, 2) bottom and top, metres.
    circles: (M, 3) x, y, radius of a circle around the footprint, metres.
    extinctions: (M,) 1/m.
    sources: (M,) int64, row of the prism; those of bodies count on from those of the scenery.
    owners: (M,) int32, reflectivities: (M,) float32.
    static, moving: (S, 12, 2) footprints of scenery and of bodies as given.
    unit_starts: (U + 1,) int64, unit u owns rows unit_starts[u] to unit_starts[u + 1].
    unit_poses: (U,) int64, row of the pose, or `STILL`.
    unit_circles: (U, 3), unit_heights: (U, 2), around all prisms of the unit.
    """

    planes: np.ndarray
    ready: np.ndarray
    corners: np.ndarray
    heights: np.ndarray
    circles: np.ndarray
    extinctions: np.ndarray
    sources: np.ndarray
    owners: np.ndarray
    reflectivities: np.ndarray
    static: np.ndarray
    moving: np.ndarray
    unit_starts: np.ndarray
    unit_poses: np.ndarray
    unit_circles: np.ndarray
    unit_heights: np.ndarray


_cache: dict[tuple[int, int, bytes], tuple[Prisms, Prisms, Shapes]] = {}


def shapes_of(scene: Scene) -> Shapes:
    """Return the shapes of a scene, cached for all scenes with the same prisms.

    They do not depend on poses, so all frames of an episode share them. The cache also keeps the
    prisms themselves, so that their identity stands for their content.
    """
    key = (id(scene.static), id(scene.moving), scene.present.tobytes())
    if key not in _cache:
        while len(_cache) >= CACHED_SHAPES:
            del _cache[next(iter(_cache))]
        _cache[key] = (scene.static, scene.moving, _prepared(scene))
    return _cache[key][2]


def clear_shapes() -> None:
    """Clear the cache of shapes."""
    _cache.clear()


def _prepared(scene: Scene) -> Shapes:
    static, moving = scene.static, scene.moving
    bodies = np.flatnonzero(scene.present[moving.owners])
    bodies = bodies[np.argsort(moving.owners[bodies], kind="stable")]
    owners = moving.owners[bodies]
    firsts = np.flatnonzero(np.diff(owners, prepend=-1))
    starts = np.concatenate(
        [np.arange(len(static)), len(static) + firsts, [len(static) + len(bodies)]]
    )
    poses = np.concatenate([np.full(len(static), STILL), owners[firsts]])
    count = len(static) + len(bodies)
    shapes = Shapes(
        np.empty((count, MAX_EDGES, 3)),
        np.zeros(count, np.bool_),
        np.empty(count, np.int32),
        np.empty((count, 2)),
        np.empty((count, 3)),
        np.empty(count),
        np.concatenate([np.arange(len(static)), len(static) + bodies]),
        np.concatenate([static.owners, owners]),
        np.concatenate([static.reflectivities, moving.reflectivities[bodies]]),
        static.footprints,
        moving.footprints,
        starts,
        poses.astype(np.int64),
        np.empty((len(poses), 3)),
        np.empty((len(poses), 2)),
    )
    _fill(static, np.arange(len(static)), 0, shapes)
    _fill(moving, bodies, len(static), shapes)
    _bound_units(starts, shapes.circles, shapes.heights, shapes.unit_circles, shapes.unit_heights)
    return shapes


def _fill(prisms: Prisms, rows: np.ndarray, start: int, shapes: Shapes) -> None:
    """Write rows of prisms to the shapes from row `start` on; planes are left for later."""
    if len(rows):
        part = slice(start, start + len(rows))
        shapes.corners[part] = prisms.corners[rows]
        shapes.heights[part, 0] = prisms.bottoms[rows]
        shapes.heights[part, 1] = prisms.tops[rows]
        shapes.extinctions[part] = prisms.extinctions[rows]
        _encircle(prisms.footprints, prisms.corners, rows, shapes.circles[part])


@compiled()
def _encircle(
    footprints: np.ndarray, corners: np.ndarray, rows: np.ndarray, circles: np.ndarray
) -> None:
    """Write circles around footprints; centres are those of the boxes along x and y."""
    for m in range(len(rows)):
        row, count = rows[m], corners[rows[m]]
        x_low = x_high = footprints[row, 0, 0]
        y_low = y_high = footprints[row, 0, 1]
        for k in range(1, count):
            x, y = footprints[row, k, 0], footprints[row, k, 1]
            x_low, x_high = min(x_low, x), max(x_high, x)
            y_low, y_high = min(y_low, y), max(y_high, y)
        centre_x, centre_y = 0.5 * (x_low + x_high), 0.5 * (y_low + y_high)
        square = 0.0
        for k in range(count):
            dx, dy = footprints[row, k, 0] - centre_x, footprints[row, k, 1] - centre_y
            square = max(square, dx * dx + dy * dy)
        circles[m, 0], circles[m, 1], circles[m, 2] = centre_x, centre_y, np.sqrt(square)


@compiled(borrowing=True)
def fill_planes(shapes: Shapes, m: int) -> None:
    """Compute the half-planes of a prism's sides."""
    source = shapes.sources[m]
    if source < len(shapes.static):
        _fill_from(shapes.static, source, shapes.corners[m], shapes.planes, m)
    else:
        row = source - len(shapes.static)
        _fill_from(shapes.moving, row, shapes.corners[m], shapes.planes, m)
    shapes.ready[m] = True


@compiled(borrowing=True)
def _fill_from(footprints: np.ndarray, row: int, count: int, planes: np.ndarray, m: int) -> None:
    """Write the half-planes of a counter-clockwise footprint; equal corners give no bound."""
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        x, y = footprints[row, k, 0], footprints[row, k, 1]
        dx, dy = footprints[row, after, 0] - x, footprints[row, after, 1] - y
        length = np.sqrt(dx * dx + dy * dy)
        scale = 1.0 / length if length > 0.0 else 0.0
        planes[m, k, 0], planes[m, k, 1] = dy * scale, -dx * scale
        planes[m, k, 2] = (x * dy - y * dx) * scale


@compiled()
def _bound_units(
    starts: np.ndarray,
    circles: np.ndarray,
    heights: np.ndarray,
    unit_circles: np.ndarray,
    unit_heights: np.ndarray,
) -> None:
    """Write a circle and heights around all prisms of each unit."""
    for u in range(len(starts) - 1):
        a, b = starts[u], starts[u + 1]
        x_low = y_low = bottom = np.inf
        x_high = y_high = top = -np.inf
        for m in range(a, b):
            x, y, radius = circles[m, 0], circles[m, 1], circles[m, 2]
            x_low, x_high = min(x_low, x - radius), max(x_high, x + radius)
            y_low, y_high = min(y_low, y - radius), max(y_high, y + radius)
            bottom, top = min(bottom, heights[m, 0]), max(top, heights[m, 1])
        x_middle, y_middle = 0.5 * (x_low + x_high), 0.5 * (y_low + y_high)
        reach = 0.0
        for m in range(a, b):
            dx, dy = circles[m, 0] - x_middle, circles[m, 1] - y_middle
            reach = max(reach, np.sqrt(dx * dx + dy * dy) + circles[m, 2])
        unit_circles[u, 0], unit_circles[u, 1], unit_circles[u, 2] = x_middle, y_middle, reach
        unit_heights[u, 0], unit_heights[u, 1] = bottom, top
