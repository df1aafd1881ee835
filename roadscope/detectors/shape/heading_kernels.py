"""Which way a rectangle around an outline is turned, for kernels."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

AREA, CLOSENESS, VARIANCE = 0, 1, 2
COARSE, FINE = 60, 6
"""Headings tried over a right angle, and to either side of the best of them."""
EQUAL = 1e-9
"""Values that differ by this share differ by the order of a sum only."""


@compiled()
def searched_heading(points: np.ndarray, criterion: int, near_m: float) -> float:
    """Return the heading in [0, pi/2), radians, whose rectangle suits (M, 2) points best.

    criterion: `AREA`, `CLOSENESS` or `VARIANCE`. near_m: points nearer to a side count as on it,
    metres like the points.
    Zhang et al. 2017 (Efficient L-shape fitting, algorithm 2) try every degree; here the best of
    steps of 1.5 degrees is refined to a quarter degree. Of headings equally good in a row the
    middle is taken, so that a mirrored outline has the mirrored heading.
    """
    room = np.empty(len(points)), np.empty(len(points))
    step, values = 0.5 * np.pi / COARSE, np.empty(COARSE)
    for i in range(COARSE):
        values[i] = _suits(points, i * step, criterion, near_m, room)
    centre = step * _middle_of_best(values, True)
    fine, values = step / FINE, np.empty(2 * FINE + 1)
    for i in range(len(values)):
        heading = centre + (i - FINE) * fine
        values[i] = _suits(points, heading, criterion, near_m, room)
    return (centre + fine * (_middle_of_best(values, False) - FINE)) % (0.5 * np.pi)


@compiled()
def _middle_of_best(values: np.ndarray, around: bool) -> float:
    """Return the middle of the longest run of greatest values; 0 where all are equal.

    around: whether the first value follows on the last.
    """
    least = values.max() - EQUAL * abs(values.max())
    count = len(values)
    middle, longest, run = 0.0, 0, 0
    if values.min() >= least:
        return 0.0 if around else 0.5 * (count - 1)
    for i in range(2 * count if around else count):
        run = run + 1 if values[i % count] >= least else 0
        if run > longest:
            middle, longest = i - 0.5 * (run - 1), run
    return middle


@compiled()
def _suits(
    points: np.ndarray,
    heading: float,
    criterion: int,
    near_m: float,
    room: tuple[np.ndarray, np.ndarray],
) -> float:
    """Value of a criterion for one heading; greater is better (algorithms 3 to 5)."""
    first, second = room
    low_1, high_1 = _project(points, np.cos(heading), np.sin(heading), first)
    low_2, high_2 = _project(points, -np.sin(heading), np.cos(heading), second)
    if criterion == AREA:
        return -(high_1 - low_1) * (high_2 - low_2)
    _to_nearer_side(first, low_1, high_1)
    _to_nearer_side(second, low_2, high_2)
    if criterion == CLOSENESS:
        total = 0.0
        for i in range(len(points)):
            total += 1.0 / max(min(first[i], second[i]), near_m)
        return total
    return -_variance(first, second) - _variance(second, first)


@compiled()
def _project(points: np.ndarray, x: float, y: float, out: np.ndarray) -> tuple[float, float]:
    low, high = np.inf, -np.inf
    for i in range(len(points)):
        out[i] = points[i, 0] * x + points[i, 1] * y
        low, high = min(low, out[i]), max(high, out[i])
    return low, high


@compiled()
def _to_nearer_side(values: np.ndarray, low: float, high: float) -> None:
    """Turn coordinates into distances from that side which is nearer on the whole."""
    from_low, from_high = 0.0, 0.0
    for value in values:
        from_low += (value - low) ** 2
        from_high += (high - value) ** 2
    for i in range(len(values)):
        values[i] = values[i] - low if from_low <= from_high else high - values[i]


@compiled()
def _variance(values: np.ndarray, others: np.ndarray) -> float:
    """Variance of those values that are less than the others."""
    count, total, squares = 0, 0.0, 0.0
    for i in range(len(values)):
        if values[i] < others[i]:
            count += 1
            total += values[i]
            squares += values[i] * values[i]
    return squares / count - (total / count) ** 2 if count else 0.0


@compiled()
def line_heading(points: np.ndarray) -> float:
    """Return the heading in [0, pi/2) along or across the line of (M, 2) points.

    The line of least squares of the distances from it.
    """
    x, y = points[:, 0].mean(), points[:, 1].mean()
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(len(points)):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    heading: float = (0.5 * np.arctan2(2.0 * xy, xx - yy)) % (0.5 * np.pi)
    return heading


@compiled()
def hull_heading(points: np.ndarray) -> float:
    """Return the heading in [0, pi/2) of the least rectangle around (M, 2) points.

    points: distinct, sorted by x, then y. One side of that rectangle lies on a side of the
    convex hull (Freeman and Shapira 1975).
    """
    hull = _hull(points)
    best, least = 0.0, np.inf
    for i in range(len(hull)):
        j = (i + 1) % len(hull)
        x, y = hull[j, 0] - hull[i, 0], hull[j, 1] - hull[i, 1]
        length = np.hypot(x, y)
        if length == 0.0:
            continue
        area = _extent(hull, x / length, y / length) * _extent(hull, -y / length, x / length)
        if area < least:
            best, least = np.arctan2(y, x), area
    return best % (0.5 * np.pi)


@compiled()
def _extent(points: np.ndarray, x: float, y: float) -> float:
    low, high = np.inf, -np.inf
    for i in range(len(points)):
        u = points[i, 0] * x + points[i, 1] * y
        low, high = min(low, u), max(high, u)
    return high - low


@compiled()
def _hull(points: np.ndarray) -> np.ndarray:
    """Convex hull, counter-clockwise, of sorted points (monotone chain, Andrew 1979)."""
    count = len(points)
    chain = np.empty((2 * count + 1, 2))
    size = 0
    for half in range(2):
        start = size
        for i in range(count):
            p = points[i] if half == 0 else points[count - 1 - i]
            while size >= start + 2 and _left(chain[size - 2], chain[size - 1], p) <= 0.0:
                size -= 1
            chain[size] = p
            size += 1
        size -= 1
    return chain[: max(size, 1)]


@compiled()
def _left(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the signed area of a triangle, positive where c lies left of a to b."""
    area: float = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return area
