"""How far rays disagree with many states of a body at a time, one a lane.

A return disagrees by its distance from the surface, or from the silhouette that it misses; a ray
that passed by, by its depth inside the silhouette. Of the sides that face the ray the farthest
counts, of the others only one that the return is beyond. A look at how far the body reaches at most
spares most rays that pass beside it.
"""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT,
    AFT_REACH,
    AFT_X,
    AFT_Y,
    EMPTY,
    FACET_REACH,
    FACET_X,
    FORE,
    FORE_REACH,
    FORE_X,
    FORE_Y,
    FRONT,
    HALF,
    HIT,
    NOSE,
    RADIUS,
    REAR,
    TAIL,
    Rays,
    seen,
)
from roadscope.detectors.pose.body_lane_rays import HAIR_M, Path, enter, facet, may_meet, see
from roadscope.detectors.pose.body_lanes import (
    AT_X,
    AT_Y,
    COS,
    COSINE,
    INSIDE,
    LANES,
    NEAR,
    PART,
    PARTS,
    SIN,
    START_X,
    START_Y,
    WAY_X,
    WAY_Y,
    go,
)

SURPRISE = 3.5
"""Most that a ray that passed disagrees: one in 500 is lost on a body, or goes through a window."""
MISSED = 100.0
"""What a return disagrees by that meets no part's heights."""

Ray = tuple[float, float, float, float]
"""Height above the road, rise per metre, reach, need: as in `Rays`."""


@compiled(borrowing=True)
def lane_misfits(
    rays: Rays,
    noise_m: tuple[float, float],
    told: tuple[int, bool],
    storeys: np.ndarray,
    rooms: tuple[np.ndarray, np.ndarray],
) -> None:
    """Fill out (M, K) with by how many standard deviations each ray disagrees with each lane.

    noise_m: added to the noise of ranges, and of silhouettes. told: number of lanes, and whether
    any turns. storeys: (P, 7), bottom and top first. rooms: that of `body_lanes`, with places and
    parts, and out.
    """
    slack_m, edge_m = noise_m
    lanes, turns = told
    room, out = rooms
    now = np.nan
    for m in range(len(rays.slope)):
        if rays.time[m] != now:
            now = rays.time[m]
            go(now, turns, lanes, room)
        row = out[m, :lanes]
        path = rays.origin[m, 0], rays.origin[m, 1], rays.direction[m, 0], rays.direction[m, 1]
        ray = rays.origin[m, 2], rays.slope[m], rays.reach[m], rays.need[m]
        if rays.kind[m] == HIT:
            sigma = math.sqrt(rays.sigma[m] * rays.sigma[m] + slack_m * slack_m)
            row[:] = MISSED
            height = ray[0] + ray[1] * ray[2]
            for p in range(len(storeys)):
                if height <= storeys[p, 1] + 0.02 and height >= storeys[p, 0] - 0.02:
                    _off((path, ray[2]), (sigma, edge_m), room, PARTS + p * PART, row)
        else:
            dark = rays.kind[m] == EMPTY and ray[3] > 0.0
            see(path, lanes, room)
            _passed(ray, (edge_m, dark), storeys, room, row)


@compiled(borrowing=True, forceinline=True)
def _off(
    seen_at: tuple[Path, float],
    noise: tuple[float, float],
    room: np.ndarray,
    base: int,
    row: np.ndarray,
) -> None:
    """Lower the row to how far a return is outside a part, over its standard deviation."""
    ((from_x, from_y, ux, uy), reach), (sigma, edge) = seen_at, noise
    part = room[base : base + PART]
    for k in range(len(row)):
        cos, sin = room[COS + k], room[SIN + k]
        ox, oy = from_x - room[AT_X + k], from_y - room[AT_Y + k]
        dx, dy = cos * ux + sin * uy, cos * uy - sin * ux
        x, y = cos * ox + sin * oy + reach * dx, cos * oy - sin * ox + reach * dy
        rear, front, half = part[REAR * LANES + k], part[FRONT * LANES + k], part[HALF * LANES + k]
        state = -np.inf, 1.0, 0.0, 0.0
        state = _farther(state, x - front, dx)
        state = _farther(state, rear - x, -dx)
        state = _farther(state, y - half, dy)
        state = _farther(state, -y - half, -dy)
        # A flank that does not narrow is a side again, and no farther than it.
        nx, ny = part[FORE_X * LANES + k], part[FORE_Y * LANES + k]
        far = part[FORE_REACH * LANES + k]
        state = _farther(state, nx * x + ny * y - far, nx * dx + ny * dy)
        state = _farther(state, nx * x - ny * y - far, nx * dx - ny * dy)
        nx, ny = part[AFT_X * LANES + k], part[AFT_Y * LANES + k]
        far = part[AFT_REACH * LANES + k]
        state = _farther(state, nx * x + ny * y - far, nx * dx + ny * dy)
        state = _farther(state, nx * x - ny * y - far, nx * dx - ny * dy)
        r, ahead = part[RADIUS * LANES + k], x + x > front + rear
        middle = front - r if ahead else rear + r
        fx, fy = 1.0 if ahead else -1.0, math.copysign(1.0, y)
        u = fx * (x - middle)
        tail, nose = part[TAIL * LANES + k], part[NOSE * LANES + k]
        v = abs(y) - ((nose if ahead else tail) - r)
        for i in range(3):
            over = FACET_X[i] * u + FACET_X[2 - i] * v - FACET_REACH * r
            over = over if r > 0.0 else -np.inf
            state = _farther(state, over, FACET_X[i] * fx * dx + FACET_X[2 - i] * fy * dy)
        off = _over(state, sigma, edge)
        row[k] = off if abs(off) < abs(row[k]) else row[k]


