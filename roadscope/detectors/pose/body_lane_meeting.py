"""Which parts of many bodies a ray may meet, where and how likely, one body a lane.

Edges are soft by a few centimetres, because no body is exactly as drawn.
"""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT,
    FORE,
    FRONT,
    HALF,
    NOSE,
    RADIUS,
    REAR,
    TAIL,
    Chances,
)
from roadscope.detectors.pose.body_lane_rays import HAIR_M, enter, facet, may_meet
from roadscope.detectors.pose.body_lanes import (
    COSINE,
    INSIDE,
    LANES,
    LEVEL,
    NEAR,
    PART,
    PARTS,
    START_X,
    START_Y,
    TOUCH,
    WAY_X,
    WAY_Y,
)

SOFT = 2.2
"""An edge is soft over so many standard deviations to either side."""
ASLANT = 0.3
"""Cosine of incidence where a ray meets a part only because its silhouette is soft."""
DISTANCE, CHANCE, BRIGHT, FIRST = range(4)
"""Rows of a part that a ray may meet: how far it is, the chance that it does, the chance that the
part sends enough back (before that: the cosine of incidence), and that it is the first one met."""


@compiled(borrowing=True)
def meet(
    rise: tuple[float, float],
    chances: Chances,
    storeys: np.ndarray,
    lanes: int,
    rooms: tuple[np.ndarray, np.ndarray],
) -> int:
    """List the parts that a ray may meet in any lane, and return how many.

    rise: height of the start above the road, and per metre. rooms: that of `body_lanes`, and
    (P, 4, LANES), filled in but for which part is the first.
    """
    room, met = rooms
    level, slope = rise
    edge, slack = SOFT * chances.edge_m, SOFT * chances.height_m + HAIR_M
    near, first, last = may_meet(edge + HAIR_M, lanes, room)
    if not near:
        return 0
    low, high = level + slope * first, level + slope * last
    low, high = min(low, high) - slack, max(low, high) + slack
    count = 0
    for p in range(len(storeys)):
        base, ends = PARTS + p * PART, (storeys[p, 0], storeys[p, 1])
        if low > ends[1] or high < ends[0]:
            continue
        soft = edge, ends[0] - slack, ends[1] + slack
        touched, entered = _pass(rise, soft, lanes, room, base)
        if not touched:
            continue
        if entered:
            enter(lanes, room, base)
        if _rise(rise, ends, lanes, room):
            _climb(rise, ends, lanes, room, base)
        if _keep(chances, lanes, room, met[count]):
            count += 1
    return count


@compiled(borrowing=True)
def _pass(
    rise: tuple[float, float],
    soft: tuple[float, float, float],
    lanes: int,
    room: np.ndarray,
    base: int,
) -> tuple[bool, bool]:
    """Fill in how far inside a part's silhouette a ray passes, and where.

    Tell whether any lane's part may be met and whether one may be entered. soft: metres over
    which a silhouette is, and bottom and top of the part with those over which they are.
    """
    (level, slope), (edge, bottom, top) = rise, soft
    steep = abs(slope)
    part = room[base : base + PART]
    touched, entered = 0, 0
    for k in range(lanes):
        ox, oy, dx, dy = room[START_X + k], room[START_Y + k], room[WAY_X + k], room[WAY_Y + k]
        across, r = dx * oy - dy * ox, part[RADIUS * LANES + k]
        front, rear = part[FRONT * LANES + k], part[REAR * LANES + k]
        fore, aft, half = part[FORE * LANES + k], part[AFT * LANES + k], part[HALF * LANES + k]
        tail, nose = part[TAIL * LANES + k] - r, part[NOSE * LANES + k] - r
        up, wide = abs(dx), abs(dy)
        rx, ry = facet(wide, up)
        rx, ry = r * rx, r * ry
        points, flank = (front - r, nose, rear + r, tail), (fore, aft, half - r)
        left, left_x, left_y = _farthest(-dy, up, points, flank)
        right, right_x, right_y = _farthest(dy, up, points, flank)
        left, right = left + wide * rx + up * ry - across, right + wide * rx + up * ry + across
        is_right = right < left
        inside = right if is_right else left
        x, y = right_x if is_right else left_x, right_y if is_right else left_y
        x += math.copysign(rx, dy if is_right else -dy)
        y = math.copysign(y + ry, -dx if is_right else dx)
        # Between these heights it is above the rectangle around the footprint.
        middle = level + slope * (0.5 * (front + rear) * dx - ox * dx - oy * dy)
        span = steep * (0.5 * (front - rear) * up + half * wide)
        inside = inside if (middle - span <= top) & (middle + span >= bottom) else -np.inf
        room[INSIDE + k], room[TOUCH + k] = inside, (x - ox) * dx + (y - oy) * dy
        touched |= inside >= -edge
        entered |= inside > 0.0
    return touched > 0, entered > 0


