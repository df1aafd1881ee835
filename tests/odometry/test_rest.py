"""States of a rest, and the return to them once the sensor has left."""

import numpy as np
import pytest

from roadscope.odometry.inertial import (
    DOUBT_M,
    NEAR_M,
    ImuInterval,
    InertialNoise,
    InertialTrack,
    RestHistory,
    matched_with_prediction,
    started,
)
from roadscope.odometry.voxels import VoxelMap

GRAVITY = np.array([0, 0, 9.81])
NOISE = InertialNoise()
LEAVES_S = 3.0


def stretch(rng, start_s, bias):
    """A tenth of a second among those of a rest that ends gently."""
    stamps = start_s + np.arange(40) / 400
    forces = GRAVITY + bias + 0.045 * rng.standard_normal((40, 3))
    forces[:, 0] += pull(stamps)
    return ImuInterval(0.1, np.full(40, 1 / 400), np.zeros((40, 3)), forces, None)


def pull(stamps):
    return 0.05 * np.maximum(stamps - LEAVES_S, 0.0) ** 2


def left_rest(seed, *, noticing):
    """Follow an accelerometer until it is noticed that it left; return track and speed, m/s."""
    rng = np.random.default_rng(seed)
    bias = 0.1 * rng.standard_normal(3)
    state = started(GRAVITY + bias, np.zeros(3), (0.1, 0.1, 0.1), NOISE)
    track, rest = InertialTrack(state, np.zeros(3), NOISE, reach_m=50.0), RestHistory(NOISE)
    track.correct_gravity(GRAVITY + bias)
    for k in range(60):
        each = stretch(rng, 0.1 * k, bias)
        track.predict(each)
        if not rest.may_continue(each, 0.1 * (k + 1)):
            break
        track.correct_at_rest(np.zeros(3))
        rest.add(track, each)
    assert LEAVES_S < 0.1 * (k + 1) < LEAVES_S + 1.5
    if noticing:
        rest.end(track, each, 0.1 * (k + 1))
    return track, rest, 0.05 * (0.1 * (k + 1) - LEAVES_S) ** 3 / 3


@pytest.mark.parametrize("seed", range(5))
def test_a_rest_that_lasted_too_long_is_undone(seed):
    track, rest, speed_m_s = left_rest(seed, noticing=True)
    spread = np.sqrt(track.state.covariance[6, 6])
    assert spread < 0.02
    assert abs(track.state.velocity[0] - speed_m_s) < 3 * spread
    assert rest.is_empty


def test_an_acceleration_during_a_rest_is_learned_as_a_bias():
    """The reason: the error is far outside of the filter's covariance."""
    off = []
    for seed in range(5):
        track, _, speed_m_s = left_rest(seed, noticing=False)
        off.append((track.state.velocity[0] - speed_m_s) / np.sqrt(track.state.covariance[6, 6]))
    assert np.mean(off) < -1.5


def test_a_sensor_that_has_just_left_is_not_at_rest_again():
    rng = np.random.default_rng(0)
    _, rest, _ = left_rest(0, noticing=True)
    assert not rest.may_continue(stretch(rng, 0.0, np.zeros(3)), 4.5)
    assert rest.may_continue(stretch(rng, 0.0, np.zeros(3)), 9.0)


def test_the_map_is_uncertain_until_it_is_measured_from_elsewhere():
    track, rest, _ = left_rest(0, noticing=False)
    assert rest.doubt_m(track) == 0.0
    rest.end(track, stretch(np.random.default_rng(0), 0.0, np.zeros(3)), 4.5)
    assert rest.doubt_m(track) == DOUBT_M
    track.state.pose[0, 3] += NEAR_M + 0.5
    assert rest.doubt_m(track) == 0.0


def test_a_common_motion_adds_to_the_horizontal_error_of_a_match():
    rng = np.random.default_rng(0)
    points = rng.uniform(-8, 8, (6000, 3)) * (1, 1, 0.2)
    wall = rng.integers(0, 3, 6000)
    points[np.arange(6000), wall] = np.array([8.3, 8.3, -1.7])[wall]
    voxel_map = VoxelMap(reach_m=50.0)
    voxel_map.add(points + 0.01 * rng.standard_normal(points.shape), np.zeros(3))
    here, prior = points[::20], 0.01 * np.eye(6)
    sure, doubted = (
        matched_with_prediction(voxel_map.voxels, here, np.eye(4), prior, doubt_m=each)
        for each in (0.0, 0.3)
    )
    error = np.linalg.inv(doubted.information) - np.linalg.inv(sure.information)
    assert error[:2, :2] == pytest.approx(0.09 * np.eye(2), abs=1e-3)
    assert np.abs(error[2:, 2:]).max() < 1e-3
