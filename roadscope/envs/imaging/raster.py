"""Rasterisation of prisms: depth, face and prism of every pixel.

Its reciprocal q (1/m) stands for the depth: q is linear over the pixels of a face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import Pose
from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.core.sorting import stable_order
from roadscope.envs.imaging.pinhole import Pinhole
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.world.prisms import MAX_EDGES

# --------------------------------------------------------------------------------------------------
# Faces of prisms as polygons of pixels, with q as a linear function of column and row.

FACES = 16
"""Faces are numbered prism * 16 + side; sides 0 to 11 upright, then top and bottom."""
TOP, BOTTOM = 12, 13
GROUND_FACE, SKY_FACE = -1, -2
NEAR_M = 0.05
"""Depth of the near plane: nothing nearer is drawn."""
CORNERS = 2 * MAX_EDGES
"""Most corners of a face that is cut at the near plane."""


class Point(NamedTuple):
    """A place on the ground, world frame, metres."""

    x: float
    y: float


class Vector(NamedTuple):
    """A place or a direction in space, world frame."""

    x: float
    y: float
    z: float


class Lens(NamedTuple):
    """Pose and intrinsics of the camera.

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


class RasterBuffers(NamedTuple):
    """The buffers of an image, (H, W) each.

    q: float32, 1/m, 0 in the sky. faces: int32. marks: int32, the last actor whose outline covers
    the pixel, or (0, 0) without outlines.
    """

    q: np.ndarray
    faces: np.ndarray
    marks: np.ndarray


@compiled(borrowing=True)
def plane_of(
    lens: Lens, nx: float, ny: float, nz: float, distance: float
) -> tuple[float, float, float]:
    """Return a, b, c of q = a * column + b * row + c on a plane.

    distance: from the camera to the plane along its normal (nx, ny, nz).
    """
    r = lens.rotation
    x = (r[0, 0] * nx + r[0, 1] * ny + r[0, 2] * nz) / distance
    y = (r[1, 0] * nx + r[1, 1] * ny + r[1, 2] * nz) / distance
    z = (r[2, 0] * nx + r[2, 1] * ny + r[2, 2] * nz) / distance
    a, b = x / lens.focal[0], y / lens.focal[1]
    return a, b, z - a * lens.centre[0] - b * lens.centre[1]


