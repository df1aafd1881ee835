"""The likelihood of rays given a body on its way: compiled inner loops.

A body is a stack of upright parts with rounded rectangular footprints. A ray that meets it
returns at its surface, with Gaussian noise; a ray that misses it brings no return of it. Edges
are soft by a few centimetres, because no body is exactly as drawn.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

HIT, PASSED, EMPTY = 0, 1, 2
"""A return of the body, a return from behind it, no return."""
MOST_PARTS = 8
REAR, FRONT, HALF, TAIL, NOSE, AFT, FORE, RADIUS, BOTTOM, TOP = range(10)
AFT_X, AFT_Y, AFT_REACH, FORE_X, FORE_Y, FORE_REACH = range(10, 16)
COLUMNS = 16
"""Columns of a part: x of its rear and front end, half its width between the axles, at its rear
end and at its front end, x where the narrowing begins at the rear and at the front, radius of its
four corners, heights of its bottom and its top; metres, body frame. Then the unit normals of the
left flank behind and ahead of that and how far along them it is from the centre."""
FACET_REACH = float(np.cos(np.radians(15.0)))
FACET_X = tuple(float(v) for v in np.cos(np.radians([15.0, 45.0, 75.0])))
CORNER_X = tuple(float(v) for v in np.cos(np.radians([0.0, 30.0, 60.0, 90.0])))
"""A corner of radius 1 is cut into three facets, as in a mesh: how far they are from its centre,
x of their normals and of its four corner points; y is the same from the other end."""
POSE = 6
"""x, y, yaw, speed, turn rate, acceleration: the columns of a state before those of the body."""


class Rays(NamedTuple):
    """M rays, grouped by frame.

    origin: (M, 3) metres, world frame, z above the road. direction: (M, 2) unit vectors.
    slope: (M,) rise per horizontal metre. reach: (M,) horizontal metres to the return, inf for
    none. kind: (M,) int64, `HIT`, `PASSED` or `EMPTY`. sigma: (M,) metres, of the reach.
    time: (M,) seconds from the reference time. need: (M,) cosine of incidence that a surface
    needs to be seen at one metre; it grows with the range squared.
    """

    origin: np.ndarray
    direction: np.ndarray
    slope: np.ndarray
    reach: np.ndarray
    kind: np.ndarray
    sigma: np.ndarray
    time: np.ndarray
    need: np.ndarray


class Chances(NamedTuple):
    """What the likelihood knows of errors.

    edge_m, height_m: how exactly silhouettes and the heights of parts are as drawn.
    rough_m: departure of surfaces from the drawn ones; it is in the rays' noise already.
    outlier, outlier_m: share of returns that fit nothing, spread evenly over a depth.
    lost, through: chance that a ray that meets the body returns nothing, or from behind it.
    """

    edge_m: float
    height_m: float
    rough_m: float
    outlier: float
    outlier_m: float
    lost: float
    through: float


@compiled(borrowing=True)
def log_likelihoods(
    states: np.ndarray,
    parts: np.ndarray,
    told: tuple[Rays, Chances],
    out: np.ndarray,
    found: np.ndarray,
) -> None:
    """Fill out (K,) with the log-likelihood of each state.

    states: (K, 6): x, y, yaw, speed, turn rate, acceleration at the reference time.
    parts: (K, P, 16): the body's parts for each state. found: (3, P), room to work in.
    """
    times = told[0].time
    for k in range(len(states)):
        total, product, now, place = 0.0, 1.0, np.nan, (0.0, 0.0, 1.0, 0.0)
        for m in range(len(times)):
            if times[m] != now:
                now = times[m]
                place = place_after(states[k], now)
            product *= _ray_chance(told, m, place, parts[k], found)
            # One logarithm for many factors.
            if not 1e-200 < product < 1e200:
                total += math.log(product)
                product = 1.0
        out[k] = total + math.log(product)


@compiled(borrowing=True)
def log_chances(
    states: np.ndarray,
    parts: np.ndarray,
    told: tuple[Rays, Chances],
    out: np.ndarray,
    found: np.ndarray,
) -> None:
    """Fill out (K, M) with the log-likelihood of each ray alone; arguments as above."""
    times = told[0].time
    for k in range(len(states)):
        now, place = np.nan, (0.0, 0.0, 1.0, 0.0)
        for m in range(len(times)):
            if times[m] != now:
                now = times[m]
                place = place_after(states[k], now)
            out[k, m] = math.log(_ray_chance(told, m, place, parts[k], found))


@compiled(borrowing=True, inline="always")
def _ray_chance(
    told: tuple[Rays, Chances],
    m: int,
    place: tuple[float, float, float, float],
    parts: np.ndarray,
    found: np.ndarray,
) -> float:
    rays, chances = told
    start, way = into_body(rays, m, place)
    count = _meet(start, way, parts, chances, found)
    brought = rays.reach[m], rays.sigma[m], rays.need[m]
    return _chance(rays.kind[m], brought, count, found, chances)


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
def place_after(state: np.ndarray, time: float) -> tuple[float, float, float, float]:
    """Return x, y, cosine and sine of the yaw of a state after a time."""
    x, y, yaw = pose_after(state, time)
    return x, y, math.cos(yaw), math.sin(yaw)


@compiled(borrowing=True)
def pose_after(state: np.ndarray, time: float) -> tuple[float, float, float]:
    """Return x, y, yaw of a state after a time: constant turn rate and acceleration.

    The way is taken along the chord, exact for a constant speed.
    """
    way = (state[3] + 0.5 * state[5] * time) * time
    half = 0.5 * state[4] * time
    chord = way * (1.0 - half * half / 6.0) if abs(half) < 1e-3 else way * math.sin(half) / half
    heading = state[2] + half
    return (
        state[0] + chord * math.cos(heading),
        state[1] + chord * math.sin(heading),
        state[2] + 2.0 * half,
    )


@compiled(borrowing=True)
def _meet(
    start: tuple[float, float, float],
    way: tuple[float, float, float],
    parts: np.ndarray,
    chances: Chances,
    found: np.ndarray,
) -> int:
    """List where a ray in the body's frame may meet parts.

    found (3, P): distances, chances, cosines of incidence.
    """
    count = 0
    ox, oy, oz = start
    dx, dy, slope = way
    across, middle = dx * oy - dy * ox, -(ox * dx + oy * dy)
    height = oz + slope * middle
    for p in range(len(parts)):
        part = parts[p]
        reach = abs(slope) * 0.6 * (part[FRONT] - part[REAR] + part[HALF]) + 0.1
        if height - reach > part[TOP] or height + reach < part[BOTTOM]:
            continue
        # How far inside the silhouette the ray passes; the body's core needs no closer look.
        inside, touch = 1.0, 0.0
        core = min(part[NOSE], part[TAIL]) - part[RADIUS] - 2.2 * chances.edge_m
        if abs(across + dy * 0.5 * (part[FRONT] + part[REAR])) > core:
            left, left_at = support(part, -dy, dx, ox, oy)
            right, right_at = support(part, dy, -dx, ox, oy)
            inside, touch = left - across, left_at
            if right + across < inside:
                inside, touch = right + across, right_at
            if inside < -2.2 * chances.edge_m:
                continue
        near, cosine = touch, 0.3
        if inside > 0.0:
            near, cosine = enter(part, ox, oy, dx, dy)
        if near <= 0.0:
            continue
        level = min(part[TOP] - oz - slope * near, oz + slope * near - part[BOTTOM])
        if level < 0.0 and slope != 0.0:
            near, level = _climb(part, near, (ox, oy, oz), way)
        if level < -2.2 * chances.height_m:
            continue
        chance = _soft(inside / chances.edge_m) * _soft(level / chances.height_m)
        found[0, count], found[1, count], found[2, count] = near, chance, cosine
        count += 1
    return count


@compiled(borrowing=True)
def _soft(z: float) -> float:
    """About the chance that a standard normal is below z; 0 and 1 from 2.2 on."""
    if z >= 2.2:
        return 1.0
    share = max(z, -2.2) / 4.4 + 0.5
    return share * share * (3.0 - 2.0 * share)


@compiled(borrowing=True)
def support(part: np.ndarray, nx: float, ny: float, ox: float, oy: float) -> tuple[float, float]:
    """Return how far a footprint reaches along a unit normal, and where on the ray that is.

    The ray's direction is the normal turned clockwise by 90 degrees, (ny, -nx).
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


