"""How far rays disagree with a body on its way, one state at a time: what lanes must say too."""

from __future__ import annotations

import math

import numpy as np
from slow_footprints import enter, into_body, support

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT_REACH,
    AFT_X,
    AFT_Y,
    BOTTOM,
    EMPTY,
    FACET_REACH,
    FACET_X,
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
    TOP,
    Rays,
    place_after,
    seen,
)
from roadscope.detectors.pose.body_lane_misfits import SURPRISE


@compiled(borrowing=True)
def misfits(
    states: np.ndarray,
    parts: np.ndarray,
    rays: Rays,
    noise_m: tuple[float, float],
    out: np.ndarray,
) -> None:
    """Fill out (K, M) with by how many standard deviations each ray disagrees with each state.

    A return disagrees by its distance from the surface, or from the silhouette that it misses; a
    ray that passed by, by its depth inside the silhouette. noise_m: added to the noise of ranges,
    and of silhouettes.
    """
    slack_m, edge_m = noise_m
    for k in range(len(states)):
        now, place = np.nan, (0.0, 0.0, 1.0, 0.0)
        for m in range(len(rays.slope)):
            if rays.time[m] != now:
                now = rays.time[m]
                place = place_after(states[k], now)
            sigma = math.sqrt(rays.sigma[m] * rays.sigma[m] + slack_m * slack_m)
            brought = rays.reach[m], sigma, rays.need[m]
            ray = into_body(rays, m, place)
            out[k, m] = _misfit(ray, parts[k], rays.kind[m], brought, edge_m)


@compiled(borrowing=True)
def _misfit(
    ray: tuple[tuple[float, float, float], tuple[float, float, float]],
    parts: np.ndarray,
    kind: int,
    brought: tuple[float, float, float],
    edge_m: float,
) -> float:
    (ox, oy, oz), (dx, dy, slope) = ray
    reach, sigma, need = brought
    across = dx * oy - dy * ox
    level = oz - slope * (ox * dx + oy * dy)
    worst = 0.0 if kind != HIT else 100.0
    for p in range(len(parts)):
        part = parts[p]
        if kind == HIT:
            height = oz + slope * reach
            if height <= part[TOP] + 0.02 and height >= part[BOTTOM] - 0.02:
                point = ox + reach * dx, oy + reach * dy
                off = _off(part, point, dx, dy, (sigma, edge_m))
                if abs(off) < abs(worst):
                    worst = off
            continue
        span = abs(slope) * 0.6 * (part[FRONT] - part[REAR] + part[HALF])
        if level - span > part[TOP] or level + span < part[BOTTOM]:
            continue
        left, _ = support(part, -dy, dx, ox, oy)
        right, _ = support(part, dy, -dx, ox, oy)
        inside = min(left - across, right + across)
        if inside <= 0.0:
            continue
        near, cosine = enter(part, ox, oy, dx, dy)
        height = oz + slope * near
        # Over a roof or under a bumper is a way past too: no jump, or it would count as knowledge.
        inside = min(inside, part[TOP] - height, height - part[BOTTOM])
        if near <= 0.0 or near > reach or inside <= 0.0:
            continue
        depth = min(inside / edge_m, SURPRISE)
        if kind == EMPTY and need > 0.0:
            # No return is no surprise where a surface would hardly be seen.
            dark = 1.0 - seen(need, near, cosine)
            depth = min(depth, math.sqrt(-2.0 * math.log(max(dark, 1e-30))))
        worst = max(worst, depth)
    return worst


@compiled(borrowing=True)
def _off(
    part: np.ndarray,
    point: tuple[float, float],
    dx: float,
    dy: float,
    noise: tuple[float, float],
) -> float:
    """How far a return is outside a footprint, over its standard deviation across the side.

    Of the sides that face the ray the farthest counts, of the others only one that the return
    is beyond: it lies beside the silhouette. Negative inside.
    """
    x, y = point
    r = part[RADIUS]
    ahead = x + x > part[FRONT] + part[REAR]
    cx, cy = (part[FRONT] - r, part[NOSE] - r) if ahead else (part[REAR] + r, part[TAIL] - r)
    fx, fy = 1.0 if ahead else -1.0, math.copysign(1.0, y)
    facets = FACET_REACH * r
    # farthest facing side, its cosine, farthest beyond another side, its cosine
    state = -np.inf, 1.0, 0.0, 0.0
    state = _farther(state, x - part[FRONT], dx)
    state = _farther(state, part[REAR] - x, -dx)
    state = _farther(state, y - part[HALF], dy)
    state = _farther(state, -y - part[HALF], -dy)
    # Flanks that do not narrow are the sides.
    nx, ny, reach = part[FORE_X], part[FORE_Y], part[FORE_REACH]
    if nx != 0.0:
        state = _farther(state, nx * x + ny * y - reach, nx * dx + ny * dy)
        state = _farther(state, nx * x - ny * y - reach, nx * dx - ny * dy)
    nx, ny, reach = part[AFT_X], part[AFT_Y], part[AFT_REACH]
    if nx != 0.0:
        state = _farther(state, nx * x + ny * y - reach, nx * dx + ny * dy)
        state = _farther(state, nx * x - ny * y - reach, nx * dx - ny * dy)
    u, v = fx * (x - cx), abs(y) - cy
    if r > 0.0:
        for i in range(3):
            over = FACET_X[i] * u + FACET_X[2 - i] * v - facets
            state = _farther(state, over, FACET_X[i] * fx * dx + FACET_X[2 - i] * fy * dy)
    facing, cosine, beside, aside = state
    if beside > 0.0 and beside > facing:
        facing, cosine = beside, aside
    sigma, edge = noise
    return facing / math.sqrt((sigma * cosine) ** 2 + edge * edge * (1.0 - cosine * cosine))


@compiled(borrowing=True)
def _farther(
    state: tuple[float, float, float, float], over: float, speed: float
) -> tuple[float, float, float, float]:
    """Keep the farthest of the sides that face the ray, and of those that do not."""
    facing, cosine, beside, aside = state
    if speed < 0.0:
        return (over, -speed, beside, aside) if over > facing else state
    return (facing, cosine, over, speed) if over > beside else state
