import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from roadscope.core import Category
from roadscope.trackers.gating import (
    barred,
    centre_distances,
    chi_square_gate,
    gated_distances,
    same_family,
)
from roadscope.trackers.kalman import mahalanobis_squared

seeds = st.integers(0, 2**32 - 1)


def test_families():
    one = np.array([Category.CAR, Category.PEDESTRIAN], np.int8)
    other = np.array([Category.TRUCK, Category.CYCLIST, Category.PEDESTRIAN], np.int8)
    assert same_family(one, other).tolist() == [[True, False, False], [False, False, True]]
    for a in Category:
        for b in Category:
            pair = same_family(np.array([a]), np.array([b]))
            assert pair.item() == (a.family is b.family)


def test_barred_pairs_cost_infinity():
    assert barred(np.ones((1, 2)), np.array([[True, False]])).tolist() == [[1, np.inf]]


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
    np.testing.assert_allclose(gated_distances(expected, covariances, measured, gate), slow)


@given(seed=seeds, gate=st.floats(0.1, 10.0))
def test_centre_distances_equal_the_slow_way(seed, gate):
    rng = np.random.default_rng(seed)
    one, other = (rng.uniform(-5, 5, (n, 2)) for n in rng.integers(0, 6, 2))
    slow = np.linalg.norm(one[:, None] - other, axis=2)
    slow[slow >= gate] = np.inf
    np.testing.assert_allclose(centre_distances(one, other, gate), slow)
