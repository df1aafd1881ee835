"""Rectangles around clusters: of least area, and the best L-shape.

The L-shape is that of Zhang, Xu, Dong and Dolan 2017, "Efficient L-Shape Fitting for Vehicle
Detection Using Laser Scanners", Intelligent Vehicles Symposium 2017.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Literal

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.sorting import stable_order
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import bodies_in, completions
from roadscope.detectors.shape.recognition import Vehicle

AREA, CLOSENESS, VARIANCE = 0, 1, 2
Criterion = Literal["area", "closeness", "variance"]
CRITERIA: dict[Criterion, int] = {"area": AREA, "closeness": CLOSENESS, "variance": VARIANCE}
COARSE, FINE = 60, 6
"""Number of headings that are tried over a right angle, and then to either side of the best one."""
EQUAL = 1e-9
"""Relative difference below which values are equal: they differ by the rounding of sums only."""
NEAR_M = 0.05
"""Points nearer to a side than this count as on it; the paper has 0.01 m, less than any noise."""
MOST_INDEPENDENT, LEAST_M = 30, 0.03
"""An outline counts as at most so many independent measurements, whose standard deviation is at
least the second. Chosen by hand."""
MOST_POINTS = 96
"""Most outline points that are used; more of them do not improve the heading."""


def vehicles_by_rectangle(cluster: Cluster, horizon: Horizon) -> list[Vehicle]:
    """Return the road user whose heading is that of a cluster's minimum-area rectangle."""
    return bodies_in(cluster, horizon, _by_rectangle)


def _by_rectangle(cluster: Cluster, horizon: Horizon) -> Vehicle | None:
    (vehicle,) = completions(cluster, [hull_heading(cluster.points)], horizon)
    return vehicle


def vehicles_by_l_shape(
    cluster: Cluster, horizon: Horizon, *, criterion: Criterion = "closeness"
) -> list[Vehicle]:
    """Return the road user whose two faces fit the outline of a cluster best.

    criterion: decides the rectangle's heading: least `area`, greatest `closeness` of the points to
        the sides, or least `variance` of their distances from the nearer side.
    """
    return bodies_in(cluster, horizon, partial(_by_l_shape, criterion=CRITERIA[criterion]))


def _by_l_shape(cluster: Cluster, horizon: Horizon, *, criterion: int) -> Vehicle | None:
    outline = _thinned(cluster.outline)
    yaws = [searched_heading(outline, criterion, NEAR_M)]
    if len(outline) > 1:
        yaws.append(line_heading(outline))
    candidates = (v for v in completions(cluster, yaws, horizon) if v is not None)
    return min(candidates, key=_misfit, default=None)


