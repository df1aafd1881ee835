"""Wheel speeds: the speed of an instant, and their use in lidar-inertial."""

import numpy as np
import pytest
from node_answers import poses_of
from toy_drive import driven, emptied, offset

from roadscope.benchmarks import Episode, drive
from roadscope.core import WheelSamples
from roadscope.odometry import ODOMETRIES, Odometry, WheeledOdometry, update_with_wheels
from roadscope.odometry.inertial import (
    SPEED,
    WHEELS,
    InertialNoise,
    InertialTrack,
    WheelBuffer,
    started,
)

LEVEL = np.array([0, 0, 9.81])


def block(start_s, end_s, speed_of):
    stamps_s = np.arange(round(100 * start_s), round(100 * end_s)) / 100
    return WheelSamples(stamps_s, np.array([float(speed_of(t)) for t in stamps_s]))


def test_the_speed_of_an_instant_with_any_acceleration():
    buffer = WheelBuffer()
    buffer.add(block(0.0, 1.0, lambda t: 3 + 2 * t))
    for stamp_s in (0.5, 0.99, 1.0):
        speed, variance = buffer.at(stamp_s)
        assert speed == pytest.approx(3 + 2 * stamp_s, abs=1e-9)
        assert 0 < variance < 0.05**2
    assert buffer.at(2.0) is None
    assert WheelBuffer().at(0.0) is None


def test_samples_out_of_order_are_left_out():
    buffer = WheelBuffer()
    buffer.add(WheelSamples(np.array([0.0, 0.02]), np.array([5.0, 5.0])))
    buffer.add(WheelSamples(np.array([0.01, 0.02, 0.03]), np.array([90.0, 90.0, 5.0])))
    assert buffer.stamps_s.tolist() == [0.0, 0.02, 0.03]
    assert buffer.speeds.tolist() == [5.0] * 3
    buffer.add(block(9.0, 10.0, lambda t: 7.0))
    buffer.add(block(2.0, 2.1, lambda t: 8.0))
    assert buffer.at(2.05)[0] == pytest.approx(8.0), "the clock began anew"


def track_at(speed_m_s):
    noise = InertialNoise()
    state = started(LEVEL, np.array([speed_m_s, 0, 0]), (0.01, 0.1, 0.1), noise)
    return InertialTrack(state, np.zeros(3), noise, reach_m=50.0)


def test_a_known_speed_determines_the_wheel_scale():
    track = track_at(20.0)
    before = track.state.covariance[WHEELS, WHEELS]
    for _ in range(5):
        assert track.correct_by_wheels(20.3, 0.02**2, doubted=True)
    assert track.state.wheel_scale == pytest.approx(0.015, rel=0.05)
    assert track.state.covariance[WHEELS, WHEELS] < before / 100
    assert np.linalg.norm(track.state.velocity - [20, 0, 0]) < 0.02


def test_slipping_wheels_are_rejected_unless_the_speed_is_unknown():
    track = track_at(20.0)
    assert not track.correct_by_wheels(0.0, 0.02**2, doubted=True)
    assert track.state.velocity[0] == 20.0
    assert track.correct_by_wheels(0.0, 0.02**2, doubted=False)
    vague = track_at(20.0)
    vague.state.covariance[SPEED, SPEED] = 25.0 * np.eye(3)
    assert vague.correct_by_wheels(12.0, 0.02**2, doubted=True)
    assert vague.state.velocity[0] == pytest.approx(12.0, abs=0.1)


def test_only_odometries_with_wheels_get_wheel_speeds():
    _, inputs = driven(3)
    wheels = block(0.0, 0.1, lambda t: 8.0)
    for name in ("still", "lidar-inertial"):
        odometry = ODOMETRIES.make(name)
        assert isinstance(odometry, Odometry)
        assert isinstance(odometry, WheeledOdometry) == (name == "lidar-inertial")
        assert update_with_wheels(odometry, *inputs[0], wheels).stamp_s == inputs[0][0].stamp_s


