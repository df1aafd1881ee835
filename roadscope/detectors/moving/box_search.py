"""From evidence of motion to boxes that hold vehicles, and to the returns of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.moving.view import sensor_at

# --------------------------------------------------------------------------------------------------
# A box the size of a vehicle slides over a map of evidence.

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
        np.empty((3, most + WIDE)),
        np.empty((2, most), np.int64),
        np.empty((4, BINS)),
        headings,
        np.empty(TURNS),
        np.empty(4),
    )
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


# --------------------------------------------------------------------------------------------------
# From evidence of motion to boxes that hold vehicles, and to the returns of each: compiled.

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
