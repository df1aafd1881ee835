"""A box the size of a vehicle slides over a map of evidence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

TURNS = 12
"""Headings tried over half a turn: 7.5 degrees off, the box is still wider than a car."""
WIDE, AFAR_M = 8, 1e6
"""Cells that are worked on at a time, and where those are that fill up the last lot."""
STRIDE = 3
"""Cells from one place of the box to the next."""
BINS, BIN_M = 24, 0.4
GAP_BINS, DEEP_BINS = 2, 5
"""A gap of so many empty bins, across or along the line of sight, parts two bodies. Between the
boot's end and the glass above it a body may show nothing."""
HAIR = 1e-9
"""Evidence no more different than this is the same, added up in another order."""
MOST = 0.7
"""Share of its evidence that a box must keep beside better ones."""


class Chart(NamedTuple):
    """Evidence of motion seen from above, in square cells.

    starts: (X + 1,) int64, where each column of cells, x, begins in the arrays below.
    places: (K, 2) float64, metres, where the returns of a cell are, from the chart's corner, by
        the cells' x, then y.
    weights: (K,) float64, evidence, above 0 for moving.
    origin: (2,) float64, metres, the sensor, from the corner too. cell_m: side of a cell.
    """

    starts: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    origin: np.ndarray
    cell_m: float


class Room(NamedTuple):
    """Where the cells about a place are written.

    near: (3, K) x and y from the place, metres, and weight, up to a whole lot. slots: (2, K) bins
    across and along the line of sight. bins: (4, BINS), evidence and number of cells across, then
    along it.
    headings: (TURNS, 2) unit vectors of a box's turns. hopes: (TURNS,) evidence at most.
    run: (4,) metres, from where to where the body reaches across and along.
    """

    near: np.ndarray
    slots: np.ndarray
    bins: np.ndarray
    headings: np.ndarray
    hopes: np.ndarray
    run: np.ndarray


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
    open_, most = _reachable(chart, int(sides[0] / chart.cell_m)), len(chart.places)
    yaws = np.arange(TURNS) * np.pi / TURNS
    headings = np.stack((np.cos(yaws), np.sin(yaws)), axis=1)
    room = Room(
        np.empty((3, most + WIDE)), np.empty((2, most), np.int64), np.empty((4, BINS)),
        headings, np.empty(TURNS), np.empty(4),
    )  # fmt: skip
    found, count = np.empty((open_.sum(), 8)), 0
    for a in range(open_.shape[0]):
        for b in range(open_.shape[1]):
            if not open_[a, b]:
                continue
            x, y = (a * STRIDE + 0.5) * chart.cell_m, (b * STRIDE + 0.5) * chart.cell_m
            n, hope = _look_about(x, y, chart, sides, room)
            if hope < least:
                continue
            box = found[count]
            box[0], box[1], box[3] = x, y, 0.0
            _turn(box, n, room, sides, least)
            count += 1 if box[3] >= least else 0
    return found[:count]


@compiled(borrowing=True)
def _columns(x: float, reach: float, chart: Chart) -> tuple[int, int]:
    """Return the first row, and the one after the last, of the columns within reach of an x."""
    last = len(chart.starts) - 2
    low, high = int(max(x - reach, 0.0) / chart.cell_m), int((x + reach) / chart.cell_m)
    return chart.starts[min(low, last)], chart.starts[min(high, last) + 1]


@compiled(borrowing=True)
def _look_about(
    x: float, y: float, chart: Chart, sides: np.ndarray, room: Room
) -> tuple[int, float]:
    """Return how many cells a box about a place can hold, and the most evidence it can have."""
    near, slots = room.near, room.slots
    # No turned box reaches beyond these distances, with and without its collar.
    inner = np.hypot(sides[0], sides[1]) ** 2
    outer = max(np.hypot(sides[0] + sides[2], sides[1]), np.hypot(sides[0], sides[1] + sides[3]))
    sight, (first, last) = _sight(x, y, chart.origin), _columns(x, outer, chart)
    count, hope = 0, 0.0
    for row in range(first, last):
        dx, dy = chart.places[row, 0] - x, chart.places[row, 1] - y
        far, weight = dx * dx + dy * dy, chart.weights[row]
        if far > outer * outer:
            continue
        near[0, count], near[1, count], near[2, count] = dx, dy, weight
        slots[0, count] = _bin(sight[0] * dy - sight[1] * dx)
        slots[1, count] = _bin(sight[0] * dx + sight[1] * dy)
        hope += max(weight, 0.0) if far <= inner else 0.0
        count += 1
    near[:2, count : count + WIDE], near[2, count : count + WIDE] = AFAR_M, 0.0
    return count, hope


