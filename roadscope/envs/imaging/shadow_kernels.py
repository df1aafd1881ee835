"""Shadows: what the sun does not reach."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.face_kernels import (
    GROUND_FACE,
    NEAR_M,
    Lens,
    Solids,
    into_camera,
)  # fmt: skip
from roadscope.envs.world.prisms import MAX_EDGES

LOW_M, UNDERNEATH = 0.5, 200
"""What ends lower above the ground takes this much, of 255, of the sky from the ground below."""
REACH_M = 150.0
"""Shadows that begin farther from the camera are not drawn."""


@compiled()
def cast_shadows(
    lens: Lens,
    solids: Solids,
    faces: np.ndarray,
    sun: np.ndarray,
    lit: np.ndarray,
    open_sky: np.ndarray,
) -> None:
    """Darken, in place, the ground pixels of lit and open_sky (H, W) uint8.

    lit is 255 in full sun. open_sky is 255 where the sky is seen, and less right under things
    that end close above the ground.
    """
    points, hull = np.empty((2 * MAX_EDGES, 2)), np.empty((4 * MAX_EDGES + 2, 2))
    world, polygon = np.empty((4 * MAX_EDGES + 2, 3)), np.empty((8 * MAX_EDGES, 2))
    lit[:], open_sky[:] = 255, 255
    for m in range(len(solids.corners)):
        count = solids.corners[m]
        if count == 0:
            continue
        dx = solids.footprints[m, 0, 0] - lens.origin[0]
        dy = solids.footprints[m, 0, 1] - lens.origin[1]
        if dx * dx + dy * dy > REACH_M * REACH_M:
            continue
        for k in range(count):
            x, y = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
            for i, z in enumerate((solids.bottoms[m], solids.tops[m])):
                points[2 * k + i, 0] = x - sun[0] / sun[2] * z
                points[2 * k + i, 1] = y - sun[1] / sun[2] * z
        corners = _hull(points[: 2 * count], hull)
        for k in range(corners):
            world[k, 0], world[k, 1], world[k, 2] = hull[k, 0], hull[k, 1], 0.0
        corners = _project_flat(lens, world, corners, polygon)
        if corners >= 3:
            shade = 255
            if solids.extinctions[m] > 0.0:
                thick = solids.tops[m] - solids.bottoms[m]
                shade = int(255.0 * (1.0 - np.exp(-solids.extinctions[m] * thick)))
            _darken(polygon, corners, faces, shade, lit)
        if 0.0 < solids.bottoms[m] < LOW_M:
            for k in range(count):
                world[k, 0], world[k, 1] = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
                world[k, 2] = 0.0
            corners = _project_flat(lens, world, count, polygon)
            if corners >= 3:
                _darken(polygon, corners, faces, UNDERNEATH, open_sky)


@compiled()
def _hull(points: np.ndarray, hull: np.ndarray) -> int:
    """Corners of the convex hull, counter-clockwise; insertion sort, then two chains."""
    for i in range(1, len(points)):
        x, y, j = points[i, 0], points[i, 1], i - 1
        while j >= 0 and (points[j, 0] > x or (points[j, 0] == x and points[j, 1] > y)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = x, y
    size = 0
    for turn in range(2):
        start = size
        for n in range(len(points)):
            i = n if turn == 0 else len(points) - 1 - n
            x, y = points[i, 0], points[i, 1]
            while size >= start + 2 and _left(hull, size, x, y) <= 0.0:
                size -= 1
            hull[size, 0], hull[size, 1] = x, y
            size += 1
        size -= 1
    return size


@compiled(forceinline=True)
def _left(hull: np.ndarray, size: int, x: float, y: float) -> float:
    ax, ay = hull[size - 2, 0], hull[size - 2, 1]
    turn: float = (hull[size - 1, 0] - ax) * (y - ay) - (hull[size - 1, 1] - ay) * (x - ax)
    return turn


@compiled()
def _project_flat(lens: Lens, world: np.ndarray, corners: int, polygon: np.ndarray) -> int:
    """Cut a polygon at the near plane and write it in pixels; return its corners."""
    count = 0
    last = corners - 1
    x0, y0, z0 = into_camera(lens, world[last, 0], world[last, 1], world[last, 2])
    for k in range(corners):
        x1, y1, z1 = into_camera(lens, world[k, 0], world[k, 1], world[k, 2])
        if (z0 < NEAR_M) != (z1 < NEAR_M):
            share = (NEAR_M - z0) / (z1 - z0)
            x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            polygon[count, 0] = lens.focal[0] * x / NEAR_M + lens.centre[0]
            polygon[count, 1] = lens.focal[1] * y / NEAR_M + lens.centre[1]
            count += 1
        if z1 >= NEAR_M:
            polygon[count, 0] = lens.focal[0] * x1 / z1 + lens.centre[0]
            polygon[count, 1] = lens.focal[1] * y1 / z1 + lens.centre[1]
            count += 1
        x0, y0, z0 = x1, y1, z1
    return count


@compiled()
def _darken(
    polygon: np.ndarray, corners: int, faces: np.ndarray, shade: int, lit: np.ndarray
) -> None:
    height, width = faces.shape
    top = bottom = polygon[0, 1]
    for k in range(1, corners):
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    first = int(max(0.0, np.ceil(min(top, 1.0 * height) - 0.5)))
    last = int(max(0.0, min(1.0 * height, np.ceil(bottom - 0.5))))
    for r in range(first, last):
        y, left, right = r + 0.5, np.inf, -np.inf
        x0, y0 = polygon[corners - 1, 0], polygon[corners - 1, 1]
        for k in range(corners):
            x1, y1 = polygon[k, 0], polygon[k, 1]
            if (y0 <= y) != (y1 <= y):
                x = x0 + (y - y0) * ((x1 - x0) / (y1 - y0))
                left, right = min(left, x), max(right, x)
            x0, y0 = x1, y1
        if left > right:
            continue
        for k in range(
            int(min(1.0 * width, max(0.0, np.ceil(left - 0.5)))),
            int(min(1.0 * width, max(0.0, np.ceil(right - 0.5)))),
        ):
            if faces[r, k] == GROUND_FACE:
                lit[r, k] = np.uint8(lit[r, k] * (255 - shade) // 255)


@compiled()
def sunlit(solids: Solids, sun: np.ndarray, lens: Lens, shares: np.ndarray) -> None:
    """Fill shares (P,), how much sun reaches the middle of the upper half of each prism."""
    for m in range(len(shares)):
        shares[m] = 1.0
        if solids.corners[m] == 0:
            continue
        x = y = 0.0
        for k in range(solids.corners[m]):
            x += solids.footprints[m, k, 0] / solids.corners[m]
            y += solids.footprints[m, k, 1] / solids.corners[m]
        dx, dy = x - lens.origin[0], y - lens.origin[1]
        if dx * dx + dy * dy > REACH_M * REACH_M:
            continue
        z = 0.25 * solids.bottoms[m] + 0.75 * solids.tops[m]
        for n in range(len(shares)):
            if solids.owners[n] != solids.owners[m] and solids.tops[n] > z:
                path = _path(solids, n, x, y, z, sun)
                if path > 0.0:
                    porous = solids.extinctions[n]
                    shares[m] *= np.exp(-porous * path) if porous > 0.0 else 0.0
                    if shares[m] < 0.01:
                        break


@compiled()
def _path(solids: Solids, n: int, x: float, y: float, z: float, sun: np.ndarray) -> float:
    """Length of the way from a point towards the sun inside a prism."""
    enter = max(0.0, (solids.bottoms[n] - z) / sun[2])
    leave = (solids.tops[n] - z) / sun[2]
    count = solids.corners[n]
    for k in range(count):
        if enter >= leave:
            return 0.0
        after = k + 1 if k + 1 < count else 0
        px, py = solids.footprints[n, k, 0], solids.footprints[n, k, 1]
        nx, ny = solids.footprints[n, after, 1] - py, px - solids.footprints[n, after, 0]
        room, pace = nx * (px - x) + ny * (py - y), nx * sun[0] + ny * sun[1]
        if pace > 0.0:
            leave = min(leave, room / pace)
        elif pace < 0.0:
            enter = max(enter, room / pace)
        elif room < 0.0:
            return 0.0
    length: float = max(0.0, leave - enter)
    return length
