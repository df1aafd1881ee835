"""The likelihood of rays given a body on its way, one state at a time: what lanes must say too."""

from __future__ import annotations

import math

import numpy as np
from slow_footprints import enter, into_body, support

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    BOTTOM,
    EMPTY,
    FRONT,
    HALF,
    HIT,
    MOST_PARTS,
    REAR,
    TOP,
    Chances,
    Rays,
    place_after,
    seen,
)


@compiled()
def log_chances(
    states: np.ndarray,
    parts: np.ndarray,
    told: tuple[Rays, Chances],
    out: np.ndarray,
) -> None:
    """Fill out (K, M) with the log-likelihood of each ray alone.

    states: (K, 6): x, y, yaw, speed, turn rate, acceleration at the reference time.
    parts: (K, P, 16): the body's parts for each state.
    """
    found = np.empty((3, MOST_PARTS))
    times = told[0].time
    for k in range(len(states)):
        now, place = np.nan, (0.0, 0.0, 1.0, 0.0)
        for m in range(len(times)):
            if times[m] != now:
                now = times[m]
                place = place_after(states[k], now)
            out[k, m] = math.log(_ray_chance(told, m, place, parts[k], found))


@compiled(borrowing=True)
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
    across = dx * oy - dy * ox
    for p in range(len(parts)):
        part = parts[p]
        # How far inside the silhouette the ray passes.
        left, touch = support(part, -dy, dx, ox, oy)
        right, right_at = support(part, dy, -dx, ox, oy)
        inside = left - across
        if right + across < inside:
            inside, touch = right + across, -right_at
        if inside < -2.2 * chances.edge_m:
            continue
        near, cosine = touch, 0.3
        if inside > 0.0:
            near, cosine = enter(part, ox, oy, dx, dy)
        if near <= 0.0:
            continue
        level = min(part[TOP] - oz - slope * near, oz + slope * near - part[BOTTOM])
        if level < 0.0 and inside > 0.0 and slope != 0.0:
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
            silent = max(chances.lost, 1.0 - seen(need, found[0, i], found[2, i], chances.steep))
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
        sent = max(seen(need, found[0, i], found[2, i], chances.steep), 0.01)
        density += chance * sent * math.exp(-0.5 * z * z)
    return density
