"""Faces of prisms as polygons of pixels, with planes on which 1 / depth is linear."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.world.prisms import MAX_EDGES

FACES = 16
"""Faces are numbered prism * 16 + side; sides 0 to 11 upright, then top and bottom."""
TOP, BOTTOM = 12, 13
GROUND_FACE, SKY_FACE = -1, -2
NEAR_M = 0.05
"""Nothing nearer to the image plane is drawn."""
CORNERS = 2 * MAX_EDGES
"""Most corners of a face that is cut at the image plane."""


class Lens(NamedTuple):
    """The camera in the world.

    rotation: (3, 3) rows are the camera's x, y and z axis in the world frame. origin: (3,).
    focal, centre: (2,) pixels.
    """

    rotation: np.ndarray
    origin: np.ndarray
    focal: np.ndarray
    centre: np.ndarray


class Solids(NamedTuple):
    """P prisms in the world frame, columns as in `Prisms`."""

    footprints: np.ndarray
    corners: np.ndarray
    bottoms: np.ndarray
    tops: np.ndarray
    owners: np.ndarray
    extinctions: np.ndarray


class Canvas(NamedTuple):
    """The image in the making, (H, W) each.

    q: float32, 1/m, 0 in the sky. faces: int32. marks: int32, the last actor whose outline covers
    the pixel, or (0, 0) when outlines are not asked for.
    """

    q: np.ndarray
    faces: np.ndarray
    marks: np.ndarray


@compiled(borrowing=True)
def plane_of(
    lens: Lens, nx: float, ny: float, nz: float, room: float
) -> tuple[float, float, float]:
    """Coefficients of q over columns and rows; room is the way to the plane along its normal."""
    r = lens.rotation
    x = (r[0, 0] * nx + r[0, 1] * ny + r[0, 2] * nz) / room
    y = (r[1, 0] * nx + r[1, 1] * ny + r[1, 2] * nz) / room
    z = (r[2, 0] * nx + r[2, 1] * ny + r[2, 2] * nz) / room
    a, b = x / lens.focal[0], y / lens.focal[1]
    return a, b, z - a * lens.centre[0] - b * lens.centre[1]


@compiled(borrowing=True)
def into_camera(lens: Lens, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Move a point of the world into the camera's frame."""
    r, o = lens.rotation, lens.origin
    x, y, z = x - o[0], y - o[1], z - o[2]
    return (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@compiled(borrowing=True)
def out_of_view(lens: Lens, solids: Solids, m: int, canvas: Canvas) -> bool:
    """Whether a cylinder around the prism lies behind or beside the camera's view."""
    x_low = x_high = solids.footprints[m, 0, 0]
    y_low = y_high = solids.footprints[m, 0, 1]
    for k in range(1, solids.corners[m]):
        x, y = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
        x_low, x_high = min(x_low, x), max(x_high, x)
        y_low, y_high = min(y_low, y), max(y_high, y)
    half_x, half_y = 0.5 * (x_high - x_low), 0.5 * (y_high - y_low)
    half_z = 0.5 * (solids.tops[m] - solids.bottoms[m])
    radius = np.sqrt(half_x * half_x + half_y * half_y + half_z * half_z)
    x, y, z = into_camera(
        lens, x_low + half_x, y_low + half_y, solids.bottoms[m] + half_z
    )  # fmt: skip
    if z + radius < NEAR_M:
        return True
    height, width = canvas.q.shape
    return (
        _beside(x, z, radius, lens.centre[0] / lens.focal[0], -1.0)
        or _beside(x, z, radius, (width - lens.centre[0]) / lens.focal[0], 1.0)
        or _beside(y, z, radius, lens.centre[1] / lens.focal[1], -1.0)
        or _beside(y, z, radius, (height - lens.centre[1]) / lens.focal[1], 1.0)
    )


@compiled(borrowing=True)
def _beside(across: float, ahead: float, radius: float, slope: float, side: float) -> bool:
    """Whether a ball lies wholly beyond the plane across = side * slope * ahead."""
    outside: bool = side * across - slope * ahead > radius * np.sqrt(1.0 + slope * slope)
    return outside


@compiled(borrowing=True)
def way_to(lens: Lens, solids: Solids, m: int) -> float:
    """From the camera to a prism's first corner."""
    x, y, z = into_camera(
        lens, solids.footprints[m, 0, 0], solids.footprints[m, 0, 1], solids.bottoms[m]
    )
    away: float = np.sqrt(x * x + y * y + z * z)
    return away


@compiled(borrowing=True)
def face_of(
    lens: Lens, solids: Solids, m: int, side: int, world: np.ndarray
) -> tuple[int, float, float, float]:
    """Corners of a face that is turned to the camera, and its plane; none if it is turned away."""
    count, origin = solids.corners[m], lens.origin
    if side >= TOP:
        z = solids.tops[m] if side == TOP else solids.bottoms[m]
        normal = 1.0 if side == TOP else -1.0
        room = (z - origin[2]) * normal
        if room >= 0.0:
            return 0, 0.0, 0.0, 0.0
        for k in range(count):
            world[k, 0], world[k, 1] = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
            world[k, 2] = z
        a, b, c = plane_of(lens, 0.0, 0.0, normal, room)
        return count, a, b, c
    if side >= count:
        return 0, 0.0, 0.0, 0.0
    nx, ny, room = side_plane(lens, solids, m, side)
    if room >= 0.0:
        return 0, 0.0, 0.0, 0.0
    after = side + 1 if side + 1 < count else 0
    for k in range(4):
        corner = side if k == 0 or k == 3 else after
        world[k, 0], world[k, 1] = solids.footprints[m, corner, 0], solids.footprints[m, corner, 1]
        world[k, 2] = solids.bottoms[m] if k < 2 else solids.tops[m]
    a, b, c = plane_of(lens, nx, ny, 0.0, room)
    return 4, a, b, c


@compiled(borrowing=True)
def side_plane(lens: Lens, solids: Solids, m: int, side: int) -> tuple[float, float, float]:
    """Outward normal (not of unit length) of an upright side, and the way to its plane."""
    after = side + 1 if side + 1 < solids.corners[m] else 0
    x, y = solids.footprints[m, side, 0], solids.footprints[m, side, 1]
    nx, ny = solids.footprints[m, after, 1] - y, x - solids.footprints[m, after, 0]
    return nx, ny, nx * (x - lens.origin[0]) + ny * (y - lens.origin[1])


@compiled(borrowing=True)
def project_face(
    lens: Lens, world: np.ndarray, corners: int, near: np.ndarray, polygon: np.ndarray
) -> int:
    """Cut a face at the near plane and write its corners in pixels; return how many."""
    count = 0
    x0, y0, z0 = into_camera(
        lens, world[corners - 1, 0], world[corners - 1, 1], world[corners - 1, 2]
    )
    for k in range(corners):
        x1, y1, z1 = into_camera(lens, world[k, 0], world[k, 1], world[k, 2])
        if (z0 < NEAR_M) != (z1 < NEAR_M):
            share = (NEAR_M - z0) / (z1 - z0)
            near[count, 0], near[count, 1] = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            near[count, 2] = NEAR_M
            count += 1
        if z1 >= NEAR_M:
            near[count, 0], near[count, 1], near[count, 2] = x1, y1, z1
            count += 1
        x0, y0, z0 = x1, y1, z1
    for k in range(count):
        polygon[k, 0] = lens.focal[0] * near[k, 0] / near[k, 2] + lens.centre[0]
        polygon[k, 1] = lens.focal[1] * near[k, 1] / near[k, 2] + lens.centre[1]
    return count if count >= 3 else 0


@compiled(borrowing=True)
def rows_of(polygon: np.ndarray, count: int, canvas: Canvas) -> tuple[int, int]:
    """First row and the one after the last whose middle may lie in the polygon."""
    top = bottom = polygon[0, 1]
    for k in range(1, count):
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    height = canvas.q.shape[0]
    first = max(0.0, np.ceil(min(top, 1.0 * height) - 0.5))
    last = max(0.0, min(1.0 * height, np.ceil(bottom - 0.5)))
    return int(first), int(last)


@compiled(borrowing=True)
def span_of(polygon: np.ndarray, count: int, row: int, canvas: Canvas) -> tuple[int, int]:
    """First column and the one after the last whose middle lies in the polygon."""
    y = row + 0.5
    left, right = np.inf, -np.inf
    x0, y0 = polygon[count - 1, 0], polygon[count - 1, 1]
    for k in range(count):
        x1, y1 = polygon[k, 0], polygon[k, 1]
        if (y0 <= y) != (y1 <= y):
            # From the upper end always, so that neighbours that share the edge agree on it.
            if y0 <= y1:
                x = x0 + (y - y0) * ((x1 - x0) / (y1 - y0))
            else:
                x = x1 + (y - y1) * ((x0 - x1) / (y0 - y1))
            left, right = min(left, x), max(right, x)
        x0, y0 = x1, y1
    width = 1.0 * canvas.q.shape[1]
    if left > right:
        return 0, 0
    first = min(width, max(0.0, np.ceil(left - 0.5)))
    last = min(width, max(0.0, np.ceil(right - 0.5)))
    return int(first), int(last)
