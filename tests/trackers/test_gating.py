import numpy as np
import pytest
from dense_costs import candidates, matrix
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2
from slow_kalman import mahalanobis_squared

from roadscope.core import Category
from roadscope.trackers.gating import (
    candidates_by_distance,
    candidates_by_likelihood,
    chi_square_gate,
    neighbours,
)

seeds = st.integers(0, 2**32 - 1)


def test_families():
    one = np.array([Category.CAR, Category.PEDESTRIAN], np.int8)
    other = np.array([Category.TRUCK, Category.CYCLIST, Category.PEDESTRIAN], np.int8)
    kept = candidates(np.ones((2, 3))).within_families(one, other)
    assert (kept.rows.tolist(), kept.columns.tolist()) == ([0, 1], [0, 2])
    for a in Category:
        for b in Category:
            pair = candidates(np.ones((1, 1))).within_families(np.array([a]), np.array([b]))
            assert len(pair) == (a.family is b.family)


@given(seed=seeds, reach=st.floats(0.1, 8.0))
def test_neighbours_are_found_in_order(seed, reach):
    rng = np.random.default_rng(seed)
    one, other = (np.round(rng.uniform(-5, 5, (n, 2))) for n in rng.integers(0, 9, 2))
    reaches = rng.uniform(0, reach, (len(one), 2))
    apart = np.abs(one[:, None] - other)
    rows, columns = np.nonzero((apart < reaches[:, None]).all(axis=2))
    found = neighbours(one, other, reaches)
    assert (found[0].tolist(), found[1].tolist()) == (rows.tolist(), columns.tolist())


@pytest.mark.parametrize("dimensions", [1, 2, 3, 7])
def test_gate_is_the_quantile_of_chi_square(dimensions):
    assert chi_square_gate(0.99, dimensions) == pytest.approx(chi2.ppf(0.99, dimensions))


@given(seed=seeds, gate=st.floats(0.1, 100.0))
def test_mahalanobis_distances_equal_the_slow_way(seed, gate):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(0, 6, 2)
    expected, measured = rng.uniform(-5, 5, (n, 2)), rng.uniform(-5, 5, (m, 2))
    roots = rng.standard_normal((n, 2, 2))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.05 * np.eye(2)
    slow = mahalanobis_squared(measured - expected[:, None], covariances[:, None])
    slow[slow >= gate] = np.inf
    found = candidates_by_likelihood(expected, covariances, measured, gate)
    np.testing.assert_allclose(matrix(found), slow)


@given(seed=seeds, gate=st.floats(0.1, 10.0))
def test_centre_distances_equal_the_slow_way(seed, gate):
    rng = np.random.default_rng(seed)
    one, other = (rng.uniform(-5, 5, (n, 2)) for n in rng.integers(0, 6, 2))
    slow = np.linalg.norm(one[:, None] - other, axis=2)
    slow[slow >= gate] = np.inf
    found = candidates_by_distance(one, other, np.full(len(one), gate))
    np.testing.assert_allclose(matrix(found), slow)
