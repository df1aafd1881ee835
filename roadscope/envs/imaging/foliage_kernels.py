"""Foliage in images: cells of leaves that stay where they are, and gaps between them."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.face_kernels import (
    BOTTOM,
    FACES,
    TOP,
    Canvas,
    Lens,
    Solids,
    face_of,
    plane_of,
    project_face,
    rows_of,
    side_plane,
    span_of,
    way_to,
)

LEAF_M, LEAF_PX = 0.12, 2.0
"""Edge of the cells of which foliage is made; far away they double until they cover pixels."""
STRIDE = 16
"""Pixels along a row for which one face is tried as the one that rays leave through."""


@compiled(borrowing=True)
def draw_porous(
    lens: Lens,
    solids: Solids,
    m: int,
    world: np.ndarray,
    near: np.ndarray,
    polygon: np.ndarray,
    exits: np.ndarray,
    canvas: Canvas,
) -> None:
    """Draw foliage: cells of leaves that stay where they are, and gaps between them."""
    leaf = _leaf_size(lens, solids, m)
    chance = np.uint64((1.0 - np.exp(-solids.extinctions[m] * leaf)) * 2.0**53)
    leaving = 0
    for side in range(BOTTOM + 1):
        turned, a, b, c = _away(lens, solids, m, side)
        if turned:
            exits[leaving, 0], exits[leaving, 1], exits[leaving, 2] = a, b, c
            leaving += 1
    for side in range(BOTTOM + 1):
        corners, a, b, c = face_of(lens, solids, m, side, world)
        if corners == 0:
            continue
        count = project_face(lens, world, corners, near, polygon)
        if count == 0:
            continue
        face = np.int32(m * FACES + side)
        first, last = rows_of(polygon, count, canvas)
        for r in range(first, last):
            left, right = span_of(polygon, count, r, canvas)
            for start in range(left, right, STRIDE):
                end = min(right, start + STRIDE)
                low = _last_exit(exits, leaving, start + 0.5, r + 0.5)
                same = low == _last_exit(exits, leaving, end - 0.5, r + 0.5)
                for k in range(start, end):
                    e = low if same else _last_exit(exits, leaving, k + 0.5, r + 0.5)
                    enter = a * (k + 0.5) + b * (r + 0.5) + c
                    leave = exits[e, 0] * (k + 0.5) + exits[e, 1] * (r + 0.5) + exits[e, 2]
                    leave = max(leave if e >= 0 else 0.0, max(0.0, 1.0 * canvas.q[r, k]))
                    if enter > leave:
                        met = _leaf(lens, k + 0.5, r + 0.5, enter, leave, leaf, chance)
                        if met > 0.0:
                            canvas.q[r, k] = np.float32(met)
                            canvas.faces[r, k] = face


@compiled(borrowing=True)
def _leaf_size(lens: Lens, solids: Solids, m: int) -> float:
    """Edge of the cells of leaves: doubled until a cell covers some pixels."""
    away, leaf = way_to(lens, solids, m), LEAF_M
    while lens.focal[0] * leaf < LEAF_PX * away and leaf < 1.0:
        leaf *= 2.0
    return leaf


@compiled(borrowing=True)
def _last_exit(exits: np.ndarray, leaving: int, column: float, row: float) -> int:
    """Which of the faces a ray leaves through: the one of greatest q, hence nearest."""
    best, last = -np.inf, -1
    for e in range(leaving):
        line = exits[e, 0] * column + exits[e, 1] * row + exits[e, 2]
        if line > best:
            best, last = line, e
    return last


@compiled(borrowing=True)
def _away(lens: Lens, solids: Solids, m: int, side: int) -> tuple[bool, float, float, float]:
    """Whether the face is turned away from the camera, and its plane."""
    if side >= TOP:
        z = solids.tops[m] if side == TOP else solids.bottoms[m]
        normal = 1.0 if side == TOP else -1.0
        nx, ny, nz, room = 0.0, 0.0, normal, (z - lens.origin[2]) * normal
    elif side < solids.corners[m]:
        nx, ny, room = side_plane(lens, solids, m, side)
        nz = 0.0
    else:
        return False, 0.0, 0.0, 0.0
    if room <= 0.0:
        return False, 0.0, 0.0, 0.0
    a, b, c = plane_of(lens, nx, ny, nz, room)
    return True, a, b, c


@compiled(borrowing=True)
def _leaf(
    lens: Lens,
    column: float,
    row: float,
    enter: float,
    leave: float,
    leaf: float,
    chance: np.uint64,
) -> float:
    """Walk through the cells on the way; return q at the first with leaves, 0 if there is none."""
    dx = (column - lens.centre[0]) / lens.focal[0]
    dy = (row - lens.centre[1]) / lens.focal[1]
    r, o = lens.rotation, lens.origin
    x = r[0, 0] * dx + r[1, 0] * dy + r[2, 0]
    y = r[0, 1] * dx + r[1, 1] * dy + r[2, 1]
    z = r[0, 2] * dx + r[1, 2] * dy + r[2, 2]
    scale = 1.0 / leaf
    step = leaf / np.sqrt(x * x + y * y + z * z)
    depth, end = 1.0 / enter + 0.5 * step, 1.0 / leave if leave > 0.0 else np.inf
    x0, y0, z0 = scale * o[0], scale * o[1], scale * o[2]
    x, y, z = scale * x, scale * y, scale * z
    while depth < end:
        i = np.int64(np.floor(x0 + depth * x))
        j = np.int64(np.floor(y0 + depth * y))
        k = np.int64(np.floor(z0 + depth * z))
        if _draw(i, j, k) < chance:
            met: float = 1.0 / depth
            return met
        depth += step
    return 0.0


@compiled(forceinline=True, borrowing=True)
def _draw(i: np.int64, j: np.int64, k: np.int64) -> np.uint64:
    """Draw a number of 53 bits that belongs to a cell of space."""
    state = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15)
    state ^= np.uint64(j) * np.uint64(0xC2B2AE3D27D4EB4F)
    state ^= np.uint64(k) * np.uint64(0x165667B19E3779F9)
    state ^= state >> np.uint64(29)
    state *= np.uint64(0xBF58476D1CE4E5B9)
    state ^= state >> np.uint64(32)
    return state >> np.uint64(11)
