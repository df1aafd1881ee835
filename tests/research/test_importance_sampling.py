import numpy as np
import pytest

from research.importance_sampling import sampled_posterior


def test_a_normal_posterior_comes_back():
    mean, covariance = np.array([1.0, -2.0, 0.5]), np.diag([0.1, 0.02, 1.0]) ** 2
    covariance[0, 1] = covariance[1, 0] = 0.8 * 0.1 * 0.02
    information = np.linalg.inv(covariance)

    def log_density(x):
        return -0.5 * np.einsum("ni,ij,nj->n", x - mean, information, x - mean)

    posterior_mean, spread, share = sampled_posterior(log_density, np.zeros(3), 4.0 * np.eye(3))
    assert posterior_mean == pytest.approx(mean, abs=0.05)
    assert np.diag(spread) == pytest.approx(np.diag(covariance), rel=0.15)
    assert share > 0.3


def test_bounds_count_as_information():
    """A box has no slope inside; its variance is the width squared over twelve."""

    def log_density(x):
        beyond = np.maximum(np.abs(x - (0.3, 0.0)) - (0.05, 1.0), 0.0).max(axis=1)
        return np.where(beyond > 0, -60.0 - 100.0 * beyond, 0.0)

    posterior_mean, spread, _ = sampled_posterior(log_density, np.zeros(2), np.eye(2), draws=4096)
    assert posterior_mean == pytest.approx([0.3, 0.0], abs=0.05)
    assert np.sqrt(np.diag(spread)) == pytest.approx([0.1 / 12**0.5, 2 / 12**0.5], rel=0.1)


def test_the_same_twice():
    def log_density(x):
        return -0.5 * (x**2).sum(axis=1)

    first, second = (sampled_posterior(log_density, np.ones(5), np.eye(5)) for _ in range(2))
    assert np.array_equal(first[1], second[1])
