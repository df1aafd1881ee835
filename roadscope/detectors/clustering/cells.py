"""Points sorted into square cells, each cell knowing its neighbours."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.sorting import order_by

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
