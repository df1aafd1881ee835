"""The exact chance of what a sweep measured, given where the body stands: compiled inner loops."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

IMPOSSIBLE = -60.0
"""Log-likelihood of a return where nothing can have sent it: finite, so that of many bad poses
the less bad can be told."""


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


class Body(NamedTuple):
    """M prisms: planes (M, 12, 3) with n.p <= c, corners (M,), spans (M, 2) bottom and top.

    circles: (M, 3) x, y, radius around the footprints. reflectivities: (M,).
    """

    planes: np.ndarray
    corners: np.ndarray
    circles: np.ndarray
    spans: np.ndarray
    reflectivities: np.ndarray


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
    offsets: np.ndarray, rays: Rays, body: Body, receiver: Receiver, out: np.ndarray
) -> None:
    """Add to out (N,) the log-likelihood of the body being off its true pose.

    offsets: (N, 3) x, y (metres) and yaw (radians), in the body's true frame. The density of a
    range is taken relative to its greatest, 1 / (sigma sqrt(2 pi)), which all poses share.
    """
    count = len(body.corners)
    found = np.empty((4, count))
    for n in range(len(offsets)):
        cos, sin = math.cos(offsets[n, 2]), math.sin(offsets[n, 2])
        total = 0.0
        for c in range(len(rays.origins)):
            x, y = rays.origins[c, 0] - offsets[n, 0], rays.origins[c, 1] - offsets[n, 1]
            u, v = rays.directions[c, 0], rays.directions[c, 1]
            line = (cos * x + sin * y, cos * y - sin * x, cos * u + sin * v, cos * v - sin * u)
            near, met = np.inf, 0
            for m in range(count):
                enter, leave, face = _clip(line, body, m)
                if enter < np.inf:
                    found[0, met], found[1, met], found[2, met] = enter, leave, face
                    found[3, met] = m
                    near, met = min(near, enter), met + 1
            for b in range(len(rays.slopes)):
                reach, signal = _ground(rays, b, receiver)
                if near < reach:
                    reach, signal = _meet(rays, b, body, found[:, :met], (reach, signal))
                total += _log_chance(
                    rays.observed[c, b], reach / rays.cosines[b], signal, receiver
                )  # fmt: skip
        out[n] += total


@compiled(borrowing=True)
def _clip(
    line: tuple[float, float, float, float], body: Body, m: int
) -> tuple[float, float, float]:
    """Where a line (x, y, dx, dy) enters and leaves a footprint, and the cosine at the entry.

    An entry of inf: it passes by, or begins inside.
    """
    x, y, u, v = line
    aside = (body.circles[m, 0] - x) * v - (body.circles[m, 1] - y) * u
    if abs(aside) >= body.circles[m, 2]:
        return np.inf, np.inf, 0.0
    enter, leave, face = -np.inf, np.inf, 0.0
    for k in range(body.corners[m]):
        a, b = body.planes[m, k, 0], body.planes[m, k, 1]
        room, speed = body.planes[m, k, 2] - a * x - b * y, a * u + b * v
        if speed < 0.0:
            if room < enter * speed:
                enter, face = room / speed, -speed
        elif speed > 0.0:
            if room < leave * speed:
                leave = room / speed
        elif room < 0.0:
            return np.inf, np.inf, 0.0
    if enter < leave and enter > 0.0:
        return enter, leave, face
    return np.inf, np.inf, 0.0


@compiled(borrowing=True)
def _ground(rays: Rays, b: int, receiver: Receiver) -> tuple[float, float]:
    """Horizontal way to the ground and what it reflects, inf and 0 for none."""
    if rays.slopes[b] >= 0.0:
        return np.inf, 0.0
    return -rays.height_m / rays.slopes[b], -receiver.ground * rays.slopes[b] * rays.cosines[b]


@compiled(borrowing=True)
def _meet(
    rays: Rays,
    b: int,
    body: Body,
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
        bottom, top = body.spans[m, 0], body.spans[m, 1]
        if height > top or height < bottom:
            # The sides are passed above or below: through the lid or the floor, if at all.
            edge = top if height > top else bottom
            way = (edge - rays.height_m) / slope if slope != 0.0 else np.inf
            incidence = abs(slope) * cosine
            if not found[0, i] <= way < found[1, i]:
                continue
        if way < reach:
            reach, signal = way, incidence * body.reflectivities[m]
    return reach, signal


@compiled(borrowing=True)
def _log_chance(observed: float, true: float, signal: float, receiver: Receiver) -> float:
    seen = true < receiver.far_m and signal * receiver.far_m**2 >= receiver.limit * true**2
    if observed > 0.0:
        if not seen:
            return IMPOSSIBLE
        off = (observed - true) / receiver.sigma_m
        return max(math.log1p(-receiver.dropout) - 0.5 * off * off, IMPOSSIBLE)
    if not seen:
        return 0.0
    beyond = 0.5 * math.erfc((receiver.far_m - true) / (receiver.sigma_m * math.sqrt(2.0)))
    lost = receiver.dropout + (1.0 - receiver.dropout) * beyond
    return max(math.log(lost), IMPOSSIBLE) if lost > 0.0 else IMPOSSIBLE
