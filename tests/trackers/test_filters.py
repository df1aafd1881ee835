"""The Kalman filter and the motion models."""

import numpy as np
import pytest
import slow_kalman
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from roadscope.core import Pose
from roadscope.trackers import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    Gaussians,
    NewTracks,
    corrected,
    corrected_with_likelihood,
    planar,
    predicted,
    predicted_by_model,
)

seeds = st.integers(0, 2**32 - 1)


def random_covariance(rng, size):
    root = rng.standard_normal((size, size))
    return root @ root.T + 0.1 * np.eye(size)


def random_beliefs(rng, n, D):
    covariances = [random_covariance(rng, D) for _ in range(n)]
    return Gaussians(rng.standard_normal((n, D)), np.reshape(covariances, (n, D, D)))


def test_the_filter_is_filterpys():
    rng = np.random.default_rng(3)
    beliefs = random_beliefs(rng, 3, 4)
    F, H = rng.standard_normal((4, 4)), rng.standard_normal((2, 4))
    Q, R = random_covariance(rng, 4), random_covariance(rng, 2)
    measured = rng.standard_normal((3, 2))
    ahead = predicted(beliefs, F, Q)
    after, log_likelihoods = corrected_with_likelihood(ahead, measured, H, R)
    for k in range(3):
        one = KalmanFilter(dim_x=4, dim_z=2)
        one.x, one.P = beliefs.means[k].copy(), beliefs.covariances[k].copy()
        one.F, one.Q, one.H, one.R = F, Q, H, R
        one.predict()
        np.testing.assert_allclose(ahead.means[k], one.x, atol=1e-10)
        np.testing.assert_allclose(ahead.covariances[k], one.P, atol=1e-10)
        one.update(measured[k])
        np.testing.assert_allclose(after.means[k], one.x, atol=1e-9)
        np.testing.assert_allclose(after.covariances[k], one.P, atol=1e-9)
        expected = multivariate_normal(np.zeros(2), one.S).logpdf(one.y)
        assert log_likelihoods[k] == pytest.approx(expected)


