"""From evidence of motion to boxes that hold vehicles, and to the returns of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.sorting import starts_of

TURNS = 12
"""Number of headings that are tried over half a turn. They are at most 7.5 degrees off; a car still
fits into the box then."""
BATCH, PADDING_M = 8, 1e6
"""Bounds are computed for so many cells at a time; the last batch is padded with cells at this
distance."""
STRIDE = 3
"""Cells from one position of the box to the next. Chosen by hand."""
BINS, BIN_M = 24, 0.4
"""Number and width of the bins about a box's centre, across the line of sight and along it."""
GAP_BINS, DEEP_BINS = 2, 5
"""A gap of so many empty bins, across or along the line of sight, separates two bodies. A body may
have a gap along the line of sight between its boot and the rear window."""
ROUNDING = 1e-9
"""Sums of evidence that differ by less are equal but for the order in which they were added."""
LEAST_OWN_SHARE = 0.7
"""Least share of its evidence that a box must have without the cells of better boxes. Chosen by
hand."""
X, Y, YAW, SCORE, RIGHT, LEFT, NEAR, FAR = range(8)
"""Columns of boxes, metres and radians: centre, heading, evidence. Then the extent of the body in
the box from the centre: to the right and to the left across the line of sight, near and far along
it."""


class BoxSides(NamedTuple):
    """Half sides of the box and widths of the collar around it, metres.

    The collar lies beyond the ends and beside the flanks of the box. Only evidence against motion
    counts in it: a piece of a wall that extends beyond the box is no vehicle.
    """

    half_length: float
    half_width: float
    collar_at_ends: float
    collar_at_flanks: float


class BoxRule(NamedTuple):
    """When a box holds a vehicle.

    sides: of the box. cell_m: side of a cell of the grid, metres. limit: most evidence of one
    cell, for or against motion. least: least evidence of a box.
    """

    sides: BoxSides
    cell_m: float
    limit: float
    least: float


class EvidenceGrid(NamedTuple):
    """Evidence of motion seen from above, in square cells.

    starts: (X + 1,) int64, the row where each column of cells begins in the arrays below; a column
        has the cells of one x.
    places: (K, 2) float64, metres from the grid's corner, the mean position of the returns in each
        occupied cell, sorted by the cells' x, then y.
    weights: (K,) float64, evidence of motion, above 0 for moving.
    origin: (2,) float64, metres from the corner, the sensor. cell_m: side of a cell.
    """

    starts: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    origin: np.ndarray
    cell_m: float


class NearCells(NamedTuple):
    """Work space for the cells around a box's centre.

    offsets: (3, K) x and y from the centre, metres, and weight, filled up to a whole batch. slots:
    (2, K) bin of each cell across and along the line of sight. bins: (4, BINS), evidence and number
    of cells in each bin across, then along it. headings: (TURNS, 2) unit vectors of the headings.
    bounds: (TURNS,) greatest possible evidence of each heading. reach: (4,) metres, as the last
    four columns of a box.
    """

    offsets: np.ndarray
    slots: np.ndarray
    bins: np.ndarray
    headings: np.ndarray
    bounds: np.ndarray
    reach: np.ndarray


def boxes_in(
    points: np.ndarray, weights: np.ndarray, origin: np.ndarray, rule: BoxRule
) -> np.ndarray:
    """Return (B, 8) boxes that hold moving vehicles, best first; columns from `X` to `FAR`.

    points: (N, 2 or more) metres, N at least 1; weights: (N,) evidence of motion of each. origin:
    (2,) metres, the sensor.
    """
    grid, corner = evidence_grid(points, weights, origin, rule)
    boxes = slide(grid, rule.sides, rule.least)
    # Boxes of equal score stay sorted by x, then by y.
    boxes = boxes[np.argsort(-boxes[:, SCORE], kind="stable")]
    best: np.ndarray = boxes[suppress(boxes, grid, rule.sides, rule.least)]
    best[:, :2] += corner
    return best


