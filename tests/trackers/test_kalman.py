import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import multivariate_normal

from roadscope.trackers.kalman import Gaussians, innovations, predicted, updated

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
    innovation = innovations(ahead, measured, H, R)
    after = updated(ahead, innovation, H, R)
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
        assert innovation.distances[k] == pytest.approx(one.mahalanobis**2)
        likelihood = multivariate_normal(np.zeros(M), one.S).logpdf(one.y)
        assert innovation.log_likelihoods[k] == pytest.approx(likelihood)


def test_matrices_of_each_row_are_its_own(setting):
    beliefs, F, Q, H, R, measured = setting
    scale = np.arange(1.0, N + 1)[:, None, None]
    ahead = predicted(beliefs, F * scale, Q * scale)
    after = updated(ahead, innovations(ahead, measured, H, R * scale), H, R * scale)
    for k in range(N):
        row, own = np.array([k]), scale[k]
        one = predicted(beliefs.select(row), F * own, Q * own)
        alone = updated(one, innovations(one, measured[row], H, R * own), H, R * own)
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
    H, R = np.eye(M, D), np.eye(M)
    assert len(updated(ahead, innovations(ahead, np.empty((0, M)), H, R), H, R)) == 0