@compiled(borrowing=True)
def _turn(box: np.ndarray, count: int, room: Room, sides: np.ndarray, least: float) -> None:
    """Write yaw, score and body of the best turn of a box, where one has `least` evidence.

    count: of the cells in the room. Turns are tried from the one with most to hope for on.
    """
    hopes = room.hopes
    _hope(room, count, sides)
    for _ in range(TURNS):
        turn = int(hopes.argmax())
        # A hair more or less, for the order of the sum.
        if hopes[turn] + HAIR < least or hopes[turn] <= box[3] + HAIR:
            break
        hopes[turn] = -np.inf
        score = _evidence(room, count, turn, sides, max(box[3], least))
        if score > box[3]:
            box[2], box[3] = turn * np.pi / TURNS, score
            for k in range(4):
                box[4 + k] = room.run[k]


@compiled(borrowing=True, fastmath=True)
def _hope(room: Room, count: int, sides: np.ndarray) -> None:
    """Fill in for each turn no less than the evidence of any body in a box at the origin.

    That is what speaks for motion in the box, and against it in its collar, in any order.
    """
    near_x, near_y, weights = room.near[0], room.near[1], room.near[2]
    long, wide = sides[0], sides[1]
    longer, wider = long + sides[2], wide + sides[3]
    for turn in range(TURNS):
        cos, sin = room.headings[turn, 0], room.headings[turn, 1]
        total = 0.0
        for k in range((count + WIDE - 1) // WIDE * WIDE):
            dx, dy, weight = near_x[k], near_y[k], weights[k]
            along, across = abs(cos * dx + sin * dy), abs(cos * dy - sin * dx)
            inside = (along <= long) & (across <= wide)
            around = ((along <= longer) & (across <= wide)) | ((along <= long) & (across <= wider))
            total += max(weight, 0.0) if inside else (min(weight, 0.0) if around else 0.0)
        room.hopes[turn] = total


@compiled(borrowing=True)
def _bin(place: float) -> int:
    """Return the bin of a place across or along the line of sight, metres."""
    return min(max(int(place / BIN_M + BINS / 2), 0), BINS - 1)


@compiled(borrowing=True)
def _sight(x: float, y: float, origin: np.ndarray) -> tuple[float, float]:
    """Return the unit vector from the sensor to a place."""
    dx, dy = x - origin[0], y - origin[1]
    away = max(np.sqrt(dx * dx + dy * dy), 1e-9)
    return dx / away, dy / away


@compiled(borrowing=True)
def _evidence(room: Room, count: int, turn: int, sides: np.ndarray, least: float) -> float:
    """Return the evidence of the best body in a box at the origin, and fill in its run.

    Where that is less than the least, it may be any number less than that.
    """
    near_x, near_y, weights = room.near[0], room.near[1], room.near[2]
    cos, sin, bins = room.headings[turn, 0], room.headings[turn, 1], room.bins
    long, wide, ends, flanks = sides
    bins[:] = 0.0
    against = 0.0
    for k in range(count):
        dx, dy, weight = near_x[k], near_y[k], weights[k]
        along, across = abs(cos * dx + sin * dy), abs(cos * dy - sin * dx)
        if along <= long and across <= wide:
            side, deep = room.slots[0, k], room.slots[1, k]
            bins[0, side] += weight
            bins[1, side] += 1.0
            bins[2, deep] += weight
            bins[3, deep] += 1.0
        elif weight < 0.0 and (
            (along <= long + ends and across <= wide) or (along <= long and across <= wide + flanks)
        ):
            against += weight
    run = room.run
    side, run[0], run[1] = _best_run(bins[:2], GAP_BINS)
    if side + against < least:
        return side + against
    deep, run[2], run[3] = _best_run(bins[2:], DEEP_BINS)
    return min(side, deep) + against


@compiled(borrowing=True)
def _best_run(bins: np.ndarray, gap: int) -> tuple[float, float, float]:
    """Return evidence, begin and end of the run of bins, without a gap, that has most."""
    first, end = 0, BINS
    while first < BINS and bins[1, first] == 0.0:
        first += 1
    while end > first and bins[1, end - 1] == 0.0:
        end -= 1
    best, low, high = 0.0, 0, 0
    total, start, last = 0.0, first, first
    for k in range(first, end):
        if bins[1, k] == 0.0:
            continue
        if k - last > gap:
            if total > best:
                best, low, high = total, start, last + 1
            total, start = 0.0, k
        total, last = total + bins[0, k], k
    if total > best:
        best, low, high = total, start, last + 1
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
        first, last = _columns(boxes[b, 0], sides[0] + sides[1], chart)
        n = _held(chart.places[first:last], boxes[b], chart.origin, sides, rows)
        rows[:n] += first
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


@compiled(borrowing=True)
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
    wide, deep = chart.places[:, 0], chart.places[:, 1]
    shape = (
        (int(np.ceil((wide.max() - wide.min()) / chart.cell_m)) + 3) // STRIDE + 1,
        (int(np.ceil((deep.max() - deep.min()) / chart.cell_m)) + 3) // STRIDE + 1,
    )
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
