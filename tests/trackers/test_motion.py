import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.core import Pose
from roadscope.core.pose import wrap_angle
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.motion import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    Start,
    carried,
)

MODELS = [ConstantVelocity(), ConstantAcceleration(), CoordinatedTurn()]
model = pytest.mark.parametrize("motion", MODELS, ids=lambda m: type(m).__name__)
seeds = st.integers(0, 2**32 - 1)


def beliefs(motion, seed=0, n=6):
    rng = np.random.default_rng(seed)
    means = rng.uniform(-3, 3, (n, motion.dimensions))
    roots = rng.standard_normal((n, motion.dimensions, motion.dimensions))
    return Gaussians(means, roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(motion.dimensions))


def same_states(motion, one, other):
    apart = one - other
    if isinstance(motion, CoordinatedTurn):
        apart[:, 2] = wrap_angle(apart[:, 2])
    np.testing.assert_allclose(apart, 0, atol=1e-9)


@model
@given(seed=seeds, first=st.floats(0.0, 1.0), second=st.floats(0.0, 1.0))
def test_two_steps_are_one(motion, seed, first, second):
    means = beliefs(motion, seed).means
    twice = motion.moved(motion.moved(means, first), second)
    same_states(motion, twice, motion.moved(means, first + second))


@model
@given(seed=seeds, dt=st.floats(0.01, 1.0))
def test_jacobian_is_the_derivative(motion, seed, dt):
    means, h = beliefs(motion, seed).means, 1e-6
    F = np.broadcast_to(motion.jacobian(means, dt), (len(means), *[motion.dimensions] * 2))
    for k in range(motion.dimensions):
        step = np.zeros(motion.dimensions)
        step[k] = h
        apart = motion.moved(means + step, dt) - motion.moved(means - step, dt)
        if isinstance(motion, CoordinatedTurn):
            apart[:, 2] = wrap_angle(apart[:, 2])
        np.testing.assert_allclose(F[:, :, k], apart / (2 * h), atol=1e-6)


@pytest.mark.parametrize("motion", MODELS[:2], ids=lambda m: type(m).__name__)
def test_two_short_steps_spread_as_one_long_step(motion):
    start = beliefs(motion)
    twice = carried(motion, carried(motion, start, 0.1), 0.25)
    once = carried(motion, start, 0.35)
    np.testing.assert_allclose(twice.means, once.means, atol=1e-12)
    np.testing.assert_allclose(twice.covariances, once.covariances, atol=1e-12)


def test_a_turn_spreads_almost_as_much_in_two_steps():
    motion = CoordinatedTurn()
    start = Gaussians(np.array([[0.0, 0.0, 0.3, 8.0, 0.2]]), np.zeros((1, 5, 5)))
    twice = carried(motion, carried(motion, start, 0.1), 0.1).covariances
    once = carried(motion, start, 0.2).covariances
    np.testing.assert_allclose(np.diagonal(twice[0])[2:], np.diagonal(once[0])[2:], rtol=1e-6)
    assert np.trace(twice[0][:2, :2]) == pytest.approx(np.trace(once[0][:2, :2]), rel=0.3)


@model
def test_noise_is_that_of_a_white_input(motion):
    """Monte Carlo in forty small steps."""
    rng, n, steps, dt = np.random.default_rng(0), 20_000, 40, 0.5
    start = np.array([1.0, 2.0, 0.4, 3.0, 0.1, -0.2])[: motion.dimensions]
    states = np.tile(start, (n, 1))
    root = np.sqrt(dt / steps)
    for _ in range(steps):
        states = motion.moved(states, dt / steps / 2)
        kick = rng.standard_normal((n, 2)) * root
        if isinstance(motion, CoordinatedTurn):
            kick *= motion.speed_walk, motion.turn_walk
            states[:, 3:] += kick
        else:
            states[:, -2:] += kick
        states = motion.moved(states, dt / steps / 2)
    nothing = Gaussians(start[None], np.zeros((1, motion.dimensions, motion.dimensions)))
    expected = carried(motion, nothing, dt).covariances[0]
    drawn = np.cov(states.T)
    scale = np.sqrt(np.outer(np.diag(drawn), np.diag(drawn)))
    allowed = 0.15 if isinstance(motion, CoordinatedTurn) else 0.05
    # Of the turn only what does not depend on the heading wandering meanwhile.
    kept = slice(2, None) if isinstance(motion, CoordinatedTurn) else slice(None)
    assert np.abs((expected - drawn) / scale)[kept, kept].max() < allowed


