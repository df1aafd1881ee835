import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.trackers.jpda_loopy import loopy_marginals
from roadscope.trackers.jpda_marginals import EXACT_LIMIT
from roadscope.trackers.jpda_marginals import association_marginals as marginals_of_pairs


def association_marginals(pairs, missed, free, limit):
    """(N, M) marginals of (N, M) weights, 0 where impossible."""
    rows, columns = map(np.ascontiguousarray, np.nonzero(pairs))
    found = np.zeros(pairs.shape)
    found[rows, columns] = marginals_of_pairs(
        rows, columns, pairs[rows, columns], (missed, free), limit
    )
    return found


def by_enumeration(pairs, missed, free):
    """Go through every joint event."""
    n, m = pairs.shape
    found, total = np.zeros((n, m)), 0.0

    def visit(i, weight, taken):
        nonlocal total
        if i == n:
            weight *= np.prod([free[j] for j in range(m) if j not in taken.values()])
            total += weight
            for row, column in taken.items():
                found[row, column] += weight
            return
        visit(i + 1, weight * missed[i], taken)
        for j in range(m):
            if pairs[i, j] > 0 and j not in taken.values():
                visit(i + 1, weight * pairs[i, j], {**taken, i: j})

    visit(0, 1.0, {})
    return found / total


weights = st.one_of(st.just(0.0), st.floats(1e-6, 1e6), st.sampled_from([1e-12, 1.0, 1e12]))
alone = st.one_of(st.floats(1e-3, 10), st.sampled_from([1e-9, 1.0, 1e9]))


@st.composite
def problems(draw):
    n, m = draw(st.integers(0, 5)), draw(st.integers(0, 6))
    return (
        draw(arrays(float, (n, m), elements=weights)),
        draw(arrays(float, n, elements=alone)),
        draw(arrays(float, m, elements=alone)),
    )


@settings(max_examples=300)
@given(problems())
def test_equals_enumeration_of_all_joint_events(problem):
    expected = by_enumeration(*problem) if problem[0].size else problem[0]
    np.testing.assert_allclose(association_marginals(*problem, np.inf), expected, atol=1e-9)


def gated(seed, n, m, span_m):
    """Tracks and detections strewn over a line, those nearer than 3 m possible pairs."""
    rng = np.random.default_rng(seed)
    apart = rng.uniform(0, span_m, (n, 1)) - rng.uniform(0, span_m, m)
    pairs = np.where(np.abs(apart) < 3, 30 * np.exp(-0.5 * apart**2), 0.0)
    return pairs, rng.uniform(0.05, 0.9, n), rng.uniform(0.5, 2, m)


@pytest.mark.parametrize("seed", range(8))
def test_clusters_and_chains_equal_enumeration(seed):
    problem = gated(seed, 7, 7, 12.0)
    expected = by_enumeration(*problem)
    np.testing.assert_allclose(association_marginals(*problem, np.inf), expected, atol=1e-9)


def test_a_track_that_cannot_be_missed():
    pairs = np.array([[2.0, 1.0], [1.0, 0.0]])
    missed, free = np.array([0.0, 1.0]), np.ones(2)
    found = association_marginals(pairs, missed, free, np.inf)
    np.testing.assert_allclose(found, by_enumeration(pairs, missed, free), atol=1e-12)
    assert found[0].sum() == pytest.approx(1)


def test_twelve_in_one_crowd_have_the_marginals_that_symmetry_gives():
    n = 12
    found = association_marginals(
        np.ones((n, n)), np.full(n, 1e-12), np.full(n, 1e-12), EXACT_LIMIT
    )
    np.testing.assert_allclose(found, 1 / n, atol=1e-9)


def test_rows_and_columns_may_change_places():
    pairs, missed, free = gated(1, 14, 9, 10.0)
    found = association_marginals(pairs, missed, free, np.inf)
    turned = association_marginals(np.ascontiguousarray(pairs.T), free, missed, np.inf)
    np.testing.assert_allclose(found, turned.T, atol=1e-12)


def test_a_long_chain_neither_overflows_nor_takes_the_loopy_way():
    n = 200
    pairs = 1e9 * (np.eye(n) + np.eye(n, k=1))
    found = association_marginals(pairs, np.full(n, 1e-3), np.ones(n), EXACT_LIMIT)
    exact = association_marginals(pairs, np.full(n, 1e-3), np.ones(n), np.inf)
    assert np.array_equal(found, exact)
    assert found.sum() == pytest.approx(n, abs=0.1)


@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1))
def test_loopy_is_exact_without_loops(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    pairs = rng.exponential(10, (n, n)) * (np.eye(n) + np.eye(n, k=1))
    missed, free = rng.uniform(0.05, 1, n), rng.uniform(0.5, 2, n)
    found = association_marginals(pairs, missed, free, np.inf)
    np.testing.assert_allclose(loopy_marginals(pairs, missed, free), found, atol=1e-6)


def test_loopy_is_near_where_targets_compete():
    """The bounds that `jpda_loopy` states."""
    errors = []
    for seed in range(200):
        problem = gated(seed, 8, 8, 10.0)
        exact = association_marginals(*problem, np.inf)
        errors.append(np.abs(association_marginals(*problem, 0.0) - exact).max())
    assert max(errors) < 0.3
    assert np.mean(errors) < 0.06
    assert max(errors) > 1e-4
