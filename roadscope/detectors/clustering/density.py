"""Density-based clusters of points in the plane (Ester et al. 1996), by cells."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.clustering.union import join, root_of
from roadscope.detectors.sorting import order_by

# --------------------------------------------------------------------------------------------------
# Points sorted into square cells, each cell knowing its neighbours.

SPAN = 2
"""Cells to either side within which two points can be a diagonal of a cell apart."""


def sort_cells(points: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points by cell, where each cell begins, and the cells.

    points: (N, 2); side: of a cell, same unit.
    Returns order (N,) rows of points, cell by cell, by row within a cell; starts (C + 1,) places
    in it; cells (C, 2) int64, x and y, sorted.
    """
    numbers = _cell_numbers(points, side)
    order = order_by(numbers[1])
    order = order[order_by(numbers[0, order])]
    return order, *_runs(numbers[:, order])


@compiled()
def _cell_numbers(points: np.ndarray, side: float) -> np.ndarray:
    """Return x and y of each point's cell, (2, N) int64, from the lowest up."""
    numbers = np.empty((2, len(points)), np.int64)
    for axis in range(2):
        low = points[0, axis]
        for row in range(len(points)):
            low = min(low, points[row, axis])
        for row in range(len(points)):
            numbers[axis, row] = np.int64((points[row, axis] - low) / side)
    return numbers