def _thinned(outline: np.ndarray) -> np.ndarray:
    """Return about `MOST_POINTS` points of an outline, the same ones if it is reversed."""
    count = len(outline)
    if count <= MOST_POINTS:
        return outline
    rows = np.arange(0, (count + 1) // 2, -(-count // MOST_POINTS))
    thinned: np.ndarray = outline[np.unique(np.concatenate([rows, count - 1 - rows]))]
    return thinned


def _misfit(vehicle: Vehicle) -> float:
    """Return the negative log likelihood of the body and of its outline, whose noise is unknown.

    It decides between two headings, because the search may rotate a single noisy face until two
    sides fit it. The other heading is that of the line through the outline.
    """
    count = min(vehicle.points, MOST_INDEPENDENT)
    return count * math.log(max(vehicle.residual_m, LEAST_M)) - vehicle.fit


# --------------------------------------------------------------------------------------------------
# Headings of rectangles: compiled.


@compiled()
def searched_heading(points: np.ndarray, criterion: int, near_m: float) -> float:
    """Return the heading in [0, pi/2), radians, whose rectangle fits (M, 2) points best.

    points, near_m: metres; points nearer to a side than near_m count as on it. criterion: `AREA`,
    `CLOSENESS` or `VARIANCE`. The paper (algorithm 2) tries every degree. Here the best of steps of
    1.5 degrees is refined to a quarter degree. Of several neighbouring headings that are equally
    good the middle one is taken, so that a mirrored outline has the mirrored heading.
    """
    step = 0.5 * np.pi / COARSE
    values = _criterion_values(points, step * np.arange(COARSE), criterion, near_m)
    centre, fine = step * _middle_of_best(values, True), step / FINE
    headings = centre + (np.arange(2 * FINE + 1) - FINE) * fine
    values = _criterion_values(points, headings, criterion, near_m)
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
def _criterion_values(
    points: np.ndarray, headings: np.ndarray, criterion: int, near_m: float
) -> np.ndarray:
    """Return the value of a criterion for each heading; greater is better (algorithms 3 to 5).

    In all loops the headings come last: what is summed for one does not wait for another.
    """
    values, cos, sin = np.zeros(len(headings)), np.cos(headings), np.sin(headings)
    if criterion == AREA:
        for h in range(len(headings)):
            values[h] = -_area(points, cos[h], sin[h])
        return values
    first, second = _distances(points, cos, sin), _distances(points, -sin, cos)
    if criterion == CLOSENESS:
        for i in range(len(points)):
            for h in range(len(headings)):
                values[h] += 1.0 / max(min(first[i, h], second[i, h]), near_m)
        return values
    for h in range(len(headings)):
        for side in range(2):
            own, others = (first, second) if side == 0 else (second, first)
            count, linear, squares = 0, 0.0, 0.0
            for i in range(len(points)):
                if own[i, h] < others[i, h]:
                    count += 1
                    linear += own[i, h]
                    squares += own[i, h] * own[i, h]
            values[h] -= squares / count - (linear / count) ** 2 if count else 0.0
    return values


@compiled()
def _distances(points: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return (M, H) distances of (M, 2) points along H axes (x, y) from the end nearer to most."""
    out, size = np.empty((len(points), len(x))), len(x)
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    for i in range(len(points)):
        for h in range(size):
            out[i, h] = points[i, 0] * x[h] + points[i, 1] * y[h]
        for h in range(size):
            low[h] = min(low[h], out[i, h])
        for h in range(size):
            high[h] = max(high[h], out[i, h])
    surplus, deficit = np.zeros(size), np.zeros(size)
    for i in range(len(points)):
        for h in range(size):
            surplus[h] += (out[i, h] - low[h]) ** 2
        for h in range(size):
            deficit[h] += (high[h] - out[i, h]) ** 2
    for i in range(len(points)):
        for h in range(size):
            from_low, from_high = out[i, h] - low[h], high[h] - out[i, h]
            out[i, h] = from_low if surplus[h] <= deficit[h] else from_high
    return out


@compiled()
def _area(points: np.ndarray, x: float, y: float) -> float:
    """Return the area of the rectangle around points (N, 2) with a side along (x, y)."""
    rear, front, right, left = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points)):
        u, v = points[i, 0] * x + points[i, 1] * y, points[i, 0] * -y + points[i, 1] * x
        rear, front, right, left = min(rear, u), max(front, u), min(right, v), max(left, v)
    return (front - rear) * (left - right)


@compiled()
def line_heading(points: np.ndarray) -> float:
    """Return the heading in [0, pi/2), radians, along or across the line through (M, 2) points.

    The line has the least sum of squared distances from the points.
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
    """Return the heading in [0, pi/2) of the smallest rectangle around (N, 2 or 3) points, N > 0.

    One side of that rectangle lies on a side of the convex hull (Freeman and Shapira 1975).
    """
    order = stable_order(points[:, 1])
    order = order[stable_order(points[order, 0])]
    hull = _hull(points[order, :2])
    best, least = 0.0, np.inf
    for i in range(len(hull)):
        j = (i + 1) % len(hull)
        x, y = hull[j, 0] - hull[i, 0], hull[j, 1] - hull[i, 1]
        length = np.hypot(x, y)
        if length == 0.0:
            continue
        area = _area(hull, x / length, y / length)
        if area < least:
            best, least = np.arctan2(y, x), area
    return best % (0.5 * np.pi)


@compiled()
def _hull(points: np.ndarray) -> np.ndarray:
    """Return the convex hull, counter-clockwise, of points sorted by x, then y (Andrew 1979)."""
    count = len(points)
    chain = np.empty((2 * count + 1, 2))
    size = 0
    for half in range(2):
        start = size
        for i in range(count):
            p = points[i] if half == 0 else points[count - 1 - i]
            while size >= start + 2:
                a, b = chain[size - 2], chain[size - 1]
                if (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0.0:
                    break
                size -= 1
            chain[size] = p
            size += 1
        size -= 1
    return chain[: max(size, 1)]
