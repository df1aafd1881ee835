"""The speed integrated since a rest, a lower bound of the speed."""

import numpy as np
import pytest
from toy_drive import ToyDrive

from roadscope.odometry import ODOMETRIES
from roadscope.odometry.inertial import (
    LEAST_M_S,
    ImuInterval,
    InertialNoise,
    InertialStart,
    InertialTrack,
    IntegratedSpeed,
    Speed,
    SpeedCheck,
    started,
)

GRAVITY = np.array([0, 0, 9.81])
NOISE = InertialNoise()
BIAS = np.array([0.15, -0.1, 0.05])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def stretch(pull_m_s2, rng, samples=40):
    forces = GRAVITY + BIAS + [pull_m_s2, 0, 0] + 0.05 * rng.standard_normal((40, 3))
    rates = 0.002 + 0.005 * rng.standard_normal((40, 3))
    return ImuInterval(0.1, np.full(samples, 1 / 400), rates[:samples], forces[:samples], None)


def rested(rng):
    """A state after two seconds of rest, in which biases were learned."""
    state = started(GRAVITY + BIAS, np.zeros(3), (0.1, 0.1, 0.1), NOISE)
    track = InertialTrack(state, np.zeros(3), NOISE, reach_m=50.0)
    track.correct_gravity(GRAVITY + BIAS)
    for _ in range(20):
        track.predict(stretch(0.0, rng))
        track.correct_at_rest(np.full(3, 0.002))
    return track.state


@pytest.fixture
def felt(rng):
    integrated = IntegratedSpeed(NOISE)
    integrated.start_from_rest(rested(rng))
    return integrated


def test_the_gained_speed_is_right_with_any_biases(felt, rng):
    for k in range(200):
        felt.predict(stretch(1.0 if k < 100 else 0.0, rng))
    assert felt.gained_m_s == pytest.approx(10.0, abs=1.0)
    assert 10.0 - 4.0 < felt.least_m_s < 10.0 - LEAST_M_S / 2


def test_before_a_rest_and_after_a_gap_the_speed_is_unknown(felt, rng):
    assert IntegratedSpeed(NOISE).least_m_s == -np.inf
    felt.predict(stretch(1.0, rng))
    assert np.isfinite(felt.least_m_s)
    felt.predict(stretch(1.0, rng, samples=0))
    assert felt.least_m_s == felt.gained_m_s == -np.inf


def test_the_initial_state_is_not_changed(rng):
    state = rested(rng)
    before = state.velocity.copy()
    felt = IntegratedSpeed(NOISE)
    felt.start_from_rest(state)
    felt.predict(stretch(3.0, rng))
    assert np.array_equal(state.velocity, before)


def driven(odometry, drive, scans):
    return [odometry.update(drive.scan(k), drive.imu(k)) for k in scans]


@pytest.fixture
def after_a_rest():
    """Return a drive and an odometry that has followed it, and that felt it gain its speed."""
    drive, odometry = ToyDrive(), ODOMETRIES.make("lidar-inertial")
    driven(odometry, drive, range(12))
    odometry._integrated_speed.start_from_rest(
        started(GRAVITY, np.array([8.0, 0, 0]), (0.1, 0.1, 0.1), NOISE)
    )
    return drive, odometry


def test_traffic_that_moves_along_does_not_mislead_after_a_rest(after_a_rest):
    drive, odometry = after_a_rest
    track = odometry._track
    odometry._check.measure = lambda *_: Speed(0.4, 2.0, by_fixtures=True)
    driven(odometry, drive, range(12, 40))
    assert odometry._track is track
    assert track.twist()[0] == pytest.approx(8.0, abs=0.2)


def test_a_speed_below_the_integrated_one_causes_a_restart(after_a_rest):
    drive, odometry = after_a_rest
    wrong = odometry._track
    wrong.state.velocity = np.zeros(3)
    estimates = driven(odometry, drive, range(12, 17))
    assert {each.reason for each in estimates} == {"the speed is below the integrated acceleration"}
    assert odometry._track is None
    odometry._start = InertialStart(
        NOISE, is_restart=True, search=lambda *_: Speed(0.0, 2.0, by_fixtures=True)
    )
    odometry._check = SpeedCheck(measure=lambda *_: Speed(0.0, 0.0))
    estimates = driven(odometry, drive, range(17, 30))
    assert odometry._track is not wrong
    assert odometry._track.twist()[0] == pytest.approx(8.0, abs=0.3)
    assert not estimates[-1].ok