_Farthest = tuple[float, float, float]
"""How far the farthest of points reaches along a normal, and the point."""


@compiled(borrowing=True, forceinline=True)
def _further(best: _Farthest, nx: float, up: float, x: float, y: float) -> _Farthest:
    reach = nx * x + up * y
    farther = reach > best[0]
    return (
        reach if farther else best[0],
        x if farther else best[1],
        y if farther else best[2],
    )


@compiled(borrowing=True, forceinline=True)
def _farthest(
    nx: float,
    up: float,
    ends: tuple[float, float, float, float],
    flank: tuple[float, float, float],
) -> _Farthest:
    """Return the farthest of a part's corner centres."""
    front, nose, rear, tail = ends
    fore, aft, half = flank
    best = nx * front + up * nose, front, nose
    best = _further(best, nx, up, fore, half)
    best = _further(best, nx, up, aft, half)
    return _further(best, nx, up, rear, tail)


@compiled(borrowing=True)
def _rise(
    rise: tuple[float, float], ends: tuple[float, float], lanes: int, room: np.ndarray
) -> bool:
    """Fill in how far within a part's heights a ray is where it meets the part's footprint.

    Tell whether any lane's is outside and may yet climb in.
    """
    (level, slope), (bottom, top) = rise, ends
    out = 0
    for k in range(lanes):
        inside = room[INSIDE + k]
        entered = inside > 0.0
        # Read first and chosen then, or loops would not take several lanes at a time.
        near, touch, cosine = room[NEAR + k], room[TOUCH + k], room[COSINE + k]
        near = near if entered else touch
        # Behind the sensor is no way to meet it.
        room[INSIDE + k] = inside if near > 0.0 else -np.inf
        room[NEAR + k], room[COSINE + k] = near, cosine if entered else ASLANT
        height = level + slope * near
        over, under = top - height, height - bottom
        least = under if under < over else over
        room[LEVEL + k] = least
        out |= entered & (least < 0.0)
    return out > 0 and slope != 0.0


@compiled(borrowing=True)
def _climb(
    rise: tuple[float, float],
    ends: tuple[float, float],
    lanes: int,
    room: np.ndarray,
    base: int,
) -> None:
    """Fill in where a ray that enters a footprint over or under the part meets top or bottom.

    And how far within the part's heights it then leaves, for a level.
    """
    (z, slope), (bottom, top) = rise, ends
    part = room[base : base + PART]
    to_top, to_bottom = (top - z) / slope, (bottom - z) / slope
    for k in range(lanes):
        ox, oy, dx, dy = room[START_X + k], room[START_Y + k], room[WAY_X + k], room[WAY_Y + k]
        front, rear, half = part[FRONT * LANES + k], part[REAR * LANES + k], part[HALF * LANES + k]
        far = ((front if dx > 0.0 else rear) - ox) / dx
        far = far if dx != 0.0 else np.inf
        aside = ((half if dy > 0.0 else -half) - oy) / dy
        far = aside if (dy != 0.0) & (aside < far) else far
        near, level, inside = room[NEAR + k], room[LEVEL + k], room[INSIDE + k]
        over = z + slope * near > top
        end = z + slope * far
        within = top - end if over else end - bottom
        climbs = (inside > 0.0) & (level < 0.0) & (within > 0.0)
        room[NEAR + k] = (to_top if over else to_bottom) if climbs else near
        room[LEVEL + k] = within if climbs else level


@compiled(borrowing=True)
def _keep(chances: Chances, lanes: int, room: np.ndarray, met: np.ndarray) -> bool:
    """Fill in the rows of a part that a ray may meet; tell whether it does in any lane."""
    any_meets = 0
    edge_m, height_m = chances.edge_m, chances.height_m
    for k in range(lanes):
        near = room[NEAR + k]
        chance = _soft(room[INSIDE + k] / edge_m) * _soft(room[LEVEL + k] / height_m)
        meets = chance > 0.0
        met[DISTANCE, k], met[BRIGHT, k] = near if meets else 1.0, room[COSINE + k]
        met[CHANCE, k] = chance if meets else 0.0
        any_meets |= meets
    return any_meets > 0


@compiled(borrowing=True, forceinline=True)
def _soft(z: float) -> float:
    """About the chance that a standard normal is below z; 0 and 1 from 2.2 on."""
    z = z if z < SOFT else SOFT
    z = z if z > -SOFT else -SOFT
    share = z / (SOFT + SOFT) + 0.5
    return share * share * (3.0 - 2.0 * share)