def evidence_grid(
    points: np.ndarray, weights: np.ndarray, origin: np.ndarray, rule: BoxRule
) -> tuple[EvidenceGrid, np.ndarray]:
    """Return the grid of evidence and its corner, (2,) metres.

    A cell weighs the same however many returns it holds. Arguments as in `boxes_in`.
    """
    x, y = points[:, 0], points[:, 1]
    corner = rule.cell_m * np.floor(np.array([x.min(), y.min()]) / rule.cell_m)
    column = ((x - corner[0]) / rule.cell_m).astype(np.int64)
    row = ((y - corner[1]) / rule.cell_m).astype(np.int64)
    # The order within a cell fixes the rounding of sums.
    order = np.lexsort((y, x, row, column))
    column, row = column[order], row[order]
    cells = starts_of(column, row)
    cell = np.repeat(np.arange(len(cells) - 1), np.diff(cells))
    counts = np.bincount(cell)
    mean_x, mean_y, weight = (np.bincount(cell, v[order]) / counts for v in (x, y, weights))
    places = np.column_stack([mean_x, mean_y]) - corner
    starts = np.searchsorted(column[cells[:-1]], np.arange(column[-1] + 2))
    weight = np.clip(weight, -rule.limit, rule.limit)
    return EvidenceGrid(starts, places, weight, origin - corner, rule.cell_m), corner


@compiled()
def slide(grid: EvidenceGrid, sides: BoxSides, least: float) -> np.ndarray:
    """Return the best box at each position that has evidence of motion within the box's reach.

    least: least evidence of a box.

    Returns (B, 8), from the grid's corner. Where gaps separate several bodies in a box, only the
    one with most evidence counts.
    """
    reachable, most = _reachable(grid, int(sides.half_length / grid.cell_m)), len(grid.places)
    yaws = np.arange(TURNS) * np.pi / TURNS
    headings = np.stack((np.cos(yaws), np.sin(yaws)), axis=1)
    near = NearCells(
        np.empty((3, most + BATCH)),
        np.empty((2, most), np.int64),
        np.empty((4, BINS)),
        headings,
        np.empty(TURNS),
        np.empty(4),
    )
    boxes, count = np.empty((reachable.sum(), 8)), 0
    for a in range(reachable.shape[0]):
        for b in range(reachable.shape[1]):
            if not reachable[a, b]:
                continue
            x, y = (a * STRIDE + 0.5) * grid.cell_m, (b * STRIDE + 0.5) * grid.cell_m
            cells, bound = _fill_near(near, x, y, grid, sides)
            if bound < least:
                continue
            box = boxes[count]
            box[X], box[Y], box[SCORE] = x, y, 0.0
            _fill_best_turn(box, near, cells, sides, least)
            count += 1 if box[SCORE] >= least else 0
    return boxes[:count]


