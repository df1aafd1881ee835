"""How rays pass many bodies and where they enter their parts, one body a lane."""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT_REACH,
    AFT_X,
    AFT_Y,
    CORNER_X,
    FACET_REACH,
    FACET_X,
    FORE_REACH,
    FORE_X,
    FORE_Y,
    FRONT,
    HALF,
    NOSE,
    RADIUS,
    REAR,
    TAIL,
)
from roadscope.detectors.pose.body_lanes import (
    AHEAD,
    ASIDE,
    AT_X,
    AT_Y,
    BACK,
    COS,
    COSINE,
    LANES,
    NEAR,
    PART,
    SIN,
    START_X,
    START_Y,
    TOUCH,
    WAY_X,
    WAY_Y,
)

HAIR_M = 1e-6
"""Rays that pass farther than this outside of all parts need no closer look."""

Path = tuple[float, float, float, float]
"""Seen from above: x and y of origin and direction."""


@compiled(borrowing=True, forceinline=True)
def see(path: Path, lanes: int, room: np.ndarray) -> None:
    """Fill in start and way of a ray in the frame of each lane's body."""
    x, y, ux, uy = path
    for k in range(lanes):
        cos, sin = room[COS + k], room[SIN + k]
        ox, oy = x - room[AT_X + k], y - room[AT_Y + k]
        room[START_X + k], room[START_Y + k] = cos * ox + sin * oy, cos * oy - sin * ox
        room[WAY_X + k], room[WAY_Y + k] = cos * ux + sin * uy, cos * uy - sin * ux


@compiled(borrowing=True)
def may_meet(margin: float, lanes: int, room: np.ndarray) -> tuple[bool, float, float]:
    """Tell whether a ray comes as near as a margin to what any lane's body does not reach beyond.

    The others are the least and greatest distance on the ray's way between which bodies lie.
    """
    near = 0
    for k in range(lanes):
        dx, dy = room[WAY_X + k], room[WAY_Y + k]
        ox, oy = room[START_X + k], room[START_Y + k]
        along, across = ox * dx + oy * dy, dx * oy - dy * ox
        ahead, back, aside = room[AHEAD + k], room[BACK + k], room[ASIDE + k]
        half, middle = 0.5 * (ahead - back), 0.5 * (ahead + back)
        near |= abs(across + dy * middle) < abs(dx) * aside + abs(dy) * half + margin
        deep, centre = abs(dy) * aside + abs(dx) * half, dx * middle - along
        room[NEAR + k], room[TOUCH + k] = centre - deep, centre + deep
    # Loops that find the least of something take no other work.
    first, last = np.inf, -np.inf
    for k in range(lanes):
        first = room[NEAR + k] if room[NEAR + k] < first else first
    for k in range(lanes):
        last = room[TOUCH + k] if room[TOUCH + k] > last else last
    return near > 0, first, last


@compiled(borrowing=True, forceinline=True)
def facet(nx: float, ny: float) -> tuple[float, float]:
    """Return the point of a unit corner's outline, cut into facets, farthest along a normal."""
    x, y = CORNER_X[0], CORNER_X[3]
    best = x * nx + y * ny
    for i in range(1, 4):
        reach = CORNER_X[i] * nx + CORNER_X[3 - i] * ny
        farther = reach > best
        best = reach if farther else best
        x, y = CORNER_X[i] if farther else x, CORNER_X[3 - i] if farther else y
    return x, y


@compiled(borrowing=True)
def enter(lanes: int, room: np.ndarray, base: int) -> None:
    """Fill in where a ray enters a part that it is known to meet, and the incidence.

    The ray enters a convex footprint where it crosses the last of the sides that face it.
    """
    part = room[base : base + PART]
    for k in range(lanes):
        ox, oy, dx, dy = room[START_X + k], room[START_Y + k], room[WAY_X + k], room[WAY_Y + k]
        front, rear = part[FRONT * LANES + k], part[REAR * LANES + k]
        half, r = part[HALF * LANES + k], part[RADIUS * LANES + k]
        tail, nose = part[TAIL * LANES + k], part[NOSE * LANES + k]
        met = _later((np.inf, -1.0), ox - rear if dx > 0.0 else front - ox, -abs(dx))
        met = _later(met, half + oy if dy > 0.0 else half - oy, -abs(dy))
        nx, ny = part[FORE_X * LANES + k], part[FORE_Y * LANES + k]
        far = part[FORE_REACH * LANES + k]
        met = _later(met, far - nx * ox - ny * oy, nx * dx + ny * dy)
        mirrored = far - nx * ox + ny * oy, nx * dx - ny * dy
        nx, ny = part[AFT_X * LANES + k], part[AFT_Y * LANES + k]
        far = part[AFT_REACH * LANES + k]
        met = _later(met, far - nx * ox - ny * oy, nx * dx + ny * dy)
        met = _later(met, mirrored[0], mirrored[1])
        met = _later(met, far - nx * ox + ny * oy, nx * dx - ny * dy)
        near = met[0] / met[1]
        qx, qy = ox + near * dx, oy + near * dy
        behind = qx + qx < front + rear
        cx, fx = rear + r if behind else front - r, -1.0 if behind else 1.0
        cy = (tail if behind else nose) - r
        rounded = (r > 0.0) & (abs(qy) > cy) & (fx * (qx - cx) > 0.0)
        px, py = ox - cx, oy - math.copysign(cy, qy)
        for i in range(3):
            nx, ny = fx * FACET_X[i], math.copysign(FACET_X[2 - i], qy)
            speed = nx * dx + ny * dy
            speed = speed if rounded else 1.0
            met = _later(met, FACET_REACH * r - nx * px - ny * py, speed)
        room[NEAR + k], room[COSINE + k] = met[0] / met[1], -met[1]


@compiled(borrowing=True, forceinline=True)
def _later(met: tuple[float, float], way: float, speed: float) -> tuple[float, float]:
    """Return the side that a ray crosses later, as its distance and the ray's speed away from it.

    Without dividing one by the other: that takes longer than all else.
    """
    later = (speed < 0.0) & (way * met[1] > met[0] * speed)
    return way if later else met[0], speed if later else met[1]
