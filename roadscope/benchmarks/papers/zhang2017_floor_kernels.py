"""The exact chance of what a sweep measured, given where the body stands: compiled inner loops."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

IMPOSSIBLE = -60.0
"""Log-likelihood of a return where nothing can have sent it: finite, so that of many bad poses
the less bad can be told."""
SURELY = 11.0
"""Standard deviations short of the greatest range at which none is lost for being beyond it."""


class Rays(NamedTuple):
    """C columns of B beams that may meet the body, in the body's true frame at their own time.

    origins, directions: (C, 2) metres and unit vectors. height_m: of the sensor above the ground.
    slopes, cosines: (B,) tangent and cosine of the beams' elevations.
    observed: (C, B) measured range in metres, 0 for none.
    """

    origins: np.ndarray
    directions: np.ndarray
    height_m: float
    slopes: np.ndarray
    cosines: np.ndarray
    observed: np.ndarray


class Bodies(NamedTuple):
    """G bodies of M prisms that differ in their corners.

    planes: (G, M, 12, 3) with n.p <= c, corners: (G, M) how many of them count.
    spans: (M, 2) bottom and top, reflectivities: (M,).
    boxes: (M, 4) middle x and y of all G footprints, half their extents.
    """

    planes: np.ndarray
    corners: np.ndarray
    spans: np.ndarray
    reflectivities: np.ndarray
    boxes: np.ndarray


class Road(NamedTuple):
    """What rays meet were the body not there.

    reaches, echoes: (B,) horizontal way to the ground and what it reflects, inf and 0 for none.
    logs: (C, B) log-chances of what was measured; sums: (C,) of them.
    """

    reaches: np.ndarray
    echoes: np.ndarray
    logs: np.ndarray
    sums: np.ndarray


class Receiver(NamedTuple):
    """Range noise, least and greatest range in metres, dropout, detection limit, road's albedo."""

    sigma_m: float
    near_m: float
    far_m: float
    dropout: float
    limit: float
    ground: float


@compiled()
def add_log_likelihoods(
    states: tuple[np.ndarray, np.ndarray],
    rays: Rays,
    bodies: Bodies,
    receiver: Receiver,
    out: np.ndarray,
) -> None:
    """Add to out (N,) the log-likelihood of the body being off its true pose.

    states: offsets (N, 3) x, y (metres) and yaw (radians), in the body's true frame, and which
    (N,) of the bodies it is. The density of a range is taken relative to its greatest,
    1 / (sigma sqrt(2 pi)), which all poses share.
    """
    offsets, which = states
    chances = (math.log1p(-receiver.dropout), _log(receiver.dropout))
    road = _road(rays, receiver, chances)
    found = np.empty((4, len(bodies.spans)))
    for n in range(len(offsets)):
        cos, sin = math.cos(offsets[n, 2]), math.sin(offsets[n, 2])
        total = 0.0
        for c in range(len(rays.origins)):
            x, y = rays.origins[c, 0] - offsets[n, 0], rays.origins[c, 1] - offsets[n, 1]
            u, v = rays.directions[c, 0], rays.directions[c, 1]
            line = (cos * x + sin * y, cos * y - sin * x, cos * u + sin * v, cos * v - sin * u)
            total += road.sums[c]
            near, met = _cross(line, bodies, which[n], found)
            if met == 0:
                continue
            for b in range(len(rays.slopes)):
                if near < road.reaches[b]:
                    behind = (road.reaches[b], road.echoes[b])
                    reach, signal = _meet(rays, b, bodies, found[:, :met], behind)
                    if reach < road.reaches[b]:
                        true = reach / rays.cosines[b]
                        chance = _log_chance(rays.observed[c, b], true, signal, receiver, chances)
                        total += chance - road.logs[c, b]
        out[n] += total


@compiled()
def _road(rays: Rays, receiver: Receiver, chances: tuple[float, float]) -> Road:
    road = Road(
        np.full(len(rays.slopes), np.inf), np.zeros(len(rays.slopes)),
        np.empty(rays.observed.shape), np.zeros(len(rays.observed)),
    )  # fmt: skip
    for b in range(len(rays.slopes)):
        slope, cosine = rays.slopes[b], rays.cosines[b]
        if slope < 0.0:
            road.reaches[b] = -rays.height_m / slope
            road.echoes[b] = -receiver.ground * slope * cosine
        true = road.reaches[b] / cosine
        for c in range(len(rays.observed)):
            observed = rays.observed[c, b]
            road.logs[c, b] = _log_chance(observed, true, road.echoes[b], receiver, chances)
            road.sums[c] += road.logs[c, b]
    return road


