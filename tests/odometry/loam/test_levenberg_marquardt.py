"""Distances from lines and planes, their derivatives, and the descent."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from roadscope.odometry import exp_se3, exp_so3, log_se3
from roadscope.odometry.loam import Pairs, descend, distances, moved, normal_equations

ALL = np.ones(6, bool)


def pairs_at(rng, truth, lines=60, planes=60, noise_m=0.0):
    """Points, sensor frame, on lines and planes that lie where a motion brings them."""
    count = lines + planes
    places = rng.uniform(-20, 20, (count, 3))
    turns = np.array([exp_so3(v) for v in rng.standard_normal((count, 3))])
    axes = turns[:, :2].copy()
    axes[lines:, 1] = 0.0
    along = turns[:, 2] * rng.uniform(-2, 2, (count, 1))
    along[lines:] += turns[lines:, 1] * rng.uniform(-2, 2, (planes, 1))
    off = noise_m * rng.standard_normal((count, 3))
    points = (places + off - truth[:3, 3]) @ truth[:3, :3]
    return Pairs(points, places + along, axes)


def offsets(pairs, motion):
    """(K, 2) distances along both axes, one pair after the other."""
    placed = pairs.points @ motion[:3, :3].T + motion[:3, 3]
    return np.array(
        [a @ (p - q) for a, p, q in zip(pairs.axes, placed, pairs.anchors, strict=True)]
    )


def stepped(motion, step):
    """A motion shifted and turned along the axes it leads to."""
    whole = motion.copy()
    whole[:3, :3] = exp_so3(step[3:]) @ motion[:3, :3]
    whole[:3, 3] += step[:3]
    return whole


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 9999), size=st.sampled_from([0.0, 1e-9, 1e-3, 1.0, 3.0]))
def test_a_step_shifts_and_turns(seed, size):
    rng = np.random.default_rng(seed)
    motion, step = exp_se3(rng.standard_normal(6)), size * rng.standard_normal(6)
    assert moved(motion, step) == pytest.approx(stepped(motion, step), abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 9999))
def test_equations_are_those_of_numeric_differences(seed):
    rng = np.random.default_rng(seed)
    motion = exp_se3(rng.standard_normal(6))
    pairs, weights = pairs_at(rng, motion, noise_m=0.3), rng.uniform(0, 2, 120)
    weights[::7] = 0.0
    off = offsets(pairs, motion)
    assert distances(pairs, motion) == pytest.approx(np.linalg.norm(off, axis=1))
    jacobian = np.empty((*off.shape, 6))
    for i in range(6):
        small = 1e-5 * np.eye(6)[i]
        ahead, back = stepped(motion, small), stepped(motion, -small)
        jacobian[..., i] = (offsets(pairs, ahead) - offsets(pairs, back)) / 2e-5
    H, b, cost = normal_equations(pairs, weights, motion)
    assert (
        pytest.approx(np.einsum("n,nki,nkj->ij", weights, jacobian, jacobian), rel=1e-6, abs=1e-4)
        == H
    )
    assert b == pytest.approx(np.einsum("n,nki,nk->i", weights, jacobian, off), rel=1e-6, abs=1e-4)
    assert cost == pytest.approx(weights @ (off**2).sum(axis=1))


@pytest.mark.parametrize("kind", [{"lines": 0}, {"planes": 0}, {}])
def test_the_descent_ends_at_scipys_minimum(kind):
    rng = np.random.default_rng(3)
    truth = exp_se3(np.array([0.4, -0.3, 0.1, 0.02, -0.03, 0.05]))
    pairs = pairs_at(rng, truth, noise_m=0.02, **kind)
    weights = rng.uniform(0.2, 2, len(pairs.points))
    minimum = np.eye(4)
    for _ in range(4):
        minimum = descend(pairs, weights, minimum, ALL)
    slow = least_squares(
        lambda x: (np.sqrt(weights)[:, None] * offsets(pairs, stepped(np.eye(4), x))).ravel(),
        np.zeros(6),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    assert minimum == pytest.approx(stepped(np.eye(4), slow.x), abs=1e-6)
    assert np.abs(log_se3(np.linalg.inv(truth) @ minimum)).max() < 0.02


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 9999))
def test_no_step_increases_the_cost(seed):
    rng = np.random.default_rng(seed)
    pairs = pairs_at(rng, exp_se3(rng.standard_normal(6)), noise_m=0.5)
    weights, motion = rng.uniform(0, 1, 120), np.eye(4)
    cost = normal_equations(pairs, weights, motion)[2]
    for _ in range(3):
        motion = descend(pairs, weights, motion, ALL)
        cost, last = normal_equations(pairs, weights, motion)[2], cost
        assert cost <= last


def test_only_free_unknowns_change():
    rng = np.random.default_rng(1)
    truth = exp_se3(np.array([0.2, 0.1, -0.1, 0.01, 0.02, 0.03]))
    pairs = pairs_at(rng, truth)
    free = np.array([False, False, True, True, True, False])
    minimum = descend(pairs, np.ones(120), np.eye(4), free)
    assert minimum[:2, 3].tolist() == [0, 0]
    assert abs(minimum[2, 3]) > 0.01
    # Turned about level axes alone: nothing of the yaw but what two such turns make of one another.
    assert abs(minimum[1, 0] - minimum[0, 1]) < 1e-3
    assert (descend(pairs, np.ones(120), truth, ~ALL) == truth).all()


def test_unknowns_without_pairs_stay():
    rng = np.random.default_rng(2)
    ground = rng.uniform(-10, 10, (50, 3)) * (1, 1, 0)
    axes = np.zeros((50, 2, 3))
    axes[:, 0, 2] = 1.0
    pairs = Pairs(ground - [0, 0, 0.3], ground, axes)
    minimum = descend(pairs, np.ones(50), np.eye(4), ALL)
    assert minimum[2, 3] == pytest.approx(0.3, abs=1e-4)
    assert np.abs(log_se3(minimum)[[0, 1, 3, 4, 5]]).max() < 1e-4
    none = Pairs(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2, 3)))
    assert (descend(none, np.empty(0), np.eye(4), ALL) == np.eye(4)).all()