@compiled()
def _runs(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where each cell begins in (2, N) sorted cell numbers, and the cells."""
    size = numbers.shape[1]
    starts, cells = np.empty(size + 1, np.int64), np.empty((size, 2), np.int64)
    count = 0
    for place in range(size):
        x, y = numbers[0, place], numbers[1, place]
        if count == 0 or x != cells[count - 1, 0] or y != cells[count - 1, 1]:
            cells[count, 0], cells[count, 1], starts[count] = x, y, place
            count += 1
    starts[count] = size
    return starts[: count + 1], cells[:count]


@compiled()
def neighbours(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells within `SPAN` of each of (C, 2) sorted cells, without itself.

    Returns near (C, 24) int64 and counts (C,): the first `counts[c]` of a row hold.
    """
    width = 2 * SPAN + 1
    size = len(cells)
    near, counts = np.empty((size, width * width - 1), np.int64), np.zeros(size, np.int64)
    heads = np.zeros(width, np.int64)
    for c in range(size):
        for step in range(width):
            x, y = cells[c, 0] + step - SPAN, cells[c, 1] - SPAN
            # Cells are sorted, so the first one that is near enough only ever moves on.
            head = heads[step]
            while head < size and (
                cells[head, 0] < x or (cells[head, 0] == x and cells[head, 1] < y)
            ):
                head += 1
            heads[step] = head
            while head < size and cells[head, 0] == x and cells[head, 1] <= y + 2 * SPAN:
                if head != c:
                    near[c, counts[c]] = head
                    counts[c] += 1
                head += 1
    return near, counts


@compiled()
def boxes(points: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the bounds of each cell's points, (C, 4): lowest x, y, highest x, y.

    points: (N, 2), cell by cell.
    """
    bounds = np.empty((len(starts) - 1, 4))
    for c in range(len(starts) - 1):
        bounds[c, :2], bounds[c, 2:] = np.inf, -np.inf
        for row in range(starts[c], starts[c + 1]):
            for axis in range(2):
                bounds[c, axis] = min(bounds[c, axis], points[row, axis])
                bounds[c, axis + 2] = max(bounds[c, axis + 2], points[row, axis])
    return bounds


# --------------------------------------------------------------------------------------------------
# Density-based clusters of points in the plane (Ester et al. 1996), by cells.

OUTLIER = -1
"""Label of a return that belongs to no cluster."""


def density_labels(points: np.ndarray, radius: float, min_points: int) -> np.ndarray:
    """Return the (N,) int64 DBSCAN labels of (N, 2) points, the same as scikit-learn's.

    A point is core when at least `min_points` points, itself counted, lie within the radius or
    at it. Core points within the radius of one another share a cluster, clusters are numbered
    by their first core point; another point near a core point joins the lowest such cluster, the
    rest are `OUTLIER`.
    """
    if not len(points):
        return np.empty(0, np.int64)
    # A hair less than the true side: rounding must not put two points of a cell too far apart.
    side = radius / np.sqrt(2) * (1 - 1e-9)
    order, starts, cells = sort_cells(points, side)
    near, counts = neighbours(cells)
    sorted_points, limit = points[order], radius * radius
    core = _core(sorted_points, starts, near, counts, (limit, min_points))
    bounds = boxes(sorted_points, starts)
    parents = _linked(sorted_points, starts, near, counts, (core, bounds, limit))
    by_row = _numbered(order, starts, core, parents)
    _join_borders(sorted_points, starts, near, counts, (core, by_row, limit))
    labels = np.empty(len(points), np.int64)
    labels[order] = by_row
    return labels


@compiled()
def _core(
    points: np.ndarray,
    starts: np.ndarray,
    near: np.ndarray,
    counts: np.ndarray,
    rule: tuple[float, int],
) -> np.ndarray:
    """Return which points are core, (N,) bool; points cell by cell."""
    limit, min_points = rule
    core = np.zeros(len(points), np.bool_)
    for c in range(len(counts)):
        inside = starts[c + 1] - starts[c]
        for row in range(starts[c], starts[c + 1]):
            found = inside
            for k in range(counts[c]):
                if found >= min_points:
                    break
                other = near[c, k]
                for second in range(starts[other], starts[other + 1]):
                    x = points[row, 0] - points[second, 0]
                    y = points[row, 1] - points[second, 1]
                    found += x * x + y * y <= limit
            core[row] = found >= min_points
    return core


@compiled()
def _linked(
    points: np.ndarray,
    starts: np.ndarray,
    near: np.ndarray,
    counts: np.ndarray,
    rule: tuple[np.ndarray, np.ndarray, float],
) -> np.ndarray:
    """Join cells whose core points touch; return each cell's parent, (C,)."""
    core, bounds, limit = rule
    parents = np.arange(len(counts))
    for c in range(len(counts)):
        for k in range(counts[c]):
            other = near[c, k]
            if other > c or root_of(parents, c) == root_of(parents, other):
                continue
            if _touch(points, starts, core, bounds[other], (c, other, limit)):
                join(parents, c, other)
    return parents


@compiled()
def _touch(
    points: np.ndarray,
    starts: np.ndarray,
    core: np.ndarray,
    box: np.ndarray,
    pair: tuple[int, int, float],
) -> bool:
    """Whether a core point of one cell lies within the radius of one of the other's."""
    c, other, limit = pair
    for row in range(starts[c], starts[c + 1]):
        if not core[row]:
            continue
        x, y = points[row, 0], points[row, 1]
        off_x, off_y = max(box[0] - x, x - box[2], 0.0), max(box[1] - y, y - box[3], 0.0)
        if off_x * off_x + off_y * off_y > limit:
            continue
        for second in range(starts[other], starts[other + 1]):
            if core[second]:
                dx, dy = x - points[second, 0], y - points[second, 1]
                if dx * dx + dy * dy <= limit:
                    return True
    return False


@compiled()
def _numbered(
    order: np.ndarray, starts: np.ndarray, core: np.ndarray, parents: np.ndarray
) -> np.ndarray:
    """Return core points' labels, cell by cell, (N,): clusters are numbered by first core point."""
    size = len(order)
    cell_of, place_of = np.empty(size, np.int64), np.empty(size, np.int64)
    for c in range(len(starts) - 1):
        for place in range(starts[c], starts[c + 1]):
            cell_of[place], place_of[order[place]] = c, place
    number, count = np.full(len(parents), -1), 0
    labels = np.full(size, OUTLIER)
    for row in range(size):
        place = place_of[row]
        if not core[place]:
            continue
        root = root_of(parents, cell_of[place])
        if number[root] < 0:
            number[root] = count
            count += 1
        labels[place] = number[root]
    return labels


@compiled()
def _join_borders(
    points: np.ndarray,
    starts: np.ndarray,
    near: np.ndarray,
    counts: np.ndarray,
    rule: tuple[np.ndarray, np.ndarray, float],
) -> None:
    """Give points near a core point the lowest label of those, in place."""
    core, labels, limit = rule
    for c in range(len(counts)):
        for row in range(starts[c], starts[c + 1]):
            if core[row]:
                continue
            best = np.int64(len(points))
            for k in range(-1, counts[c]):
                other = c if k < 0 else near[c, k]
                for second in range(starts[other], starts[other + 1]):
                    if core[second] and labels[second] < best:
                        x = points[row, 0] - points[second, 0]
                        y = points[row, 1] - points[second, 1]
                        if x * x + y * y <= limit:
                            best = labels[second]
            if best < len(points):
                labels[row] = best