@compiled(borrowing=True)
def _cross(
    line: tuple[float, float, float, float], bodies: Bodies, g: int, found: np.ndarray
) -> tuple[float, int]:
    """Find which footprints a line crosses; return the nearest entry and how many they are.

    found: (4, M), filled with entries, exits, cosines at the entry, and rows of the prisms.
    """
    x, y, u, v = line
    near, met = np.inf, 0
    for m in range(len(bodies.spans)):
        box = bodies.boxes[m]
        if abs((box[0] - x) * v - (box[1] - y) * u) > abs(v) * box[2] + abs(u) * box[3]:
            continue
        enter, leave, face = _clip(line, bodies, g, m)
        if enter < np.inf:
            found[0, met], found[1, met], found[2, met], found[3, met] = enter, leave, face, m
            near, met = min(near, enter), met + 1
    return near, met


@compiled(borrowing=True)
def _clip(
    line: tuple[float, float, float, float], bodies: Bodies, g: int, m: int
) -> tuple[float, float, float]:
    """Where a line (x, y, dx, dy) enters and leaves a footprint, and the cosine at the entry.

    An entry of inf: it passes by, or begins inside.
    """
    x, y, u, v = line
    enter, leave, face = -np.inf, np.inf, 0.0
    for k in range(bodies.corners[g, m]):
        a, b = bodies.planes[g, m, k, 0], bodies.planes[g, m, k, 1]
        room, speed = bodies.planes[g, m, k, 2] - a * x - b * y, a * u + b * v
        if speed < 0.0:
            if room < enter * speed:
                enter, face = room / speed, -speed
        elif speed > 0.0:
            if room < leave * speed:
                leave = room / speed
        elif room < 0.0:
            return np.inf, np.inf, 0.0
        if enter >= leave:
            return np.inf, np.inf, 0.0
    if enter > 0.0:
        return enter, leave, face
    return np.inf, np.inf, 0.0


@compiled(borrowing=True)
def _meet(
    rays: Rays,
    b: int,
    bodies: Bodies,
    found: np.ndarray,
    behind: tuple[float, float],
) -> tuple[float, float]:
    """Horizontal way to the nearest surface of the body, or to what is behind, and its signal."""
    reach, signal = behind
    slope, cosine = rays.slopes[b], rays.cosines[b]
    for i in range(found.shape[1]):
        way, m = found[0, i], int(found[3, i])
        if way >= reach:
            continue
        incidence = found[2, i] * cosine
        height = rays.height_m + slope * way
        bottom, top = bodies.spans[m, 0], bodies.spans[m, 1]
        if height > top or height < bottom:
            # The sides are passed above or below: through the lid or the floor, if at all.
            edge = top if height > top else bottom
            way = (edge - rays.height_m) / slope if slope != 0.0 else np.inf
            incidence = abs(slope) * cosine
            if not found[0, i] <= way < found[1, i]:
                continue
        if way < reach:
            reach, signal = way, incidence * bodies.reflectivities[m]
    return reach, signal


@compiled(borrowing=True)
def _log_chance(
    observed: float,
    true: float,
    signal: float,
    receiver: Receiver,
    chances: tuple[float, float],
) -> float:
    """chances: logarithms of a return's being kept and of its being lost."""
    seen = true < receiver.far_m and signal * receiver.far_m**2 >= receiver.limit * true**2
    if observed > 0.0:
        if not seen:
            return IMPOSSIBLE
        off = (observed - true) / receiver.sigma_m
        return max(chances[0] - 0.5 * off * off, IMPOSSIBLE)
    if not seen:
        return 0.0
    short = (receiver.far_m - true) / receiver.sigma_m
    if short > SURELY:
        return chances[1]
    beyond = 0.5 * math.erfc(short / math.sqrt(2.0))
    return _log(receiver.dropout + (1.0 - receiver.dropout) * beyond)


@compiled(borrowing=True)
def _log(chance: float) -> float:
    return max(math.log(chance), IMPOSSIBLE) if chance > 0.0 else IMPOSSIBLE
