"""Checks of the estimated speed by fixtures."""

from dataclasses import replace

import numpy as np
import pytest
from toy_drive import ToyDrive

from roadscope.odometry import ODOMETRIES
from roadscope.odometry.inertial import (
    BELIEVED_S,
    FAR_M_S,
    SCANS,
    SLOW_M_S,
    InertialNoise,
    InertialTrack,
    Speed,
    SpeedCheck,
    resume,
    started,
)

HELD_M_S = 11.0


def answers(*looks, hidden_acceleration_m_s2=100.0, least_m_s=-np.inf):
    """Return the answers of a check to consecutive measurements, one each second, m/s."""
    measured = iter(looks)
    check = SpeedCheck(measure=lambda *_: Speed(next(measured), 2.0, by_fixtures=True))
    errors = []
    for second in range(len(looks)):
        for number in range(SCANS):
            scan = ToyDrive().scan(10 * second + number)
            error = check.speed_error(scan, HELD_M_S, 0.0, hidden_acceleration_m_s2, least_m_s)
            assert error is None or number == SCANS - 1
        errors.append(error and error[0])
    return errors


def test_the_speed_of_a_drive_past_fixtures_is_measured():
    check, drive = SpeedCheck(), ToyDrive()
    *before, error = (check.speed_error(drive.scan(k), 9.0, 0.1, 0.6) for k in range(SCANS))
    assert before == [None] * (SCANS - 1)
    assert error[0] == pytest.approx(-1.0, abs=0.2)


def test_one_measurement_against_a_confirmed_speed_is_rejected():
    assert answers(11.1, 0.5, 11.2) == pytest.approx([0.1, None, 0.2])
    assert answers(11.1, 0.5, 20.0, 11.0) == pytest.approx([0.1, None, None, 0.0])


def test_two_equal_measurements_are_accepted():
    errors = answers(11.1, 0.5, 0.6)
    assert errors == pytest.approx([0.1, None, -10.4])
    assert abs(errors[-1]) > FAR_M_S


def test_a_change_of_speed_that_samples_exclude_is_rejected():
    """A wall that fades away along the road seems to move along."""
    assert answers(11.1, 7.0, 7.0, hidden_acceleration_m_s2=0.6) == pytest.approx([0.1, None, None])
    assert answers(11.1, 7.0, 7.0, hidden_acceleration_m_s2=4.0) == pytest.approx([0.1, None, -4.0])


def test_a_speed_confirmed_by_a_wall_is_corrected_upwards():
    """Traffic gives too low a speed; two higher measurements are right with any samples."""
    assert answers(11.1, 22.0, 22.0, hidden_acceleration_m_s2=0.6) == pytest.approx(
        [0.1, None, 11.0]
    )


def test_a_measurement_below_the_gained_speed_is_ignored():
    """Neither once nor repeatedly, nor as the first measurement."""
    errors = answers(0.5, 0.5, 0.5, 9.5, 11.0, least_m_s=9.0)
    assert errors == pytest.approx([None, None, None, -1.5, 0.0])


def test_an_unconfirmed_speed_is_corrected_at_once():
    assert answers(0.5) == pytest.approx([-10.5])


def test_two_unlikely_differences_of_one_sign_contradict():
    """One may err, and two to either side say nothing together."""
    check = SpeedCheck()
    contradictions = [
        check.contradicts(off_m_s, 0.3) for off_m_s in (1.2, -1.2, 0.1, -1.2, -1.0, -0.8)
    ]
    assert contradictions == [False, False, False, False, True, False]


@pytest.mark.slow
def test_a_wrong_speed_with_too_small_a_covariance_causes_a_restart():
    """With a small error of the speed: gravity is not kept either."""
    odometry, drive = ODOMETRIES.make("lidar-inertial"), ToyDrive()
    for k in range(12):
        odometry.update(drive.scan(k), drive.imu(k))
    track, speed_m_s = odometry._track, odometry._track.twist()[0]
    wrong_speed = Speed(speed_m_s - 0.7 * FAR_M_S, 2.0, by_fixtures=True)
    odometry._check.measure = lambda *_: wrong_speed
    estimates = []
    for k in range(12, 60):
        track.state.velocity = np.array([speed_m_s, 0, 0])
        estimates.append(odometry.update(drive.scan(k), drive.imu(k)))
        if odometry._track is not track:
            break
    assert "repeatedly" in estimates[-1].reason
    assert all(each.ok for each in estimates[:-1])
    track.state.gravity = np.array([-1.0, 0.0, -9.76])
    for n in range(k + 1, k + 8):
        odometry.update(drive.scan(n), drive.imu(n))
    assert odometry._track.state.gravity[0] == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize("with_gravity", [True, False])
def test_a_restart_keeps_gravity_or_only_the_gyro_bias(with_gravity):
    tilted, upright = (
        started(np.array(force), np.zeros(3), (0.1, 0.1, 0.1), InertialNoise())
        for force in ([1.0, 0, 9.76], [0, 0, 9.81])
    )
    tilted.rate_bias = np.array([0.01, 0.0, 0.0])
    resume(upright, tilted, with_gravity=with_gravity)
    assert upright.gravity[0] == pytest.approx(-1.0 if with_gravity else 0.0, abs=1e-3)
    assert upright.rate_bias[0] == 0.01


@pytest.mark.slow
def test_a_speed_confirmed_by_fixtures_prevents_a_restart(monkeypatch):
    """Then only traffic does not agree; after some time without a measurement it is unclear."""
    odometry, drive = ODOMETRIES.make("lidar-inertial"), ToyDrive()
    for k in range(12):
        odometry.update(drive.scan(k), drive.imu(k))
    track = odometry._track
    matched = track.matched
    monkeypatch.setattr(track, "matched", lambda *arguments: replace(matched(*arguments), fits=0.0))
    for k in range(12, 25):
        estimate = odometry.update(drive.scan(k), drive.imu(k))
    assert odometry._track is track
    assert estimate.reason == "only 0% of the points agree with the map"
    monkeypatch.setattr(odometry._check, "speed_error", lambda *_: None)
    for k in range(25, 25 + 10 * int(BELIEVED_S) + 5):
        odometry.update(drive.scan(k), drive.imu(k))
    assert odometry._track is not track


def test_vertical_speed_alone_does_not_exclude_rest():
    """A bias of the accelerometer looks like vertical speed if the height is unobservable."""
    up, ahead = (
        InertialTrack(
            started(np.array([0, 0, 9.81]), velocity, (0.1, 0.1, 0.1), InertialNoise()),
            np.zeros(3),
            InertialNoise(),
            reach_m=50.0,
        )
        for velocity in (np.array([0, 0, 2 * SLOW_M_S]), np.array([2 * SLOW_M_S, 0, 0]))
    )
    assert up.slow
    assert not ahead.slow
