"""The likelihood of rays given many states of a body on its way, one state a lane.

A body is a stack of upright parts with rounded rectangular footprints. A ray that meets it
returns at its surface, with Gaussian noise; a ray that misses it brings no return of it. Edges
are soft by a few centimetres, because no body is exactly as drawn.
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
    HIT,
    MOST_PARTS,
    NOSE,
    PASSED,
    RADIUS,
    REAR,
    TAIL,
    Chances,
    Rays,
    seen,
)
from roadscope.detectors.pose.body_lane_rays import HAIR_M, enter, facet, may_meet, see
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
    Drawn,
    draw,
    even,
    go,
    lay,
    new_room,
    stand,
)

SOFT = 2.2
"""An edge is soft over so many standard deviations to either side."""
ASLANT = 0.3
"""Cosine of incidence where a ray meets a part only because its silhouette is soft."""
GAUSS = 0.3989422804014327
"""Density of a standard normal at its middle."""
NOISE = 6.0
"""Returns farther than so many standard deviations from a surface are none of it."""
DISTANCE, CHANCE, BRIGHT, FIRST = range(4)
"""Rows of a part that a ray may meet: how far it is, the chance that it does, the chance that the
part sends enough back (before that: the cosine of incidence), and that it is the first one met."""
EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(12, -1, -1))
"""Its series, the last term first."""


@compiled()
def log_likelihoods(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
) -> np.ndarray:
    """Return the log-likelihood (K,) of each of (K, D) vectors.

    kept: `free` (D,), indices of the vector's values among the 11, and `fixed` (11,), the others.
    """
    count, rays = len(vectors), told[0]
    out, sums = np.empty(count), np.empty((2, LANES))
    room, met = new_room(len(body.storeys)), np.empty((MOST_PARTS, 4, LANES))
    each = np.empty((len(rays.slope), LANES))
    for first in range(0, count, LANES):
        last = min(first + LANES, count)
        _fill(vectors[first:last], body, kept, told, (room, met, each))
        _add_logs(each, even(last - first), sums)
        out[first:last] = sums[0, : last - first]
    return out


@compiled()
def ray_chances(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
) -> np.ndarray:
    """Return the likelihood (K, M) of each ray alone; arguments as above."""
    count, rays = len(vectors), told[0]
    out = np.empty((count, len(rays.slope)))
    room, met = new_room(len(body.storeys)), np.empty((MOST_PARTS, 4, LANES))
    each = np.empty((len(rays.slope), LANES))
    for first in range(0, count, LANES):
        last = min(first + LANES, count)
        _fill(vectors[first:last], body, kept, told, (room, met, each))
        for k in range(first, last):
            out[k] = each[:, k - first]
    return out


@compiled(borrowing=True)
def _fill(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
    rooms: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Fill in the density of each return, or the chance of none.

    rooms: that of `body_lanes`; (P, 4, LANES), what a ray meets; and (M, LANES), filled in.
    """
    free, fixed = kept
    room, _, _ = rooms
    lanes = even(len(vectors))
    lay(vectors, free, fixed, room)
    turns = stand(lanes, room)
    draw(body, lanes, room)
    _lane_chances(told, (lanes, turns), body.storeys, rooms)


