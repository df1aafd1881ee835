import numpy as np
import pytest
import slow_kalman
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from roadscope.trackers.kalman import Gaussians, corrected, predicted, weighed

D, M, N = 4, 2, 7


def random_covariance(rng, size):
    root = rng.standard_normal((size, size))
    return root @ root.T + 0.1 * np.eye(size)


@pytest.fixture
def setting():
    rng = np.random.default_rng(3)
    beliefs = Gaussians(
        rng.standard_normal((N, D)), np.array([random_covariance(rng, D) for _ in range(N)])
    )
    F, H = rng.standard_normal((D, D)), rng.standard_normal((M, D))
    Q, R = random_covariance(rng, D), random_covariance(rng, M)
    return beliefs, F, Q, H, R, rng.standard_normal((N, M))


def test_equals_filterpy_one_by_one(setting):
    beliefs, F, Q, H, R, measured = setting
    ahead = predicted(beliefs, F, Q)
    after, log_densities = weighed(ahead, measured, H, R)
    for k in range(N):
        one = KalmanFilter(dim_x=D, dim_z=M)
        one.x, one.P = beliefs.means[k].copy(), beliefs.covariances[k].copy()
        one.F, one.Q, one.H, one.R = F, Q, H, R
        one.predict()
        np.testing.assert_allclose(ahead.means[k], one.x, atol=1e-10)
        np.testing.assert_allclose(ahead.covariances[k], one.P, atol=1e-10)
        one.update(measured[k])
        np.testing.assert_allclose(after.means[k], one.x, atol=1e-9)
        np.testing.assert_allclose(after.covariances[k], one.P, atol=1e-9)
        likelihood = multivariate_normal(np.zeros(M), one.S).logpdf(one.y)
        assert log_densities[k] == pytest.approx(likelihood)


@given(st.integers(0, 2**32 - 1), st.sampled_from([(4, 2), (6, 2), (10, 7), (3, 3)]))
def test_equals_the_slow_way(seed, sizes):
    """The slow way has Joseph's form; noise from a hundredth to a hundred times the belief's."""
    (D, M), rng = sizes, np.random.default_rng(seed)
    n = int(rng.integers(0, 4))
    beliefs = Gaussians(
        rng.standard_normal((n, D)),
        np.array([random_covariance(rng, D) for _ in range(n)]).reshape(n, D, D),
    )
    F = np.eye(D) + 0.1 * np.eye(D, k=2)
    Q, R = random_covariance(rng, D), 10 ** rng.uniform(-2, 2) * random_covariance(rng, M)
    ahead, slow = predicted(beliefs, F, Q), slow_kalman.predicted(beliefs, F, Q)
    H, measured = np.eye(M, D), rng.standard_normal((n, M))
    innovation = slow_kalman.innovations(slow, measured, H, R)
    expected = slow_kalman.updated(slow, innovation, H, R)
    after, log_densities = weighed(ahead, measured, H, R)
    np.testing.assert_allclose(ahead.covariances, slow.covariances, atol=1e-10)
    np.testing.assert_allclose(after.means, expected.means, atol=1e-8)
    np.testing.assert_allclose(after.covariances, expected.covariances, atol=1e-8)
    np.testing.assert_allclose(log_densities, innovation.log_likelihoods, atol=1e-8)
    assert np.array_equal(after.covariances, after.covariances.transpose(0, 2, 1))


def test_noise_of_each_row_is_its_own(setting):
    beliefs, F, Q, H, R, measured = setting
    scale = np.arange(1.0, N + 1)[:, None, None]
    ahead = predicted(beliefs, F * scale, Q * scale)
    after = corrected(ahead, measured, H, R * scale)
    for k in range(N):
        row, own = np.array([k]), scale[k]
        one = predicted(beliefs.select(row), F * own, Q * own)
        alone = corrected(one, measured[row], H, R * own)
        np.testing.assert_allclose(after.means[k], alone.means[0], atol=1e-12)
        np.testing.assert_allclose(after.covariances[k], alone.covariances[0], atol=1e-12)


def test_rows_are_joined_selected_and_replaced(setting):
    beliefs = setting[0]
    rows = np.array([4, 1])
    both = beliefs.joined(beliefs.select(rows))
    assert len(both) == N + 2
    assert np.array_equal(both.means[N:], beliefs.means[rows])
    swapped = beliefs.replaced(rows, beliefs.select(rows[::-1]))
    assert np.array_equal(swapped.means[rows], beliefs.means[rows[::-1]])
    assert np.array_equal(swapped.covariances[0], beliefs.covariances[0])


def test_nothing_to_filter():
    none = Gaussians.empty(D)
    ahead = predicted(none, np.eye(D), np.eye(D))
    assert len(corrected(ahead, np.empty((0, M)), np.eye(M, D), np.eye(M))) == 0
