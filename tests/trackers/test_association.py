import numpy as np
import pytest
from dense_costs import candidates, matrix
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2
from slow_kalman import mahalanobis_squared
from tracked_scenes import both, boxes

from roadscope.core import Category, box_overlaps_3d
from roadscope.trackers import (
    AssignmentStage,
    assign_greedily,
    assign_in_stages,
    assign_in_turn,
    assign_optimally,
    associate_nearest,
    chi_square_gate,
    components,
    pairs_by_distance,
    pairs_by_likelihood,
    suppressed,
)

seeds = st.integers(0, 2**32 - 1)
sides = st.tuples(st.integers(0, 7), st.integers(0, 7))
costs = sides.flatmap(
    lambda n: arrays(float, n, elements=st.one_of(st.floats(-3, 9), st.integers(0, 3).map(float)))
)
gates = st.sampled_from([0.5, 2.0, 20.0])


def as_dict(pairs):
    rows, columns = pairs
    assert (np.diff(rows) > 0).all()
    assert len(set(columns.tolist())) == len(columns)
    return dict(zip(rows.tolist(), columns.tolist(), strict=True))


@given(costs, gates)
def test_greedy_takes_the_cheapest_of_all_again_and_again(costs, gate):
    left = {(c, i, j) for (i, j), c in np.ndenumerate(costs) if c < gate}
    expected = {}
    while left:
        _, row, column = min(left)
        expected[row] = column
        left = {(c, i, j) for c, i, j in left if i != row and j != column}
    assert as_dict(assign_greedily(costs, gate)) == expected


@given(costs, gates)
def test_in_turn_each_row_takes_its_cheapest_free_column(costs, gate):
    expected = {}
    for row in range(len(costs))[::-1]:
        free = [(c, j) for j, c in enumerate(costs[row]) if c < gate and j not in expected.values()]
        if free:
            expected[row] = min(free)[1]
    turns = np.arange(len(costs))[::-1].copy()
    near = candidates(np.where(costs < gate, costs, np.inf))
    assert as_dict(assign_in_turn(near, turns)) == expected


def test_stages_take_what_is_left():
    costs = np.array([[1.0, 3.0, 9.0], [2.0, 4.0, 1.0]])
    every, high = np.ones(2, bool), np.array([True, False, False])
    first = AssignmentStage(every, high, 5.0)
    pairs = assign_in_stages(candidates(costs), [first, AssignmentStage(every, ~high, 4.0)])
    assert as_dict(pairs) == {0: 0, 1: 2}
    narrow = assign_in_stages(candidates(costs), [first, AssignmentStage(every, ~high, 0.5)])
    assert as_dict(narrow) == {0: 0}


def is_optimal(costs, gate):
    pairs = as_dict(assign_optimally(candidates(costs), gate))
    chosen = [costs[pair] for pair in pairs.items()]
    assert all(cost < gate for cost in chosen)
    gains = np.minimum(costs - gate, 0.0)
    least = gains[linear_sum_assignment(gains)].sum()
    return sum(chosen) - gate * len(chosen) == pytest.approx(least, abs=1e-9)


@given(costs, gates)
def test_optimal_pairs_cost_as_little_as_scipy_finds(costs, gate):
    assert is_optimal(costs, gate)


@pytest.mark.parametrize("shape", [(60, 60), (40, 90), (90, 40)])
def test_optimal_pairs_of_a_crowd(shape):
    rng = np.random.default_rng(shape[0])
    positions = [rng.uniform(0, 30, (n, 2)) for n in shape]
    distances = np.linalg.norm(positions[0][:, None] - positions[1], axis=-1)
    assert all(is_optimal(distances, gate) for gate in (1.0, 4.0, 100.0))


@given(seeds)
def test_components_are_scipys(seed):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 8, 2).tolist()
    rows, columns = rng.integers(0, n, (p := rng.integers(0, 9))), rng.integers(0, m, p)
    labels, count = components(rows, columns, n, m)
    pairs = coo_matrix((np.ones(p), (rows, n + columns)), (n + m, n + m))
    _, expected = connected_components(pairs, directed=False)
    paired = np.zeros(n + m, bool)
    paired[rows] = paired[n + columns] = True
    assert ((labels >= 0) == paired).all()
    same = labels[paired][:, None] == labels[paired]
    assert (same == (expected[paired][:, None] == expected[paired])).all()
    # Numbers are given by first row, none left out.
    _, first = np.unique(labels[:n][labels[:n] >= 0], return_index=True)
    assert len(first) == count
    assert (np.diff(first) > 0).all()