@compiled(borrowing=True)
def _lane_chances(
    told: tuple[Rays, Chances],
    standing: tuple[int, bool],
    storeys: np.ndarray,
    rooms: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Do as `_fill` does for lanes that stand and are drawn; standing: how many, and any turns."""
    (rays, chances), (lanes, turns), (room, met, out) = told, standing, rooms
    now = np.nan
    for m in range(len(rays.slope)):
        if rays.time[m] != now:
            now = rays.time[m]
            go(now, turns, lanes, room)
        path = rays.origin[m, 0], rays.origin[m, 1], rays.direction[m, 0], rays.direction[m, 1]
        see(path, lanes, room)
        rise = rays.origin[m, 2], rays.slope[m]
        count = _meet(rise, chances, storeys, lanes, (room, met))
        _order(count, lanes, met)
        passed = rays.kind[m] == PASSED
        _brighten(0.0 if passed else rays.need[m], count, lanes, met)
        row, free = out[m, :lanes], room[LEVEL : LEVEL + lanes]
        if rays.kind[m] == HIT:
            _returned(rays.reach[m], rays.sigma[m], chances, met[:count], row)
        else:
            silent = chances.through if passed else chances.lost
            _kept_silent(rays.reach[m], silent, met[:count], free, row)


@compiled(borrowing=True)
def _meet(
    rise: tuple[float, float],
    chances: Chances,
    storeys: np.ndarray,
    lanes: int,
    rooms: tuple[np.ndarray, np.ndarray],
) -> int:
    """List the parts that a ray may meet in any lane; fill in all but which is the first."""
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


@compiled(borrowing=True)
def _order(count: int, lanes: int, met: np.ndarray) -> None:
    """Fill in the chance that each part is the first that a ray meets."""
    for i in range(count):
        here = met[i]
        for k in range(lanes):
            here[FIRST, k] = here[CHANCE, k]
        for j in range(count):
            there = met[j]
            if i != j:
                for k in range(lanes):
                    left = 1.0 - there[CHANCE, k]
                    nearer = there[DISTANCE, k] < here[DISTANCE, k]
                    here[FIRST, k] *= left if nearer else 1.0


@compiled(borrowing=True)
def _brighten(need: float, count: int, lanes: int, met: np.ndarray) -> None:
    """Turn cosines of incidence into the chance that the surface sends enough back."""
    for i in range(count):
        here = met[i]
        if need == 0.0:
            here[BRIGHT, :lanes] = 1.0
            continue
        for k in range(lanes):
            here[BRIGHT, k] = seen(need, here[DISTANCE, k], here[BRIGHT, k])


@compiled(borrowing=True)
def _returned(
    reach: float, sigma: float, chances: Chances, met: np.ndarray, row: np.ndarray
) -> None:
    """Fill in the density of a return."""
    row[:] = chances.outlier / chances.outlier_m
    peak = (1.0 - chances.outlier) * GAUSS / sigma
    for i in range(len(met)):
        here = met[i]
        for k in range(len(row)):
            z = (reach - here[DISTANCE, k]) / sigma
            sent = here[BRIGHT, k]
            sent = sent if sent > 0.01 else 0.01
            density = here[FIRST, k] * peak * sent * _fallen(z * z)
            row[k] += density if abs(z) <= NOISE else 0.0


@compiled(borrowing=True, forceinline=True)
def _fallen(square: float) -> float:
    """Return exp(-square / 2) for a square from 0 to 36, in lanes, all but to the last bit.

    The series of the 32nd root is short.
    """
    x = square if square < 36.0 else 36.0
    x = x * (-0.5 / 32.0)
    power = 0.0
    for k in range(len(EXPONENTIAL)):
        power = EXPONENTIAL[k] + x * power
    for _ in range(5):
        power *= power
    return power


@compiled(borrowing=True)
def _kept_silent(
    reach: float, silent: float, met: np.ndarray, free: np.ndarray, row: np.ndarray
) -> None:
    """Fill in the chance that a ray meets no part, or that the first one sends nothing back.

    silent: least chance of that. free: room to work in.
    """
    row[:] = 0.0
    free[:] = 1.0
    for i in range(len(met)):
        here = met[i]
        for k in range(len(row)):
            dark = 1.0 - here[BRIGHT, k]
            dark = dark if dark > silent else silent
            before = here[DISTANCE, k] < reach
            row[k] += here[FIRST, k] * dark if before else 0.0
            free[k] *= 1.0 - here[CHANCE, k] if before else 1.0
    for k in range(len(row)):
        row[k] += free[k]


@compiled(borrowing=True)
def _add_logs(each: np.ndarray, lanes: int, sums: np.ndarray) -> None:
    """Fill in the sum of logarithms of each lane's chances (M, LANES) in the first row of sums."""
    totals, products = sums[0, :lanes], sums[1, :lanes]
    totals[:] = 0.0
    products[:] = 1.0
    for m in range(len(each)):
        row, many = each[m], 0
        for k in range(lanes):
            product = products[k] * row[k]
            products[k] = product
            many |= (product > 1e200) | (product < 1e-200)
        # One logarithm for many factors.
        if many:
            for k in range(lanes):
                totals[k] += math.log(products[k])
                products[k] = 1.0
    for k in range(lanes):
        totals[k] += math.log(products[k])