@compiled(borrowing=True)
def into_camera(lens: Lens, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a point of the world in the camera's frame."""
    r, o = lens.rotation, lens.origin
    x, y, z = x - o[0], y - o[1], z - o[2]
    return (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@compiled(borrowing=True)
def out_of_view(lens: Lens, solids: Solids, m: int, buffers: RasterBuffers) -> bool:
    """Return whether a ball around the prism lies outside the camera's view."""
    x_low = x_high = solids.footprints[m, 0, 0]
    y_low = y_high = solids.footprints[m, 0, 1]
    for k in range(1, solids.corners[m]):
        x, y = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
        x_low, x_high = min(x_low, x), max(x_high, x)
        y_low, y_high = min(y_low, y), max(y_high, y)
    half_x, half_y = 0.5 * (x_high - x_low), 0.5 * (y_high - y_low)
    half_z = 0.5 * (solids.tops[m] - solids.bottoms[m])
    radius = np.sqrt(half_x * half_x + half_y * half_y + half_z * half_z)
    x, y, z = into_camera(lens, x_low + half_x, y_low + half_y, solids.bottoms[m] + half_z)
    if z + radius < NEAR_M:
        return True
    height, width = buffers.q.shape
    return (
        _outside_plane(x, z, radius, lens.centre[0] / lens.focal[0], -1.0)
        or _outside_plane(x, z, radius, (width - lens.centre[0]) / lens.focal[0], 1.0)
        or _outside_plane(y, z, radius, lens.centre[1] / lens.focal[1], -1.0)
        or _outside_plane(y, z, radius, (height - lens.centre[1]) / lens.focal[1], 1.0)
    )


@compiled(borrowing=True)
def _outside_plane(across: float, ahead: float, radius: float, slope: float, side: float) -> bool:
    """Return whether a ball lies wholly beyond the plane across = side * slope * ahead."""
    outside: bool = side * across - slope * ahead > radius * np.sqrt(1.0 + slope * slope)
    return outside


@compiled(borrowing=True)
def distance_to(lens: Lens, solids: Solids, m: int) -> float:
    """Return the distance from the camera to a prism's first corner."""
    x, y, z = into_camera(
        lens, solids.footprints[m, 0, 0], solids.footprints[m, 0, 1], solids.bottoms[m]
    )
    away: float = np.sqrt(x * x + y * y + z * z)
    return away


@compiled(borrowing=True)
def face_of(
    lens: Lens, solids: Solids, m: int, side: int, world: np.ndarray
) -> tuple[int, float, float, float]:
    """Return the number of corners of a face and its plane; 0 if it is turned away.

    The corners are written into world (K, 3); the plane is a, b, c of `plane_of`.
    """
    count, origin = solids.corners[m], lens.origin
    if side >= TOP:
        z = solids.tops[m] if side == TOP else solids.bottoms[m]
        normal = 1.0 if side == TOP else -1.0
        distance = (z - origin[2]) * normal
        if distance >= 0.0:
            return 0, 0.0, 0.0, 0.0
        for k in range(count):
            world[k, 0], world[k, 1] = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
            world[k, 2] = z
        a, b, c = plane_of(lens, 0.0, 0.0, normal, distance)
        return count, a, b, c
    if side >= count:
        return 0, 0.0, 0.0, 0.0
    nx, ny, distance = side_plane(lens, solids, m, side)
    if distance >= 0.0:
        return 0, 0.0, 0.0, 0.0
    after = side + 1 if side + 1 < count else 0
    for k in range(4):
        corner = side if k == 0 or k == 3 else after
        world[k, 0], world[k, 1] = solids.footprints[m, corner, 0], solids.footprints[m, corner, 1]
        world[k, 2] = solids.bottoms[m] if k < 2 else solids.tops[m]
    a, b, c = plane_of(lens, nx, ny, 0.0, distance)
    return 4, a, b, c


@compiled(borrowing=True)
def side_plane(lens: Lens, solids: Solids, m: int, side: int) -> tuple[float, float, float]:
    """Return the outward normal (not of unit length) of an upright side, and its distance."""
    after = side + 1 if side + 1 < solids.corners[m] else 0
    x, y = solids.footprints[m, side, 0], solids.footprints[m, side, 1]
    nx, ny = solids.footprints[m, after, 1] - y, x - solids.footprints[m, after, 0]
    return nx, ny, nx * (x - lens.origin[0]) + ny * (y - lens.origin[1])


@compiled(borrowing=True)
def project_face(
    lens: Lens, world: np.ndarray, corners: int, near: np.ndarray, polygon: np.ndarray
) -> int:
    """Clip a face at the near plane; write its corners in pixels and return their number."""
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
def rows_of(polygon: np.ndarray, count: int, buffers: RasterBuffers) -> tuple[int, int]:
    """Return the first row, and the one after the last, whose middle may lie in the polygon."""
    top = bottom = polygon[0, 1]
    for k in range(1, count):
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    height = buffers.q.shape[0]
    first = max(0.0, np.ceil(min(top, 1.0 * height) - 0.5))
    last = max(0.0, min(1.0 * height, np.ceil(bottom - 0.5)))
    return int(first), int(last)


@compiled(borrowing=True)
def span_of(polygon: np.ndarray, count: int, row: int, buffers: RasterBuffers) -> tuple[int, int]:
    """Return the first column, and the one after the last, whose middle lies in the polygon."""
    y = row + 0.5
    left, right = np.inf, -np.inf
    x0, y0 = polygon[count - 1, 0], polygon[count - 1, 1]
    for k in range(count):
        x1, y1 = polygon[k, 0], polygon[k, 1]
        if (y0 <= y) != (y1 <= y):
            # Always from the upper end, so that two faces with this edge compute the same value.
            if y0 <= y1:
                x = x0 + (y - y0) * ((x1 - x0) / (y1 - y0))
            else:
                x = x1 + (y - y1) * ((x0 - x1) / (y0 - y1))
            left, right = min(left, x), max(right, x)
        x0, y0 = x1, y1
    width = 1.0 * buffers.q.shape[1]
    if left > right:
        return 0, 0
    first = min(width, max(0.0, np.ceil(left - 0.5)))
    last = min(width, max(0.0, np.ceil(right - 0.5)))
    return int(first), int(last)


# --------------------------------------------------------------------------------------------------
# Foliage: fixed cells of leaves, and gaps between them.

LEAF_M, LEAF_PX = 0.12, 2.0
"""Edge of the cells of foliage; far away it is doubled until a cell covers two pixels."""
STRIDE = 16
"""Pixels along a row whose rays are first assumed to leave through the same face."""


@compiled(borrowing=True)
def draw_porous(
    lens: Lens,
    solids: Solids,
    m: int,
    world: np.ndarray,
    near: np.ndarray,
    polygon: np.ndarray,
    exits: np.ndarray,
    buffers: RasterBuffers,
) -> None:
    """Draw a prism of foliage: fixed cells of leaves, and gaps between them."""
    leaf = _leaf_size(lens, solids, m)
    chance = np.uint64((1.0 - np.exp(-solids.extinctions[m] * leaf)) * 2.0**53)
    leaving = 0
    for side in range(BOTTOM + 1):
        turned_away, a, b, c = _exit_plane(lens, solids, m, side)
        if turned_away:
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
        first, last = rows_of(polygon, count, buffers)
        for r in range(first, last):
            left, right = span_of(polygon, count, r, buffers)
            for start in range(left, right, STRIDE):
                end = min(right, start + STRIDE)
                low = _last_exit(exits, leaving, start + 0.5, r + 0.5)
                same = low == _last_exit(exits, leaving, end - 0.5, r + 0.5)
                for k in range(start, end):
                    e = low if same else _last_exit(exits, leaving, k + 0.5, r + 0.5)
                    enter = a * (k + 0.5) + b * (r + 0.5) + c
                    leave = exits[e, 0] * (k + 0.5) + exits[e, 1] * (r + 0.5) + exits[e, 2]
                    leave = max(leave if e >= 0 else 0.0, max(0.0, 1.0 * buffers.q[r, k]))
                    if enter > leave:
                        hit = _leaf(lens, k + 0.5, r + 0.5, enter, leave, leaf, chance)
                        if hit > 0.0:
                            buffers.q[r, k] = np.float32(hit)
                            buffers.faces[r, k] = face


@compiled(borrowing=True)
def _leaf_size(lens: Lens, solids: Solids, m: int) -> float:
    """Return the edge of the cells of leaves, metres: doubled until a cell covers two pixels."""
    away, leaf = distance_to(lens, solids, m), LEAF_M
    while lens.focal[0] * leaf < LEAF_PX * away and leaf < 1.0:
        leaf *= 2.0
    return leaf


@compiled(borrowing=True)
def _last_exit(exits: np.ndarray, leaving: int, column: float, row: float) -> int:
    """Return the face through which a ray leaves: the one of greatest q, hence the nearest."""
    best, last = -np.inf, -1
    for e in range(leaving):
        line = exits[e, 0] * column + exits[e, 1] * row + exits[e, 2]
        if line > best:
            best, last = line, e
    return last


@compiled(borrowing=True)
def _exit_plane(lens: Lens, solids: Solids, m: int, side: int) -> tuple[bool, float, float, float]:
    """Return whether the face is turned away from the camera, and its plane."""
    if side >= TOP:
        z = solids.tops[m] if side == TOP else solids.bottoms[m]
        normal = 1.0 if side == TOP else -1.0
        nx, ny, nz, distance = 0.0, 0.0, normal, (z - lens.origin[2]) * normal
    elif side < solids.corners[m]:
        nx, ny, distance = side_plane(lens, solids, m, side)
        nz = 0.0
    else:
        return False, 0.0, 0.0, 0.0
    if distance <= 0.0:
        return False, 0.0, 0.0, 0.0
    a, b, c = plane_of(lens, nx, ny, nz, distance)
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
    """Return q at the first cell with leaves along the ray, 0 if there is none."""
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
        if _cell_bits(i, j, k) < chance:
            hit: float = 1.0 / depth
            return hit
        depth += step
    return 0.0


@compiled(forceinline=True, borrowing=True)
def _cell_bits(i: np.int64, j: np.int64, k: np.int64) -> np.uint64:
    """Return a pseudo-random number of 53 bits for a cell of space."""
    state = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15)
    state ^= np.uint64(j) * np.uint64(0xC2B2AE3D27D4EB4F)
    state ^= np.uint64(k) * np.uint64(0x165667B19E3779F9)
    state ^= state >> np.uint64(29)
    state *= np.uint64(0xBF58476D1CE4E5B9)
    state ^= state >> np.uint64(32)
    return state >> np.uint64(11)


# --------------------------------------------------------------------------------------------------
# Faces of prisms in a depth buffer, exact at the middle of every pixel.


@compiled()
def draw_all(lens: Lens, solids: Solids, buffers: RasterBuffers, extents: np.ndarray) -> None:
    """Draw ground and prisms; fill extents (A, 5): left, top, right, bottom, pixels of outlines."""
    _draw_ground(lens, buffers)
    world, near = np.empty((CORNERS, 3)), np.empty((CORNERS, 3))
    polygon, exits = np.empty((CORNERS, 2)), np.empty((MAX_EDGES + 2, 3))
    distances = np.full(len(solids.corners), np.inf)
    porous = 0
    for m in range(len(solids.corners)):
        if solids.corners[m] == 0 or out_of_view(lens, solids, m, buffers):
            continue
        if solids.extinctions[m] > 0.0:
            distances[m] = distance_to(lens, solids, m)
            porous += 1
        else:
            _draw_solid(lens, solids, m, world, near, polygon, buffers, extents)
    # Foliage last and from near to far: no ray then samples hidden leaves.
    order = stable_order(distances)
    for i in range(porous):
        draw_porous(lens, solids, order[i], world, near, polygon, exits, buffers)


@compiled(borrowing=True)
def _draw_ground(lens: Lens, buffers: RasterBuffers) -> None:
    height, width = buffers.q.shape
    a, b, c = plane_of(lens, 0.0, 0.0, 1.0, -lens.origin[2])
    for r in range(height):
        row = b * (r + 0.5) + c
        for k in range(width):
            q = np.float32(a * (k + 0.5) + row)
            hit = q > np.float32(0.0)
            buffers.q[r, k] = q if hit else np.float32(0.0)
            buffers.faces[r, k] = GROUND_FACE if hit else SKY_FACE
    buffers.marks[:] = -1


@compiled(borrowing=True)
def _draw_solid(
    lens: Lens,
    solids: Solids,
    m: int,
    world: np.ndarray,
    near: np.ndarray,
    polygon: np.ndarray,
    buffers: RasterBuffers,
    extents: np.ndarray,
) -> None:
    actor = solids.owners[m]
    counted = actor >= 0 and len(buffers.marks) > 0
    for side in range(BOTTOM + 1):
        corners, a, b, c = face_of(lens, solids, m, side, world)
        if corners == 0:
            continue
        count = project_face(lens, world, corners, near, polygon)
        if count == 0:
            continue
        if actor >= 0:
            _extend_box(polygon, count, buffers, extents[actor])
        face = np.int32(m * FACES + side)
        first, last = rows_of(polygon, count, buffers)
        for r in range(first, last):
            left, right = span_of(polygon, count, r, buffers)
            _fill(buffers.q[r], buffers.faces[r], left, right, a, b * (r + 0.5) + c, face)
            if counted:
                extents[actor, 4] += _mark(buffers.marks[r], left, right, actor)


@compiled(borrowing=True)
def _extend_box(
    polygon: np.ndarray, count: int, buffers: RasterBuffers, extent: np.ndarray
) -> None:
    """Extend the actor's box in the image by the polygon, clipped to the image."""
    height, width = buffers.q.shape
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
    """Mark pixels as covered by the actor; return how many were not marked before."""
    fresh = 0
    for k in range(left, right):
        fresh += marks[k] != actor
        marks[k] = actor
    return fresh


# --------------------------------------------------------------------------------------------------
# The nearest surface of every pixel.

__all__ = ["FACES", "Lens", "Raster", "Solids", "lens_of", "rasterise", "solids_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Raster(Record):
    """The nearest surface behind every pixel.

    q: (H, W) float32, 1/m, reciprocal of the depth along the optical axis, 0 in the sky.
    faces: (H, W) int32, prism * 16 + side, prisms counted over scenery and bodies joined; -1 is
        the ground, -2 the sky. Sides 0 to 11 are upright, 12 is the top, 13 the bottom.
    boxes: (A, 4) float64, left top right bottom in pixels, of the whole actor, visible or hidden,
        clipped to the image; zeros where the actor is outside the image.
    outline_pixels: (A,) int64, pixels that the actor would cover without any other object;
        zeros unless `outlines` was set.
    """

    q: np.ndarray
    faces: np.ndarray
    boxes: np.ndarray
    outline_pixels: np.ndarray


def rasterise(
    scene: Scene,
    pinhole: Pinhole,
    world_from_camera: Pose,
    stamp_s: float,
    *,
    outlines: bool = False,
    solids: Solids | None = None,
) -> Raster:
    """Return the nearest surface behind the middle of every pixel at one instant.

    Solid bodies and the ground are exactly where `raycast.cast` has them. Foliage consists of
    cells of leaves with fixed places, so that it looks the same from frame to frame.
    """
    shape = (pinhole.height, pinhole.width)
    marks = np.empty(shape if outlines else (0, 0), np.int32)
    buffers = RasterBuffers(np.empty(shape, np.float32), np.empty(shape, np.int32), marks)
    extents = np.tile([np.inf, np.inf, -np.inf, -np.inf, 0.0], (len(scene.present), 1))
    placed = solids_of(scene, stamp_s) if solids is None else solids
    draw_all(lens_of(pinhole, world_from_camera), placed, buffers, extents)
    extents[~np.isfinite(extents[:, 0]), :4] = 0.0
    return Raster(buffers.q, buffers.faces, extents[:, :4], extents[:, 4].astype(np.int64))


def lens_of(pinhole: Pinhole, world_from_camera: Pose) -> Lens:
    """Return the camera at a pose."""
    return Lens(
        np.ascontiguousarray(world_from_camera.rotation.T),
        np.ascontiguousarray(world_from_camera.translation),
        np.array(pinhole.focal_px, np.float64),
        np.array(pinhole.centre_px, np.float64),
    )


def solids_of(scene: Scene, stamp_s: float) -> Solids:
    """Return all prisms at one instant, world frame; those of absent actors have no corners."""
    static, moving = scene.static, scene.moving
    x, y, yaw = scene.poses_at(np.array([stamp_s]))[0][moving.owners].T[:, :, None]
    along, across = moving.footprints[..., 0], moving.footprints[..., 1]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    placed = np.stack(
        [x + cosine * along - sine * across, y + sine * along + cosine * across], axis=-1
    )
    corners = np.where(scene.present[moving.owners], moving.corners, 0)
    joined = [
        np.concatenate(pair)
        for pair in (
            (static.footprints, placed),
            (static.corners, corners),
            (static.bottoms, moving.bottoms),
            (static.tops, moving.tops),
            (static.owners, moving.owners),
            (static.extinctions, moving.extinctions),
        )
    ]
    return Solids(*joined)