positions = st.integers(0, 7).flatmap(
    lambda n: arrays(float, (n, 2), elements=st.integers(0, 12).map(float))
)


@given(positions, positions, gates)
def test_nearest_takes_the_smallest_distance_of_all_again_and_again(detected, predicted, gate):
    left = {
        (np.hypot(*(d - p)), j, i) for i, d in enumerate(detected) for j, p in enumerate(predicted)
    }
    left, expected = {pair for pair in left if pair[0] < gate}, []
    while left:
        _, j, i = min(left)
        expected.append((i, j))
        left = {pair for pair in left if pair[1] != j and pair[2] != i}
    assert dict(associate_nearest(detected, predicted, gate)) == dict(expected)


def test_families():
    one = np.array([Category.CAR, Category.PEDESTRIAN], np.int8)
    other = np.array([Category.TRUCK, Category.CYCLIST, Category.PEDESTRIAN], np.int8)
    pairs = candidates(np.ones((2, 3))).within_families(one, other)
    assert (pairs.rows.tolist(), pairs.columns.tolist()) == ([0, 1], [0, 2])


@pytest.mark.parametrize("dimensions", [1, 2, 7])
def test_gate_is_the_quantile_of_chi_square(dimensions):
    assert chi_square_gate(0.99, dimensions) == pytest.approx(chi2.ppf(0.99, dimensions))


@given(seed=seeds, gate=st.floats(0.1, 100.0))
def test_pairs_by_likelihood_are_those_of_all_distances(seed, gate):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(0, 6, 2)
    expected, measured = rng.uniform(-5, 5, (n, 2)), rng.uniform(-5, 5, (m, 2))
    roots = rng.standard_normal((n, 2, 2))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.05 * np.eye(2)
    slow = mahalanobis_squared(measured - expected[:, None], covariances[:, None])
    slow[slow >= gate] = np.inf
    pairs = pairs_by_likelihood(expected, covariances, measured, gate)
    np.testing.assert_allclose(matrix(pairs), slow)


@given(seed=seeds, gate=st.floats(0.1, 10.0))
def test_pairs_by_distance_are_those_of_all_distances(seed, gate):
    rng = np.random.default_rng(seed)
    # Rounded, so that there are ties.
    one, other = (np.round(rng.uniform(-5, 5, (n, 2))) for n in rng.integers(0, 9, 2))
    slow = np.linalg.norm(one[:, None] - other, axis=2)
    slow[slow >= gate] = np.inf
    pairs = pairs_by_distance(one, other, np.full(len(one), gate))
    np.testing.assert_allclose(matrix(pairs), slow)
    assert (np.diff(pairs.rows * len(other) + pairs.columns) > 0).all()


@pytest.mark.parametrize("most", [0.0, 0.1, 0.25])
def test_suppression_goes_from_the_highest_score_on(most):
    rng = np.random.default_rng(1)
    crowd = boxes(rng.uniform(0, 10, (30, 2)), 0, rng.random(30), yaws=rng.uniform(-3, 3, 30))
    rows = np.column_stack([crowd.centres, crowd.sizes, crowd.yaws])
    overlaps = box_overlaps_3d(rows, rows)
    stays = []
    for row in np.argsort(-crowd.scores, kind="stable").tolist():
        if all(overlaps[row, other] <= most for other in stays):
            stays.append(row)
    left = suppressed(crowd, most)
    assert left == crowd.select(np.array(sorted(stays)))
    assert 0 < len(left) < 30


def test_suppression_is_within_families():
    scene = both(boxes([(0, 0)], 0, 0.9), boxes([(0, 0)], 0, 0.3, Category.PEDESTRIAN))
    assert len(suppressed(scene, 0.0)) == 2
    assert len(suppressed(boxes([], 0), 0.1)) == 0
