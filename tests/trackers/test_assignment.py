import numpy as np
import pytest
from dense_costs import candidates
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment

from roadscope.trackers.assignment import (
    assign_greedily,
    assign_in_stages,
    assign_in_turn,
    assign_optimally,
    least_total,
)

sides = st.tuples(st.integers(0, 7), st.integers(0, 7))
costs = sides.flatmap(
    lambda n: arrays(float, n, elements=st.one_of(st.floats(-3, 9), st.integers(0, 3).map(float)))
)


@given(costs, st.sampled_from([0.5, 2.0, 20.0]))
def test_greedy_equals_the_slow_way(costs, gate):
    left = {(c, i, j) for (i, j), c in np.ndenumerate(costs) if c < gate}
    expected = {}
    while left:
        _, row, column = min(left)
        expected[row] = column
        left = {(c, i, j) for c, i, j in left if i != row and j != column}
    rows, columns = assign_greedily(costs, gate)
    assert dict(zip(rows.tolist(), columns.tolist(), strict=True)) == expected
    assert (np.diff(rows) > 0).all()


@given(costs, st.sampled_from([0.5, 2.0, 20.0]))
def test_in_turn_equals_the_slow_way(costs, gate):
    expected = {}
    for row in range(len(costs))[::-1]:
        of_row = costs[row]
        free = [(c, j) for j, c in enumerate(of_row) if c < gate and j not in expected.values()]
        if free:
            expected[row] = min(free)[1]
    turns = np.arange(len(costs))[::-1].copy()
    near = candidates(np.where(costs < gate, costs, np.inf))
    rows, columns = assign_in_turn(near, turns)
    assert dict(zip(rows.tolist(), columns.tolist(), strict=True)) == expected


def test_stages_take_what_is_left():
    costs = np.array([[1.0, 3.0, 9.0], [2.0, 4.0, 1.0]])
    every, sure = np.ones(2, bool), np.array([True, False, False])
    rows, columns = assign_in_stages(candidates(costs), [(every, sure, 5.0), (every, ~sure, 4.0)])
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [0, 2])
    narrow = assign_in_stages(candidates(costs), [(every, sure, 5.0), (every, ~sure, 0.5)])
    assert narrow[0].tolist() == [0]


@given(costs, st.sampled_from([0.5, 2.0, 20.0]))
def test_optimal_costs_as_little_as_scipy_finds(costs, gate):
    rows, columns = assign_optimally(candidates(costs), gate)
    assert len(set(columns.tolist())) == len(columns)
    assert (np.diff(rows) > 0).all()
    assert (costs[rows, columns] < gate).all()
    least = np.minimum(costs - gate, 0.0)
    expected = least[linear_sum_assignment(least)].sum()
    assert (costs[rows, columns] - gate).sum() == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("n", "m"), [(60, 60), (40, 90), (90, 40)])
def test_optimal_in_a_crowd(n, m):
    rng = np.random.default_rng(n)
    apart = np.linalg.norm(rng.uniform(0, 30, (n, 1, 2)) - rng.uniform(0, 30, (m, 2)), axis=-1)
    for gate in (1.0, 4.0, 100.0):
        rows, columns = assign_optimally(candidates(apart), gate)
        least = np.minimum(apart - gate, 0.0)
        expected = least[linear_sum_assignment(least)].sum()
        assert (apart[rows, columns] - gate).sum() == pytest.approx(expected, abs=1e-9)
        assert len(rows) > 1


def test_optimal_gives_up_a_cheap_pair_for_a_cheaper_whole():
    costs = np.array([[1.0, 2.0], [2.0, 9.0]])
    assert assign_greedily(costs, 5.0)[1].tolist() == [0]
    assert assign_optimally(candidates(costs), 5.0)[1].tolist() == [1, 0]
    # But two mediocre pairs are worth less than one good one when being alone is cheap.
    assert assign_optimally(candidates(costs), 2.2)[0].tolist() == [0]


@given(sides.flatmap(lambda n: arrays(float, (min(n), max(n)), elements=st.floats(-9, 9))))
def test_least_total_is_scipys(costs):
    chosen = least_total(costs)
    expected = costs[linear_sum_assignment(costs)].sum()
    assert costs[np.arange(len(costs)), chosen].sum() == pytest.approx(expected, abs=1e-9)
