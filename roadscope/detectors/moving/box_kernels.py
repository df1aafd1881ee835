"""A box the size of a vehicle slides over a map of evidence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

TURNS = 12
"""Headings tried over half a turn: 7.5 degrees off, the box is still wider than a car."""
STRIDE = 2
"""Cells from one place of the box to the next."""
BINS, BIN_M = 24, 0.4
GAP_BINS, DEEP_BINS = 2, 5
"""A gap of so many empty bins, across or along the line of sight, parts two bodies. Between the
boot's end and the glass above it a body may show nothing."""
MOST = 0.7
"""Share of its evidence that a box must keep beside better ones."""


class Chart(NamedTuple):
    """Evidence of motion seen from above, in square cells.

    rows: (X, Y) int32, row of a cell in the arrays below, -1 where it is empty.
    places: (K, 2) float64, metres, where the returns of a cell are, from the chart's corner.
    weights: (K,) float64, evidence, above 0 for moving.
    origin: (2,) float64, metres, the sensor, from the corner too. cell_m: side of a cell.
    """

    rows: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    origin: np.ndarray
    cell_m: float


@compiled()
def slide(chart: Chart, sides: np.ndarray, least: float) -> np.ndarray:
    """Return the best box about every place that has evidence within its reach.

    sides: (4,) half length, half width, collar at the ends and at the flanks, metres.
    least: evidence of which a box needs as much.

    Returns (B, 8): x, y, yaw, score, and from where to where across and along the line of sight
    the body in the box reaches, metres and radians, from the chart's corner. A body has no gap
    that a ray goes through, and no wide one in depth; of several in the box the one with most
    evidence counts. In the collar counts what speaks against: a piece of wall that goes on is no
    vehicle.
    """
    open_ = _reachable(chart, int(sides[0] / chart.cell_m))
    most = (2 * _reach(sides, chart.cell_m) + 1) ** 2
    near, slots = np.empty((3, most)), np.empty((2, most), np.int64)
    found, bins = np.empty((open_.sum(), 8)), np.empty((4, BINS))
    count = 0
    for a in range(open_.shape[0]):
        for b in range(open_.shape[1]):
            if not open_[a, b]:
                continue
            x, y = (a * STRIDE + 0.5) * chart.cell_m, (b * STRIDE + 0.5) * chart.cell_m
            n, hope = _look_about(x, y, chart, sides, (near, slots))
            if hope < least:
                continue
            box = found[count]
            box[0], box[1] = x, y
            _turn(box, near[:, :n], slots[:, :n], sides, bins)
            count += 1 if box[3] >= least else 0
    return found[:count]


@compiled()
def _reach(sides: np.ndarray, cell_m: float) -> int:
    """Return cells to either side beyond which no turned box reaches."""
    return int(np.ceil((sides[0] + sides[1] + sides[2]) / cell_m))


@compiled()
def _look_about(
    x: float, y: float, chart: Chart, sides: np.ndarray, out: tuple[np.ndarray, np.ndarray]
) -> tuple[int, float]:
    """Return how many cells a box about a place can hold, and the most evidence it can have.

    out: (3, M) x, y and weight of those cells, and (2, M) bins across and along the sight.
    """
    near, slots = out
    # No turned box reaches beyond these distances, with and without its collar.
    inner = np.hypot(sides[0], sides[1]) ** 2
    outer = max(np.hypot(sides[0] + sides[2], sides[1]), np.hypot(sides[0], sides[1] + sides[3]))
    reach, (wide, deep) = _reach(sides, chart.cell_m), chart.rows.shape
    i, j, sight = int(x / chart.cell_m), int(y / chart.cell_m), _sight(x, y, chart.origin)
    count, hope = 0, 0.0
    for k in range(max(i - reach, 0), min(i + reach + 1, wide)):
        for m in range(max(j - reach, 0), min(j + reach + 1, deep)):
            row = chart.rows[k, m]
            if row < 0:
                continue
            dx, dy = chart.places[row, 0] - x, chart.places[row, 1] - y
            far, weight = dx * dx + dy * dy, chart.weights[row]
            if far > outer * outer:
                continue
            near[0, count], near[1, count], near[2, count] = dx, dy, weight
            slots[0, count] = _bin(sight[0] * dy - sight[1] * dx)
            slots[1, count] = _bin(sight[0] * dx + sight[1] * dy)
            hope += max(weight, 0.0) if far <= inner else 0.0
            count += 1
    return count, hope


@compiled()
def _turn(
    box: np.ndarray, near: np.ndarray, slots: np.ndarray, sides: np.ndarray, bins: np.ndarray
) -> None:
    """Write yaw, score and body of the best turn of a box, score 0 if none has evidence.

    near, slots, bins: as in `_evidence`.
    """
    box[3] = 0.0
    for turn in range(TURNS):
        yaw = turn * np.pi / TURNS
        score = _evidence(near, slots, (np.cos(yaw), np.sin(yaw)), sides, bins)
        if score > box[3]:
            box[2], box[3] = yaw, score
            _, box[4], box[5] = _best_run(bins[:2], GAP_BINS)
            _, box[6], box[7] = _best_run(bins[2:], DEEP_BINS)


@compiled()
def _bin(place: float) -> int:
    """Return the bin of a place across or along the line of sight, metres."""
    return min(max(int(place / BIN_M + BINS / 2), 0), BINS - 1)


