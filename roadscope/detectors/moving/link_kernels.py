"""Where a vehicle is seen from the drive's frame, and how it goes: compiled inner loops."""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled

TURNS = np.radians(np.arange(-24.0, 25.0, 4.0))
"""By which a body may stand askew to the way that it goes."""


@compiled()
def brought(
    points: np.ndarray, origin: np.ndarray, matrix: np.ndarray, face_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (N, 3), sensor (2,) and mark (2,) in the frame that (4, 4) leads to.

    points (N, 3), N at least 1, origin (2,): metres. The mark is the mean of what lies no deeper
    than `face_m` behind the point nearest along the line of sight.
    """
    out, count = np.empty((len(points), 3)), len(points)
    mx, my = 0.0, 0.0
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            out[i, k] = x * matrix[k, 0] + y * matrix[k, 1] + z * matrix[k, 2] + matrix[k, 3]
        mx, my = mx + out[i, 0], my + out[i, 1]
    place = np.empty(2)
    for k in range(2):
        place[k] = origin[0] * matrix[k, 0] + origin[1] * matrix[k, 1] + matrix[k, 3]
    sx, sy = mx / count - place[0], my / count - place[1]
    away = max(np.hypot(sx, sy), 1e-9)
    depths, nearest = np.empty(count), np.inf
    for i in range(count):
        depths[i] = ((out[i, 0] - place[0]) * sx + (out[i, 1] - place[1]) * sy) / away
        nearest = min(nearest, depths[i])
    mark, held = np.zeros(2), 0
    for i in range(count):
        if depths[i] <= nearest + face_m:
            mark[0], mark[1], held = mark[0] + out[i, 0], mark[1] + out[i, 1], held + 1
    return out, place, mark / held


@compiled()
def rate(times: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Return the (2,) slope of marks (K, 2) over times (K,) by least squares, 0 of one."""
    middle, spread, slope = times.mean(), 0.0, np.zeros(2)
    for k in range(len(times)):
        off = times[k] - middle
        spread += off * off
        slope += off * marks[k]
    return slope / spread if spread > 0.0 else np.zeros(2)


@compiled()
def unsteady(times: np.ndarray, marks: np.ndarray, velocity: np.ndarray) -> float:
    """Root mean square distance of marks (K, 2) from even motion with a (2,) velocity."""
    middle, x, y = times.mean(), marks[:, 0].mean(), marks[:, 1].mean()
    total = 0.0
    for k in range(len(times)):
        dx = marks[k, 0] - x - (times[k] - middle) * velocity[0]
        dy = marks[k, 1] - y - (times[k] - middle) * velocity[1]
        total += dx * dx + dy * dy
    return float(np.sqrt(total / len(times)))


@compiled()
def roomy(
    points: np.ndarray,
    times_s: np.ndarray,
    starts: np.ndarray,
    chains: np.ndarray,
    velocities: np.ndarray,
    rules: tuple[np.ndarray, int, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return which body has room for what is seen of each chain, (C,), and its length, (C,) metres.

    points: (N, 3) metres, and times_s (N,), seconds, of all sightings; starts: (S + 1,) where each
    of these begins, chains: (C + 1,) where the sightings of each chain begin; velocities: (C, 2)
    m/s. rules: length, width and height (B, 3) that there is room for; how many of the first count
    only for what is higher than the last number, metres. The last has room for all.
    """
    bounds, riders, rider_m = rules
    count = len(chains) - 1
    kinds, along = np.empty(count, np.int64), np.empty(count)
    for c in range(count):
        first, last = chains[c], chains[c + 1]
        seen = np.empty((last - first, 3))
        for k in range(first, last):
            part = slice(starts[k], starts[k + 1])
            seen[k - first] = spans(points[part], times_s[part], velocities[c])
        along[c], across = np.median(seen[:, 0]), np.median(seen[:, 1])
        top = seen[:, 2].max()
        body = 0 if top > rider_m else riders
        while body < len(bounds) - 1 and (
            along[c] > bounds[body, 0] or across > bounds[body, 1] or top > bounds[body, 2]
        ):
            body += 1
        kinds[c] = body
    return kinds, along


@compiled()
def spans(
    points: np.ndarray, times_s: np.ndarray, velocity: np.ndarray
) -> tuple[float, float, float]:
    """Return how far (N, 3) points reach along and across a body that goes that way, and up.

    Each point is carried back by its time (N,), seconds, with a (2,) velocity.
    """
    towards = math.atan2(velocity[1], velocity[0])
    least, along, across = np.inf, 0.0, 0.0
    places = np.empty((2, len(points)))
    for i in range(len(points)):
        places[0, i] = points[i, 0] - times_s[i] * velocity[0]
        places[1, i] = points[i, 1] - times_s[i] * velocity[1]
    for turn in TURNS:
        long, wide = _extents(places[0], places[1], np.cos(towards + turn), np.sin(towards + turn))
        if long * wide < least:
            along, across, least = long, wide, long * wide
    return along, across, points[:, 2].max()


# Places are finite, and the sign of a nought does not matter: several at a time.
@compiled(borrowing=True, fastmath={"nnan", "nsz"})
def _extents(x: np.ndarray, y: np.ndarray, cos: float, sin: float) -> tuple[float, float]:
    """Return how far places reach along a unit vector and across it."""
    low, high, right, left = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(x)):
        u, v = cos * x[i] + sin * y[i], cos * y[i] - sin * x[i]
        low, high = u if u < low else low, u if u > high else high
        right, left = v if v < right else right, v if v > left else left
    return high - low, left - right
