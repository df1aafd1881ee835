"""From evidence of motion to boxes that hold vehicles, and to the returns of each: compiled."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.moving.box_kernels import Chart, slide, suppress
from roadscope.detectors.moving.view_kernels import sensor_at

MOST_MOVES = 8
"""Of a row, on average: equals that need more, as of a straight wall, are sorted by each axis."""


@compiled()
def boxes_in(
    points: np.ndarray,
    weights: np.ndarray,
    origin: np.ndarray,
    sides: np.ndarray,
    rules: tuple[float, float, float],
) -> np.ndarray:
    """Return (B, 8) boxes that hold moving vehicles, as `slide` does, best first.

    points: (N, 2 or more) metres, N at least 1; weights: (N,) evidence of motion of each. origin:
    (2,) metres, the sensor. sides: as in `slide`. rules: side of a cell, metres, most that a cell
    weighs, and least evidence of a box.
    """
    cell_m, limit, least = rules
    chart, corner = charted(points, weights, origin, (cell_m, limit))
    boxes = slide(chart, sides, least)
    # They come by x, then by y.
    boxes = boxes[np.argsort(-boxes[:, 3], kind="mergesort")]
    kept: np.ndarray = boxes[suppress(boxes, chart, sides, least)]
    kept[:, :2] += corner
    return kept


@compiled()
def charted(
    points: np.ndarray, weights: np.ndarray, origin: np.ndarray, rules: tuple[float, float]
) -> tuple[Chart, np.ndarray]:
    """Return the chart of evidence and its corner, (2,) metres.

    A cell weighs the same however many returns it holds. Arguments as in `boxes_in`.
    """
    cell_m, limit = rules
    corner, order = np.empty(2), _order_by(points, (0, 1))
    for axis in range(2):
        corner[axis] = cell_m * np.floor(points[:, axis].min() / cell_m)
    deep = int((points[:, 1].max() - corner[1]) / cell_m) + 1
    wide = int((points[:, 0].max() - corner[0]) / cell_m) + 1
    cell = np.empty(len(points), np.int64)
    for k in range(len(points)):
        x, y = points[order[k], 0] - corner[0], points[order[k], 1] - corner[1]
        cell[k] = int(x / cell_m) * deep + int(y / cell_m)
    sums, starts, count, last = np.zeros((len(points), 4)), np.zeros(wide + 1, np.int64), -1, -1
    for k in np.argsort(cell, kind="mergesort"):
        if cell[k] != last:
            last, count = cell[k], count + 1
            starts[last // deep + 1] = count + 1
        i = order[k]
        sums[count, 0] += points[i, 0]
        sums[count, 1] += points[i, 1]
        sums[count, 2] += weights[i]
        sums[count, 3] += 1.0
    for column in range(wide):
        starts[column + 1] = max(starts[column + 1], starts[column])
    held = sums[: count + 1]
    places = held[:, :2] / held[:, 3:] - corner
    values = np.minimum(np.maximum(held[:, 2] / held[:, 3], -limit), limit)
    return Chart(starts, places, values, origin - corner, cell_m), corner


@compiled()
def _order_by(points: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Return the order of (N, D) points by their first axis named, then by the next of those."""
    order, moves = np.argsort(points[:, axes[0]], kind="mergesort"), 0
    for k in range(1, len(order)):
        row, place = order[k], k
        while place > 0 and _behind(points, order[place - 1], row, axes):
            order[place] = order[place - 1]
            place -= 1
        order[place] = row
        moves += k - place
        if moves > MOST_MOVES * len(order):
            return _order_by_sorts(points, axes)
    return order


@compiled(borrowing=True)
def _behind(points: np.ndarray, one: int, other: int, axes: tuple[int, ...]) -> bool:
    """Say whether a point comes after another."""
    for axis in axes:
        if points[one, axis] != points[other, axis]:
            return bool(points[one, axis] > points[other, axis])
    return False


@compiled()
def _order_by_sorts(points: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Return the order by as many sorts, the last axis first: each keeps equals in place."""
    order = np.arange(len(points))
    for level in range(len(axes) - 1, -1, -1):
        order = order[np.argsort(points[order, axes[level]], kind="mergesort")]
    return order


@compiled()
def shared_out(
    points: np.ndarray, times_s: np.ndarray, rows: np.ndarray, owner: np.ndarray, bodies: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return where each body's returns begin, (B + 1,), and their rows, places and times.

    points: (N, 3), metres, and times_s (N,) of all returns. rows: (K,) int64, those that were
    looked at; owner: (K,) int64, the body of each, -1 for none. Sorted by body, then by place.
    """
    starts = np.zeros(bodies + 1, np.int64)
    for body in owner:
        if body >= 0:
            starts[body + 1] += 1
    for body in range(bodies):
        starts[body + 1] += starts[body]
    found, filled = np.empty(starts[-1], np.int64), starts[:-1].copy()
    for k in range(len(rows)):
        if owner[k] >= 0:
            found[filled[owner[k]]] = rows[k]
            filled[owner[k]] += 1
    for body in range(bodies):
        part = found[starts[body] : starts[body + 1]]
        part[:] = part[_order_by(points[part], (2, 1, 0))]
    return starts, found, points[found], times_s[found]


@compiled()
def met_at(
    times_s: np.ndarray, starts: np.ndarray, lidar_from_ego: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return each body's median time, (B,) seconds, 0 of none, and the sensor then, (B, 2) metres.

    times_s: (N,) of its returns, body after body; starts: (B + 1,) where each begins. The others
    as in `sensor_at`.
    """
    bodies = len(starts) - 1
    met_s, origins = np.zeros(bodies), np.empty((bodies, 2))
    for body in range(bodies):
        if starts[body + 1] > starts[body]:
            met_s[body] = np.median(times_s[starts[body] : starts[body + 1]])
        origins[body] = sensor_at(lidar_from_ego, twist, met_s[body])
    return met_s, origins
