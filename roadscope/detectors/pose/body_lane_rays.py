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


@compiled(borrowing=True, fastmath=True)
def may_meet(margin: float, lanes: int, room: np.ndarray) -> tuple[bool, float, float]:
    """Tell whether a ray comes as near as a margin to what any lane's body does not reach beyond.

    The others are the least and greatest distance on the ray's way between which bodies lie.
    """
    near, first, last = 0, np.inf, -np.inf
    for k in range(lanes):
        dx, dy = room[WAY_X + k], room[WAY_Y + k]
        ox, oy = room[START_X + k], room[START_Y + k]
        along, across = ox * dx + oy * dy, dx * oy - dy * ox
        aside = abs(dx) * room[ASIDE + k] + margin
        fore, rear = dy * room[AHEAD + k], dy * room[BACK + k]
        low, high = fore if fore < rear else rear, rear if fore < rear else fore
        near |= (aside - low - across > 0.0) & (aside + high + across > 0.0)
        deep = abs(dy) * room[ASIDE + k]
        fore, rear = dx * room[AHEAD + k], dx * room[BACK + k]
        begin, end = fore if fore < rear else rear, rear if fore < rear else fore
        begin, end = begin - deep - along, end + deep - along
        first, last = begin if begin < first else first, end if end > last else last
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
    """Fill in where a ray enters a part that it is known to meet, and the incidence."""
    part = room[base : base + PART]
    for k in range(lanes):
        ox, oy, dx, dy = room[START_X + k], room[START_Y + k], room[WAY_X + k], room[WAY_Y + k]
        front, rear = part[FRONT * LANES + k], part[REAR * LANES + k]
        half, r = part[HALF * LANES + k], part[RADIUS * LANES + k]
        tail, nose = part[TAIL * LANES + k], part[NOSE * LANES + k]
        near = ((rear if dx > 0.0 else front) - ox) / dx
        near, cosine = near if dx != 0.0 else -np.inf, abs(dx) if dx != 0.0 else 1.0
        side = ((-half if dy > 0.0 else half) - oy) / dy
        later = (dy != 0.0) & (side > near)
        met = side if later else near, abs(dy) if later else cosine
        nx, ny = part[FORE_X * LANES + k], part[FORE_Y * LANES + k]
        far = part[FORE_REACH * LANES + k]
        met = _later(met, far - nx * ox - ny * oy, nx * dx + ny * dy)
        mirrored = far - nx * ox + ny * oy, nx * dx - ny * dy
        nx, ny = part[AFT_X * LANES + k], part[AFT_Y * LANES + k]
        far = part[AFT_REACH * LANES + k]
        met = _later(met, far - nx * ox - ny * oy, nx * dx + ny * dy)
        met = _later(met, mirrored[0], mirrored[1])
        met = _later(met, far - nx * ox + ny * oy, nx * dx - ny * dy)
        near, cosine = met
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
        room[NEAR + k], room[COSINE + k] = met


@compiled(borrowing=True, forceinline=True)
def _later(met: tuple[float, float], way: float, speed: float) -> tuple[float, float]:
    near, cosine = met
    t = way / speed
    later = (speed < 0.0) & (t > near)
    return t if later else near, -speed if later else cosine
