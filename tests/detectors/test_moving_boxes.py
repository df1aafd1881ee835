"""Boxes over a map of evidence are those of a slow search that tries every turn."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.detectors.moving import (
    BIN_M,
    BINS,
    DEEP_BINS,
    GAP_BINS,
    STRIDE,
    TURNS,
    BoxSides,
    EvidenceGrid,
    slide,
)

CELL_M, LEAST = 0.25, 3.0
SIDES = BoxSides(2.7, 1.3, 0.75, 0.75)


def some_grid(seed):
    """Clumps of evidence for and against, one place a cell, by x, then y."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(2, 14, (3, 2))[rng.integers(0, 3, 40)]
    cells = np.unique((around + rng.normal(0, 1.0, (40, 2))).clip(0) // CELL_M, axis=0)
    cells -= cells.min(axis=0)
    places = CELL_M * (cells + rng.uniform(0.01, 0.99, cells.shape))
    weights = rng.uniform(-2.0, 3.0, len(cells))
    starts = np.searchsorted(cells[:, 0], np.arange(cells[-1, 0] + 2))
    return EvidenceGrid(starts, places, weights, np.array([-9.0, 4.0]), CELL_M)


def best_run(weights, slots, gap):
    """Evidence of the run of bins, without a gap, that has most."""
    best, total, last = 0.0, 0.0, None
    for k in sorted(set(slots)):
        total = 0.0 if last is not None and k - last > gap else total
        total, last = total + weights[slots == k].sum(), k
        after = [s for s in slots if s > k]
        if not after or min(after) - k > gap:
            best = max(best, total)
    return best


def slow_score(grid, x, y):
    """Evidence of the best turn of a box about a place."""
    sight = np.array([x, y]) - grid.origin
    sight /= np.hypot(*sight)
    off, best = grid.places - [x, y], 0.0
    across, deep = (
        np.clip((off @ axis / BIN_M + BINS / 2).astype(int), 0, BINS - 1)
        for axis in (np.array([-sight[1], sight[0]]), sight)
    )
    for turn in range(TURNS):
        cos, sin = np.cos(turn * np.pi / TURNS), np.sin(turn * np.pi / TURNS)
        u, v = np.abs(off @ [cos, sin]), np.abs(off @ [-sin, cos])
        long, wide, ends, flanks = SIDES
        inside = (u <= long) & (v <= wide)
        collar = ((u <= long + ends) & (v <= wide)) | ((u <= long) & (v <= wide + flanks))
        against = np.minimum(grid.weights[collar & ~inside], 0.0).sum()
        held = grid.weights[inside]
        runs = best_run(held, across[inside], GAP_BINS), best_run(held, deep[inside], DEEP_BINS)
        best = max(best, min(runs) + against)
    return best


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_boxes_are_those_of_the_slow_search(seed) -> None:
    grid = some_grid(seed)
    score_of = {(x, y): score for x, y, _, score, *_ in slide(grid, SIDES, LEAST)}
    strongest = grid.places[grid.weights > 1.0]
    for x, y in (np.floor(strongest / CELL_M / STRIDE) * STRIDE + 0.5) * CELL_M:
        score = slow_score(grid, x, y)
        assert abs(score_of.get((x, y), 0.0) - (score if score >= LEAST else 0.0)) < 1e-9