@compiled()
def _reachable(grid: EvidenceGrid, reach: int) -> np.ndarray:
    """Return the region of interest: whether evidence of motion is near each position of the box.

    reach: cells from the centre of the box to its end.
    """
    x, y = grid.places[:, 0], grid.places[:, 1]
    shape = (
        (int(np.ceil((x.max() - x.min()) / grid.cell_m)) + 3) // STRIDE + 1,
        (int(np.ceil((y.max() - y.min()) / grid.cell_m)) + 3) // STRIDE + 1,
    )
    reachable = np.zeros(shape, np.bool_)
    for row in range(len(grid.places)):
        if grid.weights[row] <= 0.0:
            continue
        i = int(grid.places[row, 0] / grid.cell_m)
        j = int(grid.places[row, 1] / grid.cell_m)
        for a in range(max(i - reach, 0) // STRIDE, min((i + reach) // STRIDE + 1, shape[0])):
            for b in range(max(j - reach, 0) // STRIDE, min((j + reach) // STRIDE + 1, shape[1])):
                reachable[a, b] = True
    return reachable


@compiled(borrowing=True)
def _columns(x: float, reach: float, grid: EvidenceGrid) -> tuple[int, int]:
    """Return the first row, and the one after the last, of the cells within reach of an x."""
    last = len(grid.starts) - 2
    low, high = int(max(x - reach, 0.0) / grid.cell_m), int((x + reach) / grid.cell_m)
    return grid.starts[min(low, last)], grid.starts[min(high, last) + 1]


@compiled(borrowing=True)
def _sight(x: float, y: float, origin: np.ndarray) -> tuple[float, float]:
    """Return the unit vector from the sensor to a place."""
    dx, dy = x - origin[0], y - origin[1]
    away = max(np.sqrt(dx * dx + dy * dy), 1e-9)
    return dx / away, dy / away


@compiled(borrowing=True)
def _fill_near(
    near: NearCells, x: float, y: float, grid: EvidenceGrid, sides: BoxSides
) -> tuple[int, float]:
    """Fill in the cells around a place; return how many, and the most evidence a box has there."""
    offsets, slots = near.offsets, near.slots
    long, wide = sides.half_length, sides.half_width
    # No turned box reaches beyond `outer` with its collar, nor beyond the root of `inner` without.
    inner = np.hypot(long, wide) ** 2
    outer = max(
        np.hypot(long + sides.collar_at_ends, wide), np.hypot(long, wide + sides.collar_at_flanks)
    )
    sight, (first, last) = _sight(x, y, grid.origin), _columns(x, outer, grid)
    count, bound = 0, 0.0
    for row in range(first, last):
        dx, dy = grid.places[row, 0] - x, grid.places[row, 1] - y
        square, weight = dx * dx + dy * dy, grid.weights[row]
        if square > outer * outer:
            continue
        across, deep = sight[0] * dy - sight[1] * dx, sight[0] * dx + sight[1] * dy
        offsets[0, count], offsets[1, count], offsets[2, count] = dx, dy, weight
        slots[0, count] = min(max(int(across / BIN_M + BINS / 2), 0), BINS - 1)
        slots[1, count] = min(max(int(deep / BIN_M + BINS / 2), 0), BINS - 1)
        bound += max(weight, 0.0) if square <= inner else 0.0
        count += 1
    offsets[:2, count : count + BATCH], offsets[2, count : count + BATCH] = PADDING_M, 0.0
    return count, bound


@compiled(borrowing=True)
def _fill_best_turn(
    box: np.ndarray, near: NearCells, cells: int, sides: BoxSides, least: float
) -> None:
    """Write yaw, score and extent of the body at the best heading, if one has `least` evidence.

    cells: how many are near. Headings are tried in the order of falling bounds.
    """
    bounds = near.bounds
    _fill_bounds(near, cells, sides)
    for _ in range(TURNS):
        turn = int(bounds.argmax())
        # The bound is a sum in another order.
        if bounds[turn] + ROUNDING < least or bounds[turn] <= box[SCORE] + ROUNDING:
            break
        bounds[turn] = -np.inf
        score = _evidence(near, cells, turn, sides, max(box[SCORE], least))
        if score > box[SCORE]:
            box[YAW], box[SCORE] = turn * np.pi / TURNS, score
            for k in range(4):
                box[RIGHT + k] = near.reach[k]


@compiled(borrowing=True, fastmath=True)
def _fill_bounds(near: NearCells, cells: int, sides: BoxSides) -> None:
    """Fill in for each heading an upper bound on the evidence of any body in the box.

    It is the evidence for motion in the box and the evidence against it in the collar.
    """
    near_x, near_y, weights = near.offsets[0], near.offsets[1], near.offsets[2]
    long, wide = sides.half_length, sides.half_width
    longer, wider = long + sides.collar_at_ends, wide + sides.collar_at_flanks
    for turn in range(TURNS):
        cos, sin = near.headings[turn, 0], near.headings[turn, 1]
        total = 0.0
        for k in range((cells + BATCH - 1) // BATCH * BATCH):
            dx, dy, weight = near_x[k], near_y[k], weights[k]
            along, across = abs(cos * dx + sin * dy), abs(cos * dy - sin * dx)
            inside = (along <= long) & (across <= wide)
            around = ((along <= longer) & (across <= wide)) | ((along <= long) & (across <= wider))
            total += max(weight, 0.0) if inside else (min(weight, 0.0) if around else 0.0)
        near.bounds[turn] = total


@compiled(borrowing=True)
def _evidence(near: NearCells, cells: int, turn: int, sides: BoxSides, least: float) -> float:
    """Return the evidence of the best body in the box, and fill in its reach.

    If the evidence is below `least`, the result may be any number below `least`.
    """
    near_x, near_y, weights = near.offsets[0], near.offsets[1], near.offsets[2]
    cos, sin, bins = near.headings[turn, 0], near.headings[turn, 1], near.bins
    long, wide = sides.half_length, sides.half_width
    longer, wider = long + sides.collar_at_ends, wide + sides.collar_at_flanks
    bins[:] = 0.0
    against = 0.0
    for k in range(cells):
        dx, dy, weight = near_x[k], near_y[k], weights[k]
        along, across = abs(cos * dx + sin * dy), abs(cos * dy - sin * dx)
        if along <= long and across <= wide:
            side, deep = near.slots[0, k], near.slots[1, k]
            bins[0, side] += weight
            bins[1, side] += 1.0
            bins[2, deep] += weight
            bins[3, deep] += 1.0
        elif weight < 0.0 and (
            (along <= longer and across <= wide) or (along <= long and across <= wider)
        ):
            against += weight
    reach = near.reach
    side, reach[0], reach[1] = _best_run(bins[:2], GAP_BINS)
    if side + against < least:
        return side + against
    deep, reach[2], reach[3] = _best_run(bins[2:], DEEP_BINS)
    return min(side, deep) + against


@compiled(borrowing=True)
def _best_run(bins: np.ndarray, gap: int) -> tuple[float, float, float]:
    """Return the evidence, begin and end of the run of bins with most evidence and no gap.

    bins: (2, BINS), evidence and number of cells. Begin and end are metres from the box's centre.
    gap: number of empty bins that end a run.
    """
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
def suppress(boxes: np.ndarray, grid: EvidenceGrid, sides: BoxSides, least: float) -> np.ndarray:
    """Return the rows of boxes that stay, best first.

    A box stays if it has `least` evidence, and the share `LEAST_OWN_SHARE` of all its evidence,
    without the cells of better boxes. boxes: (B, 8), sorted by falling score; the rest as in
    `slide`.
    """
    cells = len(grid.places)
    taken, rows = np.zeros(cells, np.bool_), np.empty(cells, np.int64)
    stays, count = np.empty(len(boxes), np.int64), 0
    for b in range(len(boxes)):
        first, last = _columns(boxes[b, X], sides.half_length + sides.half_width, grid)
        n = fill_rows(rows, grid.places[first:last], boxes[b], grid.origin, sides)
        rows[:n] += first
        own_evidence = boxes[b, SCORE]
        for row in rows[:n]:
            own_evidence -= grid.weights[row] if taken[row] else 0.0
        if own_evidence < max(least, LEAST_OWN_SHARE * boxes[b, SCORE]):
            continue
        for row in rows[:n]:
            taken[row] = True
        stays[count] = b
        count += 1
    return stays[:count]


@compiled(borrowing=True)
def fill_rows(
    rows: np.ndarray, points: np.ndarray, box: np.ndarray, origin: np.ndarray, sides: BoxSides
) -> int:
    """Write the rows of the points that belong to the body in a box; return how many.

    rows: (N,) int64, filled in. points: (N, 2 or 3) metres. box: (8,), columns from `X` to `FAR`.
    origin: (2,) metres, the sensor. All are in one frame.
    """
    x, y = box[X], box[Y]
    cos, sin = np.cos(box[YAW]), np.sin(box[YAW])
    sx, sy = _sight(x, y, origin)
    long, wide = sides.half_length, sides.half_width
    count, reach = 0, long + wide
    for row in range(len(points)):
        dx, dy = points[row, 0] - x, points[row, 1] - y
        if abs(dx) > reach or abs(dy) > reach:
            continue
        if abs(cos * dx + sin * dy) > long or abs(cos * dy - sin * dx) > wide:
            continue
        across, deep = sx * dy - sy * dx, sx * dx + sy * dy
        if box[RIGHT] <= across <= box[LEFT] and box[NEAR] <= deep <= box[FAR]:
            rows[count] = row
            count += 1
    return count