@compiled()
def _sight(x: float, y: float, origin: np.ndarray) -> tuple[float, float]:
    """Return the unit vector from the sensor to a place."""
    dx, dy = x - origin[0], y - origin[1]
    away = max(np.sqrt(dx * dx + dy * dy), 1e-9)
    return dx / away, dy / away


@compiled()
def _evidence(
    near: np.ndarray,
    slots: np.ndarray,
    heading: tuple[float, float],
    sides: np.ndarray,
    bins: np.ndarray,
) -> float:
    """Return the evidence of the best body in a box at the origin.

    near: (3, K) x, y and weight of cells. slots: (2, K) their bins across and along the line of
    sight. bins: (4, BINS) filled with evidence and number of cells across, then along it.
    """
    cos, sin = heading
    long, wide, ends, flanks = sides
    bins[:] = 0.0
    against = 0.0
    for k in range(near.shape[1]):
        dx, dy, weight = near[0, k], near[1, k], near[2, k]
        along, across = abs(cos * dx + sin * dy), abs(cos * dy - sin * dx)
        if along <= long and across <= wide:
            side, deep = slots[0, k], slots[1, k]
            bins[0, side] += weight
            bins[1, side] += 1.0
            bins[2, deep] += weight
            bins[3, deep] += 1.0
        elif weight < 0.0 and (
            (along <= long + ends and across <= wide) or (along <= long and across <= wide + flanks)
        ):
            against += weight
    best = min(_best_run(bins[:2], GAP_BINS)[0], _best_run(bins[2:], DEEP_BINS)[0])
    return best + against


@compiled()
def _best_run(bins: np.ndarray, gap: int) -> tuple[float, float, float]:
    """Return evidence, begin and end of the run of bins, without a gap, that has most."""
    best, low, high = 0.0, 0, 0
    total, start, last = 0.0, 0, -1
    for k in range(BINS + gap + 1):
        if last >= 0 and k - last > gap:
            if total > best:
                best, low, high = total, start, last + 1
            total, last = 0.0, -1
        if k < BINS and bins[1, k] > 0.0:
            start = start if last >= 0 else k
            total, last = total + bins[0, k], k
    return best, (low - BINS / 2) * BIN_M, (high - BINS / 2) * BIN_M


@compiled()
def suppress(boxes: np.ndarray, chart: Chart, sides: np.ndarray, least: float) -> np.ndarray:
    """Return the rows of boxes that stay, best first.

    A box stays when without the cells of better ones it still has `least` evidence and most of
    what it had. boxes: (B, 8), sorted by falling score; the rest as in `slide`.
    """
    cells = len(chart.places)
    taken, rows = np.zeros(cells, np.bool_), np.empty(cells, np.int64)
    kept, count = np.empty(len(boxes), np.int64), 0
    for b in range(len(boxes)):
        n = _held(chart.places, boxes[b], chart.origin, sides, rows)
        left = boxes[b, 3]
        for row in rows[:n]:
            left -= chart.weights[row] if taken[row] else 0.0
        if left < max(least, MOST * boxes[b, 3]):
            continue
        for row in rows[:n]:
            taken[row] = True
        kept[count] = b
        count += 1
    return kept[:count]


@compiled()
def _held(
    places: np.ndarray, box: np.ndarray, origin: np.ndarray, sides: np.ndarray, rows: np.ndarray
) -> int:
    """Write into `rows` which places belong to the body in a box; return how many."""
    x, y, low, high, near, far = box[0], box[1], box[4], box[5], box[6], box[7]
    cos, sin = np.cos(box[2]), np.sin(box[2])
    sx, sy = _sight(x, y, origin)
    long, wide = sides[0], sides[1]
    count, reach = 0, long + wide
    for row in range(len(places)):
        dx, dy = places[row, 0] - x, places[row, 1] - y
        if abs(dx) > reach or abs(dy) > reach:
            continue
        if abs(cos * dx + sin * dy) > long or abs(cos * dy - sin * dx) > wide:
            continue
        if low <= sx * dy - sy * dx <= high and near <= sx * dx + sy * dy <= far:
            rows[count] = row
            count += 1
    return count


@compiled()
def gathered(
    points: np.ndarray, box: np.ndarray, origin: np.ndarray, sides: np.ndarray
) -> np.ndarray:
    """Return the rows (K,) of those points (N, 3), metres, that belong to the body in a box.

    box: (8,), a row of what `slide` returns. origin: (2,) metres, the sensor. All of one frame.
    sides: as in `slide`.
    """
    rows = np.empty(len(points), np.int64)
    return rows[: _held(points, box, origin, sides, rows)].copy()


@compiled()
def _reachable(chart: Chart, reach: int) -> np.ndarray:
    """Regions of interest: places of the box, every `STRIDE` cells, with evidence near."""
    shape = chart.rows.shape[0] // STRIDE + 1, chart.rows.shape[1] // STRIDE + 1
    open_ = np.zeros(shape, np.bool_)
    for row in range(len(chart.places)):
        if chart.weights[row] <= 0.0:
            continue
        i = int(chart.places[row, 0] / chart.cell_m)
        j = int(chart.places[row, 1] / chart.cell_m)
        for a in range(max(i - reach, 0) // STRIDE, min((i + reach) // STRIDE + 1, shape[0])):
            for b in range(max(j - reach, 0) // STRIDE, min((j + reach) // STRIDE + 1, shape[1])):
                open_[a, b] = True
    return open_