def test_a_turn_follows_the_circle():
    motion, turn, v = CoordinatedTurn(), 0.5, 10.0
    start = np.array([[0.0, 0.0, 0.0, v, turn]])
    angle = turn * 1.7
    after = motion.moved(start, 1.7)[0]
    radius = v / turn
    assert after[:3] == pytest.approx(
        (radius * np.sin(angle), radius - radius * np.cos(angle), angle)
    )


def test_straight_on_is_no_special_case():
    motion = CoordinatedTurn()
    straight = np.array([[0.0, 0.0, 0.6, 10.0, 0.0]])
    nearly = np.array([[0.0, 0.0, 0.6, 10.0, 1e-9]])
    np.testing.assert_allclose(motion.moved(straight, 0.5), motion.moved(nearly, 0.5), atol=1e-8)
    assert motion.moved(straight, 0.5)[0, :2] == pytest.approx((5 * np.cos(0.6), 5 * np.sin(0.6)))


@model
def test_planar_velocity_is_the_change_of_place(motion):
    start, h = beliefs(motion), 1e-6
    planar = motion.planar(start)
    apart = motion.moved(start.means, h)[:, :2] - motion.moved(start.means, -h)[:, :2]
    np.testing.assert_allclose(planar.means, np.hstack([start.means[:, :2], apart / (2 * h)]),
                               atol=1e-6)  # fmt: skip
    np.testing.assert_allclose(planar.covariances[:, :2, :2], start.covariances[:, :2, :2])


def test_planar_covariance_of_a_turn_is_drawn():
    motion, rng = CoordinatedTurn(), np.random.default_rng(1)
    mean = np.array([1.0, 2.0, 0.7, 8.0, 0.1])
    root = np.diag([0.1, 0.1, 0.02, 0.2, 0.1])
    states = mean + rng.standard_normal((200_000, 5)) @ root
    v, yaw = states[:, 3], states[:, 2]
    drawn = np.cov(np.column_stack([states[:, :2], v * np.cos(yaw), v * np.sin(yaw)]).T)
    planar = motion.planar(Gaussians(mean[None], (root @ root)[None]))
    np.testing.assert_allclose(planar.covariances[0], drawn, atol=5e-4)


@model
@given(seed=seeds)
def test_turning_the_world_turns_the_motion(motion, seed):
    start = beliefs(motion, seed)
    turned = carried(motion, turn(motion, start, 0.9), 0.3)
    expected = turn(motion, carried(motion, start, 0.3), 0.9)
    same_states(motion, turned.means, expected.means)
    np.testing.assert_allclose(turned.covariances, expected.covariances, atol=1e-9)


def turn(motion, start, angle):
    rotation = Pose.planar(0, 0, angle).rotation[:2, :2]
    if isinstance(motion, CoordinatedTurn):
        T = np.eye(5)
        T[:2, :2] = rotation
        means = start.means @ T.T + np.array([0, 0, angle, 0, 0])
    else:
        T = np.kron(np.eye(motion.dimensions // 2), rotation)
        means = start.means @ T.T
    return Gaussians(means, T @ start.covariances @ T.T)


@model
def test_a_start_stands_still(motion):
    start = motion.started(Start(np.array([[3.0, 4.0]]), np.array([0.5]), 0.4, 9.0))
    planar = motion.planar(start)
    assert planar.means[0].tolist() == [3, 4, 0, 0]
    assert np.diagonal(start.covariances[0])[:2].tolist() == pytest.approx([0.16, 0.16])
    along = np.array([np.cos(0.5), np.sin(0.5)])
    assert along @ planar.covariances[0][2:, 2:] @ along == pytest.approx(81.0)


@model
def test_no_targets(motion):
    none = Gaussians.empty(motion.dimensions)
    assert len(carried(motion, none, 0.1)) == 0
    assert motion.planar(none).covariances.shape == (0, 4, 4)
