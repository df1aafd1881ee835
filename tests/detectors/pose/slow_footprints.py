"""Rays past a footprint, one at a time: what lanes must say too."""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT,
    AFT_REACH,
    AFT_X,
    AFT_Y,
    CORNER_X,
    FACET_REACH,
    FACET_X,
    FORE,
    FORE_REACH,
    FORE_X,
    FORE_Y,
    FRONT,
    HALF,
    NOSE,
    RADIUS,
    REAR,
    TAIL,
    Rays,
)


@compiled(borrowing=True, inline="always")
def into_body(
    rays: Rays, m: int, place: tuple[float, float, float, float]
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return start and way of a ray in the frame of a body at a place, as `place_after` has it."""
    x, y, cos, sin = place
    ox, oy = rays.origin[m, 0] - x, rays.origin[m, 1] - y
    ux, uy = rays.direction[m, 0], rays.direction[m, 1]
    return (
        (cos * ox + sin * oy, cos * oy - sin * ox, rays.origin[m, 2]),
        (cos * ux + sin * uy, cos * uy - sin * ux, rays.slope[m]),
    )


@compiled(borrowing=True)
def support(part: np.ndarray, nx: float, ny: float, ox: float, oy: float) -> tuple[float, float]:
    """Return how far a footprint reaches along a unit normal, and where across it that is.

    Where is how far from (ox, oy) along the normal turned clockwise by 90 degrees, (ny, -nx).
    """
    r, up = part[RADIUS], abs(ny)
    best, bx, by = -np.inf, 0.0, 0.0
    rx, ry = _facet(abs(nx), up)
    rx = r * math.copysign(rx, nx)
    for i in range(4):
        if i == 0:
            x, y = part[FRONT] - r, part[NOSE] - r
        elif i == 1:
            x, y = part[FORE], part[HALF] - r
        elif i == 2:
            x, y = part[AFT], part[HALF] - r
        else:
            x, y = part[REAR] + r, part[TAIL] - r
        reach = nx * x + up * y
        if reach > best:
            best, bx, by = reach, x, y
    x, y = bx + rx, math.copysign(by + r * ry, ny)
    return best + nx * rx + up * r * ry, (x - ox) * ny - (y - oy) * nx


@compiled(borrowing=True)
def _facet(nx: float, ny: float) -> tuple[float, float]:
    """Return the point of a unit corner's outline, cut into facets, farthest along a normal."""
    best, x, y = -np.inf, 0.0, 0.0
    for i in range(4):
        cx, cy = CORNER_X[i], CORNER_X[3 - i]
        if cx * nx + cy * ny > best:
            best, x, y = cx * nx + cy * ny, cx, cy
    return x, y


@compiled(borrowing=True)
def enter(part: np.ndarray, ox: float, oy: float, dx: float, dy: float) -> tuple[float, float]:
    """Return where a ray enters a footprint that it is known to meet, and the incidence.

    The ray enters a convex footprint where it crosses the last of the sides that face it.
    """
    near, cosine = -np.inf, 1.0
    if dx != 0.0:
        near, cosine = ((part[REAR] if dx > 0.0 else part[FRONT]) - ox) / dx, abs(dx)
    side = -1.0 if dy > 0.0 else 1.0
    if dy != 0.0:
        t = (side * part[HALF] - oy) / dy
        if t > near:
            near, cosine = t, abs(dy)
    for nx, ny, reach in (
        (part[FORE_X], part[FORE_Y], part[FORE_REACH]),
        (part[AFT_X], part[AFT_Y], part[AFT_REACH]),
        (part[FORE_X], -part[FORE_Y], part[FORE_REACH]),
        (part[AFT_X], -part[AFT_Y], part[AFT_REACH]),
    ):
        speed = nx * dx + ny * dy
        if speed < 0.0:
            t = (reach - nx * ox - ny * oy) / speed
            if t > near:
                near, cosine = t, -speed
    r = part[RADIUS]
    if r > 0.0:
        qx, qy = ox + near * dx, oy + near * dy
        cx, y, fx = part[FRONT] - r, part[NOSE] - r, 1.0
        if qx + qx < part[FRONT] + part[REAR]:
            cx, y, fx = part[REAR] + r, part[TAIL] - r, -1.0
        if abs(qy) > y and fx * (qx - cx) > 0.0:
            px, py = ox - cx, oy - math.copysign(y, qy)
            for i in range(3):
                nx, ny = fx * FACET_X[i], math.copysign(FACET_X[2 - i], qy)
                speed = nx * dx + ny * dy
                t = (FACET_REACH * r - nx * px - ny * py) / speed
                if speed < 0.0 and t > near:
                    near, cosine = t, -speed
    return near, cosine