@given(seeds, st.sampled_from([(4, 2), (6, 2), (10, 7), (3, 3)]))
def test_the_filter_is_that_in_plain_numpy(seed, sizes):
    """Joseph's form; each row has noise of its own, 0.01 to 100 times that of the belief."""
    (D, M), rng = sizes, np.random.default_rng(seed)
    n = int(rng.integers(0, 4))
    beliefs = random_beliefs(rng, n, D)
    scale = 10 ** rng.uniform(-2, 2, (n, 1, 1))
    F = np.eye(D) + 0.1 * np.eye(D, k=2) * scale
    Q, R = random_covariance(rng, D) * scale, random_covariance(rng, M) * scale
    ahead, slow = predicted(beliefs, F, Q), slow_kalman.predicted(beliefs, F, Q)
    H, measured = np.eye(M, D), rng.standard_normal((n, M))
    innovation = slow_kalman.innovations(slow, measured, H, R)
    expected = slow_kalman.updated(slow, innovation, H, R)
    after, log_likelihoods = corrected_with_likelihood(ahead, measured, H, R)
    np.testing.assert_allclose(ahead.covariances, slow.covariances, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(after.means, expected.means, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(after.covariances, expected.covariances, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(log_likelihoods, innovation.log_likelihoods, rtol=1e-7, atol=1e-7)
    assert np.array_equal(after.covariances, after.covariances.transpose(0, 2, 1))
    same = corrected(ahead, measured, H, R)
    assert np.array_equal(same.means, after.means)


def test_rows_are_joined_selected_and_replaced():
    beliefs, rows = random_beliefs(np.random.default_rng(0), 7, 4), np.array([4, 1])
    both = beliefs.joined(beliefs.select(rows))
    assert np.array_equal(both.means[7:], beliefs.means[rows])
    swapped = beliefs.replaced(rows, beliefs.select(rows[::-1]))
    assert np.array_equal(swapped.means[rows], beliefs.means[rows[::-1]])
    assert np.array_equal(swapped.covariances[0], beliefs.covariances[0])
    assert len(beliefs.select(np.zeros(7, bool))) == 0


MODELS = [ConstantVelocity(), ConstantAcceleration(), CoordinatedTurn()]
model = pytest.mark.parametrize("motion", MODELS, ids=lambda m: type(m).__name__)


def states(motion, seed=0, n=6):
    beliefs = random_beliefs(np.random.default_rng(seed), n, motion.dimensions)
    return Gaussians(2 * beliefs.means, beliefs.covariances)


@model
@given(seed=seeds, first=st.floats(0.0, 1.0), second=st.floats(0.0, 1.0))
def test_two_steps_are_one(motion, seed, first, second):
    start = states(motion, seed)
    twice = motion.moved(motion.moved(start.means, first), second)
    np.testing.assert_allclose(twice, motion.moved(start.means, first + second), atol=1e-9)
    if not isinstance(motion, CoordinatedTurn):
        halfway = predicted_by_model(motion, start, first)
        spread = predicted_by_model(motion, halfway, second).covariances
        once = predicted_by_model(motion, start, first + second).covariances
        np.testing.assert_allclose(spread, once, atol=1e-9)


@model
@given(seed=seeds, dt=st.floats(0.01, 1.0))
def test_jacobian_is_the_derivative(motion, seed, dt):
    means, h, D = states(motion, seed).means, 1e-6, motion.dimensions
    F = np.broadcast_to(motion.jacobian(means, dt), (len(means), D, D))
    for k in range(D):
        step = h * np.eye(D)[k]
        slope = (motion.moved(means + step, dt) - motion.moved(means - step, dt)) / (2 * h)
        np.testing.assert_allclose(F[:, :, k], slope, atol=1e-6)


@model
def test_noise_is_that_of_a_white_input(motion):
    """Monte Carlo in forty small steps; of a turn only what turning does not change."""
    rng, n, steps, dt = np.random.default_rng(0), 20_000, 40, 0.5
    D, turns = motion.dimensions, isinstance(motion, CoordinatedTurn)
    start = np.array([1.0, 2.0, 3.0, 0.4, 0.0, 0.0])[:D]
    drawn, root = np.tile(start, (n, 1)), np.sqrt(dt / steps)
    for _ in range(steps):
        drawn = motion.moved(drawn, dt / steps / 2)
        if turns:
            walks = np.array([motion.velocity_walk, motion.velocity_walk, motion.turn_walk])
            drawn[:, 2:] += root * walks * rng.standard_normal((n, 3))
        else:
            drawn[:, -2:] += root * rng.standard_normal((n, 2))
        drawn = motion.moved(drawn, dt / steps / 2)
    known = Gaussians(start[None], np.zeros((1, D, D)))
    expected = predicted_by_model(motion, known, dt).covariances[0]
    spread = np.cov(drawn.T)
    scale = np.sqrt(np.outer(np.diag(spread), np.diag(spread)))
    alike = [2, 4] if turns else range(D)
    assert np.abs((expected - spread) / scale)[np.ix_(alike, alike)].max() < 0.05


def test_a_turn_follows_the_circle():
    turn, v, t = 0.5, 10.0, 1.7
    radius, angle = v / turn, turn * t
    after = CoordinatedTurn().moved(np.array([[0.0, 0.0, v, 0.0, turn]]), t)[0]
    expected = [
        radius * np.sin(angle),
        radius * (1 - np.cos(angle)),
        v * np.cos(angle),
        v * np.sin(angle),
        turn,
    ]
    assert after == pytest.approx(expected)
    straight, nearly = (
        CoordinatedTurn().moved(np.array([[0.0, 0.0, 8.0, 6.0, rate]]), 0.5) for rate in (0.0, 1e-9)
    )
    np.testing.assert_allclose(straight, nearly, atol=1e-8)
    assert straight[0, :2] == pytest.approx((4, 3))


@model
@given(seed=seeds)
def test_turning_the_world_turns_the_motion(motion, seed):
    start, D = states(motion, seed), motion.dimensions
    T = np.eye(D)
    for k in range(0, D - 1, 2):
        T[k : k + 2, k : k + 2] = Pose.planar(0, 0, 0.9).rotation[:2, :2]

    def turned(beliefs):
        return Gaussians(beliefs.means @ T.T, T @ beliefs.covariances @ T.T)

    one = predicted_by_model(motion, turned(start), 0.3)
    other = turned(predicted_by_model(motion, start, 0.3))
    np.testing.assert_allclose(one.means, other.means, atol=1e-9)
    np.testing.assert_allclose(one.covariances, other.covariances, atol=1e-9)


@model
def test_new_tracks_are_at_rest(motion):
    start = motion.started(NewTracks(np.array([[3.0, 4.0]]), 0.4, 9.0))
    assert planar(start).means[0].tolist() == [3, 4, 0, 0]
    deviations = np.sqrt(np.diagonal(planar(start).covariances[0]))
    assert deviations.tolist() == pytest.approx([0.4, 0.4, 9, 9])
    none = Gaussians.empty(motion.dimensions)
    assert planar(predicted_by_model(motion, none, 0.1)).covariances.shape == (0, 4, 4)