@compiled(borrowing=True)
def _climb(
    part: np.ndarray,
    near: float,
    start: tuple[float, float, float],
    way: tuple[float, float, float],
) -> tuple[float, float]:
    """Where a ray that enters the footprint over or under a part meets its top or bottom.

    The second is by how much, metres; negative where it does not.
    """
    z, slope = start[2], way[2]
    height = z + slope * near
    far = np.inf
    if way[0] != 0.0:
        far = ((part[FRONT] if way[0] > 0.0 else part[REAR]) - start[0]) / way[0]
    if way[1] != 0.0:
        far = min(far, (math.copysign(part[HALF], way[1]) - start[1]) / way[1])
    end = z + slope * far
    if height > part[TOP]:
        if end < part[TOP]:
            return (part[TOP] - z) / slope, part[TOP] - end
        return near, part[TOP] - height
    if end > part[BOTTOM]:
        return (part[BOTTOM] - z) / slope, end - part[BOTTOM]
    return near, height - part[BOTTOM]


@compiled(borrowing=True)
def _chance(
    kind: int,
    brought: tuple[float, float, float],
    count: int,
    found: np.ndarray,
    chances: Chances,
) -> float:
    """Density of a return, or chance of none; brought: reach, sigma and need of the ray."""
    if kind == HIT:
        return _density(brought, count, found, chances)
    reach, _, need = brought
    # The chance that the ray meets no part, or that the first one that it meets sends nothing
    # back.
    free, dark = 1.0, 0.0
    for i in range(count):
        if found[0, i] >= reach:
            continue
        silent = chances.through
        if kind == EMPTY:
            silent = max(chances.lost, 1.0 - seen(need, found[0, i], found[2, i]))
        dark += _first(i, count, found) * silent
        free *= 1.0 - found[1, i]
    return free + dark


@compiled(borrowing=True)
def _first(i: int, count: int, found: np.ndarray) -> float:
    """Chance that a part is the first that a ray meets."""
    chance: float = found[1, i]
    for j in range(count):
        if found[0, j] < found[0, i]:
            chance *= 1.0 - found[1, j]
    return chance


@compiled(borrowing=True)
def seen(need: float, near: float, cosine: float) -> float:
    """Return the chance that a surface sends enough back; soft, for paints differ."""
    if need == 0.0:
        return 1.0
    ratio = cosine / (need * near * near)
    return ratio**4 / (1.0 + ratio**4)


@compiled(borrowing=True)
def _density(
    brought: tuple[float, float, float], count: int, found: np.ndarray, chances: Chances
) -> float:
    density = chances.outlier / chances.outlier_m
    reach, sigma, need = brought
    for i in range(count):
        z = (reach - found[0, i]) / sigma
        if abs(z) > 6.0:
            continue
        chance = _first(i, count, found) * (1.0 - chances.outlier) * 0.3989422804014327 / sigma
        sent = max(seen(need, found[0, i], found[2, i]), 0.01)
        density += chance * sent * math.exp(-0.5 * z * z)
    return density
