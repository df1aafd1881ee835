import numpy as np
import pytest

from roadscope.trackers.constant_velocity import (
    ConstantVelocityFilter,
    Noise,
    initial_covariance,
    process_noise,
    transition,
)

T = 0.08
A = np.array([[1, T, 0, 0], [0, 1, 0, 0], [0, 0, 1, T], [0, 0, 0, 1]])
H = np.array([[1, 0, 0, 0], [0, 0, 1, 0]])


def printed_p(sigma_p):
    """Eq. 14 entry by entry."""
    a, b, c = sigma_p**2, sigma_p**2 / T, 2 * sigma_p**2 / T**2
    return np.array([[a, b, 0, 0], [b, c, 0, 0], [0, 0, a, b], [0, 0, b, c]])


def test_matrices_are_eq_12_and_14():
    assert np.allclose(transition(T), A)
    assert np.allclose(initial_covariance(0.5, T), printed_p(0.5))


def test_equals_the_printed_recursion():
    """Eq. 8 to 11 and 16, written out, against filterpy with Q at 0."""
    rng = np.random.default_rng(0)
    places = rng.normal(size=(30, 2)) + np.arange(30)[:, None]
    kalman = ConstantVelocityFilter(Noise(0.5, 0.2, 0.0), places[0], np.zeros(2), T)
    x, P, R = np.array([places[0, 0], 0, places[0, 1], 0]), printed_p(0.5), 0.04 * np.eye(2)
    for z in places[1:]:
        kalman.predict(T)
        kalman.update(z)
        x, P = A @ x, A @ P @ A.T
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), (np.eye(4) - K @ H) @ P
    assert np.allclose(kalman.position, x[[0, 2]])
    assert np.allclose(kalman.velocity, x[[1, 3]])
    assert np.allclose(kalman.covariance, P[np.ix_([0, 2, 1, 3], [0, 2, 1, 3])], atol=1e-9)


def test_without_process_noise_the_gain_dies_and_with_it_lives():
    still, alive = (
        ConstantVelocityFilter(Noise(0.5, 0.2, a), np.zeros(2), np.zeros(2), T) for a in (0.0, 2.0)
    )
    for kalman in (still, alive):
        for _ in range(200):
            kalman.predict(T)
            kalman.update(np.zeros(2))
        kalman.update(np.array([1.0, 0.0]))
    assert still.position[0] < 0.05
    assert alive.position[0] > 0.15


def test_process_noise_is_that_of_a_held_acceleration():
    rng = np.random.default_rng(0)
    a = 2.0 * rng.standard_normal(200_000)
    drawn = np.cov(np.stack([a * T**2 / 2, a * T]))
    assert np.allclose(process_noise(2.0, T)[:2, :2], drawn, rtol=0.02)
    assert not process_noise(0.0, T).any()


def test_velocity_can_be_learnt_later():
    kalman = ConstantVelocityFilter(Noise(0.5, 0.2, 0.0), np.zeros(2), np.zeros(2), T)
    kalman.velocity = np.array([10.0, -5.0])
    kalman.predict(T)
    assert kalman.position == pytest.approx((0.8, -0.4))
