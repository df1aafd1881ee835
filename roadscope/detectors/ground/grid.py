"""Ground removal by the height span of grid cells (Li 2021, section 3)."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud

MOST_CELLS = 4_000_000
"""Larger grids (1000 m square at half a metre) are not stored; their occupied cells are sorted."""


def grid_above_ground(
    cloud: Cloud,
    *,
    cell_m: float = 0.5,
    span_m: float = 0.3,
    clear_m: float = 0.3,
    ceiling_m: float = 2.5,
) -> np.ndarray:
    """Keep returns above the ground, by the height span of grid cells (Li 2021).

    Returns (N,) bool, true for returns that are kept.

    Li 2021 keeps the cells of `cell_m` whose highest and lowest return differ by more than a
    threshold (`span_m`). With four layers 0.8 deg apart a cell often has returns of one layer only,
    and always far away; then its span is meaningless. So the calibration is used, too: every return
    more than `clear_m` above the plane on which the wheels stand is kept. A lower return is kept if
    the span of its cell exceeds the threshold and if the return is more than half of `span_m` above
    the lower one of that plane and the cell's lowest return. Returns above `ceiling_m` (tree
    crowns, bridges, upper floors) do not show a footprint and are dropped. The paper prints no
    values; the defaults are chosen by hand.
    """
    heights = cloud.points[:, 2]
    lowest, highest = cell_spans(cloud.points, cell_m)
    bottom = np.minimum(lowest, 0.0)
    rises = (highest - lowest > span_m) & (heights - bottom > span_m / 2)
    mask: np.ndarray = (heights < ceiling_m) & ((heights > clear_m) | rises)
    return mask


def cell_spans(points: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest z in the cell of each of (N, 3) points."""
    if not len(points):
        return np.empty(0), np.empty(0)
    x, y = (np.floor(points[:, axis] / cell_m).astype(np.int64) for axis in range(2))
    x -= x.min()
    y -= y.min()
    width = y.max() + 1
    cell = x * width + y
    if (x.max() + 1.0) * width > MOST_CELLS:
        cell = np.unique(cell, return_inverse=True)[1]
    return _spans(np.ascontiguousarray(points[:, 2]), cell, int(cell.max()) + 1)


@compiled()
def _spans(heights: np.ndarray, cell: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest of the (N,) heights that share a cell with each."""
    bounds = np.empty((cells, 2))
    bounds[:, 0], bounds[:, 1] = np.inf, -np.inf
    for row in range(len(heights)):
        span, height = bounds[cell[row]], heights[row]
        span[0], span[1] = min(span[0], height), max(span[1], height)
    lowest, highest = np.empty(len(heights)), np.empty(len(heights))
    for row in range(len(heights)):
        lowest[row], highest[row] = bounds[cell[row]]
    return lowest, highest
