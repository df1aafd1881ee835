"""Faces of prisms drawn into a depth buffer, exact at the middle of every pixel.

On a plane the reciprocal of the depth, q, is linear over the image: q = a column + b row + c. So
a face is a convex polygon of pixels with three numbers, and the nearest face is the one with the
greatest q: what a ray through the middle of the pixel meets first.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.face_kernels import (
    BOTTOM,
    CORNERS,
    FACES,
    GROUND_FACE,
    SKY_FACE,
    Canvas,
    Lens,
    Solids,
    face_of,
    out_of_view,
    plane_of,
    project_face,
    rows_of,
    span_of,
    way_to,
)
from roadscope.envs.imaging.foliage_kernels import draw_porous
from roadscope.envs.world.prisms import MAX_EDGES


@compiled()
def draw_all(lens: Lens, solids: Solids, canvas: Canvas, extents: np.ndarray) -> None:
    """Draw ground and prisms; fill extents (A, 5): left, top, right, bottom, pixels of outlines."""
    _draw_ground(lens, canvas)
    world, near = np.empty((CORNERS, 3)), np.empty((CORNERS, 3))
    polygon, exits = np.empty((CORNERS, 2)), np.empty((MAX_EDGES + 2, 3))
    ways = np.full(len(solids.corners), np.inf)
    porous = 0
    for m in range(len(solids.corners)):
        if solids.corners[m] == 0 or out_of_view(lens, solids, m, canvas):
            continue
        if solids.extinctions[m] > 0.0:
            ways[m] = way_to(lens, solids, m)
            porous += 1
        else:
            _draw_solid(lens, solids, m, world, near, polygon, canvas, extents)
    # Foliage last and from near to far, so that no ray walks through leaves that it cannot see.
    for m in np.argsort(ways)[:porous]:
        draw_porous(lens, solids, m, world, near, polygon, exits, canvas)


@compiled(borrowing=True)
def _draw_ground(lens: Lens, canvas: Canvas) -> None:
    height, width = canvas.q.shape
    a, b, c = plane_of(lens, 0.0, 0.0, 1.0, -lens.origin[2])
    for r in range(height):
        row = b * (r + 0.5) + c
        for k in range(width):
            q = np.float32(a * (k + 0.5) + row)
            met = q > np.float32(0.0)
            canvas.q[r, k] = q if met else np.float32(0.0)
            canvas.faces[r, k] = GROUND_FACE if met else SKY_FACE
    canvas.marks[:] = -1


@compiled(borrowing=True)
def _draw_solid(
    lens: Lens,
    solids: Solids,
    m: int,
    world: np.ndarray,
    near: np.ndarray,
    polygon: np.ndarray,
    canvas: Canvas,
    extents: np.ndarray,
) -> None:
    actor = solids.owners[m]
    counted = actor >= 0 and len(canvas.marks) > 0
    for side in range(BOTTOM + 1):
        corners, a, b, c = face_of(lens, solids, m, side, world)
        if corners == 0:
            continue
        count = project_face(lens, world, corners, near, polygon)
        if count == 0:
            continue
        if actor >= 0:
            _widen(polygon, count, canvas, extents[actor])
        face = np.int32(m * FACES + side)
        first, last = rows_of(polygon, count, canvas)
        for r in range(first, last):
            left, right = span_of(polygon, count, r, canvas)
            _fill(canvas.q[r], canvas.faces[r], left, right, a, b * (r + 0.5) + c, face)
            if counted:
                extents[actor, 4] += _mark(canvas.marks[r], left, right, actor)


@compiled(borrowing=True)
def _widen(polygon: np.ndarray, count: int, canvas: Canvas, extent: np.ndarray) -> None:
    """Let the actor's box in the image hold the polygon, as far as the image goes."""
    height, width = canvas.q.shape
    left = top = np.inf
    right = bottom = -np.inf
    for k in range(count):
        left, right = min(left, polygon[k, 0]), max(right, polygon[k, 0])
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    if right <= 0.0 or left >= width or bottom <= 0.0 or top >= height:
        return
    extent[0], extent[1] = min(extent[0], max(left, 0.0)), min(extent[1], max(top, 0.0))
    extent[2] = max(extent[2], min(right, 1.0 * width))
    extent[3] = max(extent[3], min(bottom, 1.0 * height))


@compiled(borrowing=True)
def _fill(
    q: np.ndarray, faces: np.ndarray, left: int, right: int, a: float, row: float, face: np.int32
) -> None:
    for k in range(left, right):
        new = np.float32(a * (k + 0.5) + row)
        nearer = new > q[k]
        q[k] = new if nearer else q[k]
        faces[k] = face if nearer else faces[k]


@compiled(borrowing=True)
def _mark(marks: np.ndarray, left: int, right: int, actor: int) -> int:
    """Count the pixels that the actor did not cover yet."""
    fresh = 0
    for k in range(left, right):
        fresh += marks[k] != actor
        marks[k] = actor
    return fresh
