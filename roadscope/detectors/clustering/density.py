"""Clustering by density, DBSCAN (Ester et al. 1996; Li 2021, section 3), and by distance alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.disjoint_sets import join, root_of
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.sorting import order_by, starts_of

OUTLIER = -1
"""Label of a return that belongs to no cluster."""
SPAN = 2
"""Two points nearer than the radius lie at most this many cells apart: the diagonal of a cell is
the radius."""


def cluster_dbscan(cloud: Cloud, *, eps_m: float = 1.0, min_points: int = 5) -> np.ndarray:
    """Cluster by DBSCAN in the ground plane.

    Returns (N,) int64 labels, negative for outliers.

    Heights are not used: the layers of one body are far apart at long range (0.8 deg are 1.4 m at
    100 m), while its columns stay close. Labels are those of scikit-learn's DBSCAN on x and y.
    Li 2021 prints no values. `eps_m` is that of the clustering `distance`. `min_points` counts
    the point itself: on a face across the beam at 100 m five columns of the LUX, 0.44 m apart,
    lie within 1 m of the middle one in every layer that meets it.
    """
    if not 0 < eps_m < np.inf:
        raise ValueError(f"eps_m must be a positive length in metres, got {eps_m!r}")
    if not min_points >= 1:
        raise ValueError(f"min_points must be at least 1, got {min_points!r}")
    return density_labels(cloud.points[:, :2], eps_m, min_points)


def cluster_distance(cloud: Cloud, *, distance_m: float = 1.0) -> np.ndarray:
    """Link returns that are at most `distance_m` apart in the ground plane.

    Returns (N,) int64 labels, none negative.

    The comparison method of Lu 2018. 1 m is above the spacing of LUX columns on a face across
    the beam at full range (0.87 m at 200 m) and below the gap between vehicles in neighbouring
    lanes (3.5 m less 1.9 m of width).
    """
    return single_linkage(cloud.points[:, :2], distance_m)


def single_linkage(points: np.ndarray, distance: float) -> np.ndarray:
    """Label the connected components of (N, 2) points linked up to `distance`, (N,) int64.

    points, distance: in the same unit. This is DBSCAN with every point a core point.
    """
    return density_labels(points, distance, 1)


def density_labels(points: np.ndarray, radius: float, min_points: int) -> np.ndarray:
    """Return the (N,) int64 DBSCAN labels of (N, 2) points, the same as scikit-learn's.

    A point is a core point if at least `min_points` points, itself included, are at most `radius`
    away. Core points at most `radius` apart share a cluster. Clusters are numbered by their first
    core point. Another point within the radius of core points joins the lowest of their clusters.
    The rest are `OUTLIER`.
    """
    if not len(points):
        return np.empty(0, np.int64)
    order, cells = _sorted_cells(points, radius)
    limit = float(radius * radius)
    core = _core_points(cells, limit, min_points)
    roots = _joined_cells(cells, core, limit)
    first_rows = np.minimum.reduceat(np.where(core, order, len(points)), cells.starts[:-1])
    first = np.full(len(roots), len(points))
    np.minimum.at(first, roots, first_rows)
    number = np.empty(len(roots), np.int64)
    number[np.argsort(first)] = np.arange(len(roots))
    by_cell = np.where(core, np.repeat(number[roots], np.diff(cells.starts)), OUTLIER)
    if not core.all():
        _join_borders(cells, core, limit, by_cell)
    labels = np.empty(len(points), np.int64)
    labels[order] = by_cell
    return labels


class SquareCells(NamedTuple):
    """Points in the plane, sorted into square cells; two points of a cell are within the radius.

    points: (N, 2) cell by cell. starts: (C + 1,) int64, where each cell begins in them, and N.
    near, counts: (C, 24) and (C,) int64, the other cells that may have points within the radius of
    a cell's points, and their number: the first `counts[c]` entries of row c are valid. low, high:
    (C, 2) bounds of the points of a cell.
    """

    points: np.ndarray
    starts: np.ndarray
    near: np.ndarray
    counts: np.ndarray
    low: np.ndarray
    high: np.ndarray


def _sorted_cells(points: np.ndarray, radius: float) -> tuple[np.ndarray, SquareCells]:
    """Return the order of (N, 2) points by cell, then by row, and the cells."""
    # A little less than the true side, so that rounding keeps two points of a cell in the radius.
    side = radius / np.sqrt(2) * (1 - 1e-9)
    x, y = ((axis - axis.min()) / side for axis in points.T)
    column, row = x.astype(np.int64), y.astype(np.int64)
    order = order_by(row)
    order = order[order_by(column[order])]
    column, row = column[order], row[order]
    starts, ordered = starts_of(column, row), points[order]
    firsts = starts[:-1]
    low, high = (
        np.stack([extreme.reduceat(axis, firsts) for axis in ordered.T], axis=1)
        for extreme in (np.minimum, np.maximum)
    )
    near, counts = _near_cells(np.stack([column[firsts], row[firsts]], axis=1))
    return order, SquareCells(ordered, starts, near, counts, low, high)


@compiled()
def _near_cells(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells within `SPAN` of each of (C, 2) sorted cells, without itself.

    Returns near (C, 24) int64 and counts (C,), as in `SquareCells`.
    """
    width = 2 * SPAN + 1
    size = len(cells)
    near, counts = np.empty((size, width * width - 1), np.int64), np.zeros(size, np.int64)
    heads = np.zeros(width, np.int64)
    for c in range(size):
        for step in range(width):
            x, y = cells[c, 0] + step - SPAN, cells[c, 1] - SPAN
            # Cells are sorted, so the first near cell of the next cell is no earlier one.
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
def _core_points(cells: SquareCells, limit: float, min_points: int) -> np.ndarray:
    """Return which points are core, (N,) bool. limit: the radius squared."""
    points, starts = cells.points, cells.starts
    core = np.zeros(len(points), np.bool_)
    for c in range(len(cells.counts)):
        inside = starts[c + 1] - starts[c]
        for row in range(starts[c], starts[c + 1]):
            neighbours = inside
            for k in range(cells.counts[c]):
                if neighbours >= min_points:
                    break
                other = cells.near[c, k]
                for second in range(starts[other], starts[other + 1]):
                    x = points[row, 0] - points[second, 0]
                    y = points[row, 1] - points[second, 1]
                    neighbours += x * x + y * y <= limit
            core[row] = neighbours >= min_points
    return core