def rolled(inputs, speed_of, spec="lidar-inertial?wheels=true"):
    odometry, estimates = ODOMETRIES.make(spec), []
    for scan, imu in inputs:
        wheels = block(scan.stamp_s - 0.05, scan.stamp_s + 0.05, speed_of)
        estimates.append(update_with_wheels(odometry, scan, imu, wheels))
    return estimates


def test_wheels_are_off_by_default():
    _, inputs = driven(8)
    estimates = rolled(inputs, lambda t: 30.0, "lidar-inertial")
    without = ODOMETRIES.make("lidar-inertial")
    assert estimates == [without.update(scan, imu) for scan, imu in inputs]


def test_with_wheels_the_speed_is_known_from_the_first_scan_on():
    drive_, inputs = driven(12)
    estimates = rolled(inputs, lambda t: 8.08)
    assert all(each.ok for each in estimates)
    assert offset(estimates[-1], drive_.pose(inputs[-1][0].stamp_s))[0] < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("spoilt", ["locked", "tenfold", "silent"])
def test_bad_wheels_leave_finite_poses_and_pass(spoilt):
    drive_, inputs = driven(40)
    speeds = {"locked": 0.0, "tenfold": 80.0}

    def speed_of(t):
        return speeds.get(spoilt, 8.0) if 1.5 < t < 2.2 else 8.0

    odometry, estimates = ODOMETRIES.make("lidar-inertial?wheels=true"), []
    for scan, imu in inputs:
        silent = spoilt == "silent" and 1.5 < scan.stamp_s < 2.2
        wheels = None if silent else block(scan.stamp_s - 0.05, scan.stamp_s + 0.05, speed_of)
        estimates.append(update_with_wheels(odometry, scan, imu, wheels))
    assert all(np.isfinite(each.start_from_lidar.matrix).all() for each in estimates)
    assert estimates[-1].ok
    assert offset(estimates[-1], drive_.pose(inputs[-1][0].stamp_s))[0] < 0.5


def test_wheels_are_used_without_scans():
    drive_, inputs = driven(20)
    blind = [(emptied(scan) if 8 <= k < 13 else scan, imu) for k, (scan, imu) in enumerate(inputs)]
    estimates = rolled(blind, lambda t: 8.0)
    assert not estimates[10].ok
    assert offset(estimates[-1], drive_.pose(inputs[-1][0].stamp_s))[0] < 0.2


def test_every_sample_comes_with_a_scan_once():
    steps = list(drive(Episode("tunnel", 0, "vlp16-imu", 2.0)))
    stamps = np.concatenate([step.wheels.stamps_s for step in steps])
    assert np.allclose(np.diff(stamps), 0.01)
    steps[3].wheels.speeds[:] = 0.0
    again = list(drive(Episode("tunnel", 0, "vlp16-imu", 2.0)))
    assert again[3].wheels.speeds.min() > 1.0
    assert all(s.wheels is None for s in drive(Episode("tunnel", 0, "vlp16", 1.0)))


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "is_sufficient"), [("barriers", False), ("tunnel", True)])
def test_wheels_give_the_speed_between_bare_walls_and_lamps_in_a_tunnel(scenario, is_sufficient):
    episode = Episode(scenario, 10_003, "vlp16-imu", 15.0)
    errors = {}
    for spec in ("lidar-inertial", "lidar-inertial?wheels=true"):
        both = poses_of(spec, episode).trajectories
        ends = [p[-1, :3, 3] - p[0, :3, 3] for p in (both.estimate, both.truth)]
        true_distance_m = np.linalg.norm(ends[1])
        errors[spec] = abs(np.linalg.norm(ends[0]) - true_distance_m) / true_distance_m
    assert errors["lidar-inertial?wheels=true"] < 0.03
    assert (errors["lidar-inertial"] < 0.03) == is_sufficient, errors
    assert is_sufficient or errors["lidar-inertial"] > 0.3, errors