_Sides = tuple[float, float, float, float]
"""Farthest side that faces the ray, its cosine, farthest beyond another side, its cosine."""


@compiled(borrowing=True, forceinline=True)
def _farther(state: _Sides, over: float, speed: float) -> _Sides:
    facing, cosine, beside, aside = state
    faces = (speed < 0.0) & (over > facing)
    passes = (not speed < 0.0) & (over > beside)
    return (
        over if faces else facing,
        -speed if faces else cosine,
        over if passes else beside,
        speed if passes else aside,
    )


@compiled(borrowing=True, forceinline=True)
def _over(state: _Sides, sigma: float, edge: float) -> float:
    facing, cosine, beside, aside = state
    lies_beside = (beside > 0.0) & (beside > facing)
    facing = beside if lies_beside else facing
    cosine = aside if lies_beside else cosine
    across = sigma * cosine
    return facing / math.sqrt(across * across + edge * edge * (1.0 - cosine * cosine))


@compiled(borrowing=True)
def _passed(
    ray: Ray, told: tuple[float, bool], storeys: np.ndarray, room: np.ndarray, row: np.ndarray
) -> None:
    """Fill in how deep inside the silhouettes of parts a ray passes that did not meet them.

    told: softness of silhouettes, metres, and whether nothing came back that could have.
    """
    row[:] = 0.0
    lanes = len(row)
    near, first, last = may_meet(HAIR_M, lanes, room)
    if not near:
        return
    (level, slope, reach, need), (edge_m, dark) = ray, told
    low, high = level + slope * first, level + slope * last
    low, high = min(low, high) - HAIR_M, max(low, high) + HAIR_M
    for p in range(len(storeys)):
        base, bottom, top = PARTS + p * PART, storeys[p, 0], storeys[p, 1]
        if low > top or high < bottom:
            continue
        if _lie_inside((level, slope), (bottom, top), lanes, room, base):
            enter(lanes, room, base)
            _sink((level, slope, reach, edge_m), (bottom, top), lanes, room)
            if dark:
                _darken(need, lanes, room)
            for k in range(lanes):
                depth = room[INSIDE + k]
                row[k] = depth if depth > row[k] else row[k]


@compiled(borrowing=True)
def _lie_inside(
    rise: tuple[float, float],
    ends: tuple[float, float],
    lanes: int,
    room: np.ndarray,
    base: int,
) -> bool:
    """Fill in how far inside a part's silhouette a ray passes, below 0 outside; tell if any is."""
    (level, slope), (bottom, top) = rise, ends
    part = room[base : base + PART]
    met = 0
    for k in range(lanes):
        ox, oy, dx, dy = room[START_X + k], room[START_Y + k], room[WAY_X + k], room[WAY_Y + k]
        across = dx * oy - dy * ox
        front, rear = part[FRONT * LANES + k], part[REAR * LANES + k]
        half, r = part[HALF * LANES + k], part[RADIUS * LANES + k]
        span = abs(slope) * 0.6 * (front - rear + half)
        height = level - slope * (ox * dx + oy * dy)
        at_height = (not height - span > top) & (not height + span < bottom)
        up, wide = abs(dx), abs(dy)
        rx, ry = facet(wide, up)
        corner = wide * (r * rx), up * r * ry
        fore, aft = part[FORE * LANES + k], part[AFT * LANES + k]
        flat = up * (half - r)
        nose = up * (part[NOSE * LANES + k] - r), front - r
        tail = up * (part[TAIL * LANES + k] - r), rear + r
        left = _most(-dy, nose, tail, (fore, aft, flat)) + corner[0] + corner[1]
        right = _most(dy, nose, tail, (fore, aft, flat)) + corner[0] + corner[1]
        a, b = left - across, right + across
        inside = b if b < a else a
        inside = inside if at_height else -1.0
        room[INSIDE + k] = inside
        met |= inside > 0.0
    return met > 0


@compiled(borrowing=True, forceinline=True)
def _most(
    nx: float,
    nose: tuple[float, float],
    tail: tuple[float, float],
    flank: tuple[float, float, float],
) -> float:
    """Return how far a part's corner centres reach along a normal."""
    fore, aft, flat = flank
    best = nx * nose[1] + nose[0]
    reach = nx * fore + flat
    best = reach if reach > best else best
    reach = nx * aft + flat
    best = reach if reach > best else best
    reach = nx * tail[1] + tail[0]
    return reach if reach > best else best


@compiled(borrowing=True)
def _sink(
    ray: tuple[float, float, float, float],
    ends: tuple[float, float],
    lanes: int,
    room: np.ndarray,
) -> None:
    """Turn how far inside a ray passes into standard deviations of depth, 0 where it does not."""
    (level, slope, reach, edge_m), (bottom, top) = ray, ends
    for k in range(lanes):
        near, inside = room[NEAR + k], room[INSIDE + k]
        height = level + slope * near
        lower = top - height
        upper = height - bottom
        # Over a roof or under a bumper is a way past too: no jump, or it would count as knowledge.
        least = lower if lower < inside else inside
        least = upper if upper < least else least
        meets = (inside > 0.0) & (near > 0.0) & (not near > reach) & (least > 0.0)
        depth = least / edge_m
        depth = SURPRISE if depth > SURPRISE else depth
        room[INSIDE + k] = depth if meets else 0.0


@compiled(borrowing=True)
def _darken(need: float, lanes: int, room: np.ndarray) -> None:
    """Lower depths for rays without a return: no surprise where a surface would hardly be seen."""
    for k in range(lanes):
        if room[INSIDE + k] > 0.0:
            dark = 1.0 - seen(need, room[NEAR + k], room[COSINE + k])
            most = math.sqrt(-2.0 * math.log(max(dark, 1e-30)))
            room[INSIDE + k] = min(room[INSIDE + k], most)