@compiled()
def _joined_cells(cells: SquareCells, core: np.ndarray, limit: float) -> np.ndarray:
    """Join cells whose core points are within the radius; return the root of each cell's set, (C,).

    core: (N,) bool. limit: the radius squared.
    """
    size = len(cells.counts)
    parents = np.arange(size)
    for c in range(size):
        for k in range(cells.counts[c]):
            other = cells.near[c, k]
            if other > c or root_of(parents, c) == root_of(parents, other):
                continue
            if _are_near(cells, core, c, other, limit):
                join(parents, c, other)
    for c in range(size):
        parents[c] = root_of(parents, c)
    return parents


@compiled()
def _are_near(cells: SquareCells, core: np.ndarray, one: int, other: int, limit: float) -> bool:
    """Return whether two cells have core points within the radius of each other."""
    points, starts = cells.points, cells.starts
    low_x, low_y = cells.low[other]
    high_x, high_y = cells.high[other]
    for row in range(starts[one], starts[one + 1]):
        if not core[row]:
            continue
        x, y = points[row, 0], points[row, 1]
        off_x, off_y = max(low_x - x, x - high_x, 0.0), max(low_y - y, y - high_y, 0.0)
        if off_x * off_x + off_y * off_y > limit:
            continue
        for second in range(starts[other], starts[other + 1]):
            if core[second]:
                dx, dy = x - points[second, 0], y - points[second, 1]
                if dx * dx + dy * dy <= limit:
                    return True
    return False


@compiled()
def _join_borders(cells: SquareCells, core: np.ndarray, limit: float, labels: np.ndarray) -> None:
    """Give border points the lowest label of the core points within the radius, in place.

    core: (N,) bool. limit: the radius squared. labels: (N,) int64, so far those of core points.
    """
    points, starts = cells.points, cells.starts
    for c in range(len(cells.counts)):
        for row in range(starts[c], starts[c + 1]):
            if core[row]:
                continue
            best = np.int64(len(points))
            for k in range(-1, cells.counts[c]):
                other = c if k < 0 else cells.near[c, k]
                for second in range(starts[other], starts[other + 1]):
                    if core[second] and labels[second] < best:
                        x = points[row, 0] - points[second, 0]
                        y = points[row, 1] - points[second, 1]
                        if x * x + y * y <= limit:
                            best = labels[second]
            if best < len(points):
                labels[row] = best
