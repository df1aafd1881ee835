"""Grids of evidence, boxes, vehicles' returns and range images are those of slow versions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import wrap_angle
from roadscope.detectors.moving import (
    RULE,
    boxes_in,
    evidence_grid,
    imaged,
    slide,
    sorted_by_body,
    suppress,
    tabulate,
)

SIDES, CELL_M, LIMIT, LEAST = RULE
ORIGIN = np.array([1.0, 0.5])


def places_of(seed, count=80):
    """Returns of a few vehicles and of a wall, some at the same place, some on a cell's edge."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-40, 40, (4, 2))
    points = middles[rng.integers(0, 4, count)] + rng.uniform(-2, 2, (count, 2))
    points[::9] = np.round(points[::9] / CELL_M) * CELL_M
    points[1::13] = points[0]
    points[2::7, 0] = points[5, 0]
    return np.column_stack([points, rng.choice([0.5, 1.0, 1.5], count)]), rng.uniform(-4, 4, count)


def slow_grid(points, weights):
    corner = CELL_M * np.floor(points[:, :2].min(axis=0) / CELL_M)
    cells = ((points[:, :2] - corner) / CELL_M).astype(np.int64)
    wide, deep = cells.max(axis=0) + 1
    flat, row, count = np.unique(
        cells[:, 0] * deep + cells[:, 1], return_inverse=True, return_counts=True
    )
    starts = np.searchsorted(flat, deep * np.arange(wide + 1))
    order = np.lexsort((points[:, 1], points[:, 0]))
    sums = [np.bincount(row[order], v[order]) / count for v in (*points[:, :2].T, weights)]
    return starts, np.column_stack(sums[:2]) - corner, np.clip(sums[2], -LIMIT, LIMIT), corner


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_a_grid_is_that_of_sorted_cells(seed) -> None:
    points, weights = places_of(seed)
    grid, corner = evidence_grid(points, weights, ORIGIN, RULE)
    starts, places, values, slow_corner = slow_grid(points, weights)
    assert np.array_equal(grid.starts, starts)
    assert np.array_equal(grid.places, places)
    assert np.array_equal(grid.weights, values)
    assert np.array_equal(corner, slow_corner)
    assert np.array_equal(grid.origin, ORIGIN - corner)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_boxes_come_best_first_then_by_place(seed) -> None:
    points, weights = places_of(seed)
    weights = np.abs(weights)
    grid, corner = evidence_grid(points, weights, ORIGIN, RULE)
    boxes = slide(grid, SIDES, LEAST)
    boxes = boxes[np.lexsort((boxes[:, 2], boxes[:, 1], boxes[:, 0], -boxes[:, 3]))]
    expected_boxes = boxes[suppress(boxes, grid, SIDES, LEAST)]
    expected_boxes[:, :2] += corner
    compiled_boxes = boxes_in(points, weights, ORIGIN, RULE)
    assert len(compiled_boxes) > 0
    assert np.array_equal(compiled_boxes, expected_boxes)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_returns_are_shared_out_sorted(seed) -> None:
    points, _ = places_of(seed)
    rng = np.random.default_rng(seed)
    rows = np.sort(rng.choice(len(points), 50, replace=False))
    owner = rng.integers(-1, 3, 50)
    sorted_rows, starts = sorted_by_body(points, rows, owner, 4)
    assert starts[-1] == (owner >= 0).sum()
    for body in range(4):
        mine = rows[owner == body]
        mine = mine[np.lexsort(points[mine].T)]
        assert np.array_equal(sorted_rows[starts[body] : starts[body + 1]], mine)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_an_image_is_that_of_numpy(seed) -> None:
    rng = np.random.default_rng(seed)
    ring, column = rng.integers(3, 9, 60), np.sort(rng.integers(5, 70, 60))
    azimuths, tilts = 0.02 * column + rng.normal(0, 1e-4, 60), np.tan(0.05 * (9 - ring))
    reach = rng.uniform(5, 50, 60)
    points = np.column_stack([reach * np.cos(azimuths), reach * np.sin(azimuths), reach * tilts])
    points, times_s = points.astype(np.float32), 1e-3 * column
    image, slopes, azimuth, step, column_times_s = imaged(
        points, ring.astype(np.int16), column.astype(np.int32), times_s
    )
    raw, raw_slopes, looks, raw_times_s = tabulate(
        points, ring - ring.min(), column - column.min(), times_s
    )
    rows = np.argsort(raw_slopes, kind="stable")[: np.isfinite(raw_slopes).sum()]
    finite_columns = np.flatnonzero(np.isfinite(looks))
    assert np.array_equal(image, raw[rows], equal_nan=True)
    assert np.array_equal(slopes, raw_slopes[rows])
    every = np.interp(np.arange(len(looks)), finite_columns, raw_times_s[finite_columns])
    assert np.allclose(column_times_s, every, rtol=0, atol=1e-15)
    slow_step = np.median(wrap_angle(np.diff(looks[finite_columns])) / np.diff(finite_columns))
    off = wrap_angle(looks[finite_columns] - slow_step * finite_columns - looks[finite_columns][0])
    assert step == slow_step
    assert azimuth == looks[finite_columns][0] + np.median(off)
