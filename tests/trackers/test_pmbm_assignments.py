import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.trackers.pmbm_assignments import best_assignments
from roadscope.trackers.pmbm_hypotheses import continued


def all_assignments(costs):
    """Every assignment with its total, cheapest first."""
    n, m = costs.shape
    found = []

    def visit(i, total, chosen):
        if i == n:
            found.append((total, chosen))
            return
        visit(i + 1, total, (*chosen, -1))
        for j in range(m):
            if costs[i, j] < np.inf and j not in chosen:
                visit(i + 1, total + costs[i, j], (*chosen, j))

    visit(0, 0.0, ())
    return sorted(found)


sides = st.tuples(st.integers(1, 4), st.integers(0, 4))
elements = st.one_of(st.just(np.inf), st.floats(-20, 20), st.integers(-2, 2).map(float))
some_costs = sides.flatmap(lambda shape: arrays(float, shape, elements=elements))


@settings(max_examples=150)
@given(some_costs, st.integers(1, 300))
def test_best_are_those_that_enumeration_finds(costs, count):
    expected = all_assignments(costs)[:count]
    columns, totals = best_assignments(costs, count, np.inf)
    np.testing.assert_allclose(totals, [total for total, _ in expected], atol=1e-9)
    assert len({tuple(row) for row in columns.tolist()}) == len(columns)
    for row, total in zip(columns, totals, strict=True):
        rows = np.flatnonzero(row >= 0)
        assert len(set(row[rows].tolist())) == len(rows)
        assert costs[rows, row[rows]].sum() == pytest.approx(total, abs=1e-9)


@given(some_costs)
def test_gap_leaves_out_what_is_dearer_and_nothing_else(costs):
    expected = all_assignments(costs)
    near = [total for total, _ in expected if total <= expected[0][0] + 5]
    # A total just at the gap may fall on either side.
    if min((abs(t - expected[0][0] - 5) for t, _ in expected), default=1) > 1e-9:
        np.testing.assert_allclose(best_assignments(costs, 1000, 5.0)[1], near, atol=1e-9)


@pytest.mark.parametrize("gap", [np.inf, 6.0])
@pytest.mark.parametrize("seed", range(6))
def test_hypotheses_go_on_as_enumeration_of_each_says(seed, gap):
    """Three hypotheses of four tracks, which split into groups and agree on some."""
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((8, 4)) < 0.5, rng.uniform(-6, 6, (8, 4)), np.inf)
    members = np.array([[0, 2, 4, 6], [1, 2, 4, -1], [0, 3, -1, 7]])
    log_weights = np.log([0.5, 0.3, 0.2])
    expected = []
    for h, member in enumerate(members):
        rows = np.where(member[:, None] >= 0, costs[member], np.inf)
        each = all_assignments(rows)
        expected += [
            (h, columns, log_weights[h] - total)
            for total, columns in each
            if total <= each[0][0] + gap
        ]
    parents, columns, weights = continued(members, log_weights, costs, 10**4, gap)
    found = {
        (h, tuple(row)): weight
        for h, row, weight in zip(parents.tolist(), columns.tolist(), weights, strict=True)
    }
    assert len(found) == len(parents) == len(expected)
    for h, row, weight in expected:
        assert found[h, row] == pytest.approx(weight, abs=1e-9)


def test_count_is_shared_by_weight():
    costs = np.zeros((2, 6))
    members, log_weights = np.array([[0], [1]]), np.log([0.8, 0.2])
    parents, _, _ = continued(members, log_weights, costs, 5, np.inf)
    assert np.bincount(parents).tolist() == [4, 1]
