"""The IMU alone, on drives of which its samples are known exactly."""

import numpy as np
import pytest
from toy_drive import emptied, moment

from roadscope.core import ImuSamples, LidarScan, Pose
from roadscope.odometry import DeadReckoningOdometry

RATE_HZ, PERIOD_S, G = 400, 0.1, 9.81


def empty_scan(k):
    scan = emptied(moment(0.0, 0)[0])
    arrays = (scan.points, scan.intensity, scan.ring, scan.column, scan.time_offset_s)
    return LidarScan(*arrays, PERIOD_S * k, scan.sensor)


def state(t):
    """Place, yaw, and their first two derivatives, of a LiDAR that starts after 1.5 s and turns."""
    s = max(t - 1.5, 0.0)
    # The third power starts without a jump of the force.
    yaw, rate, gain = 0.02 * s**3, 0.06 * s**2, 0.12 * s
    place, force = np.array([0.3 * s**3, 0.05 * s**3, 0]), np.array([1.8 * s, 0.3 * s, 0])
    return place, yaw, rate, gain, force


def samples(k, lever):
    """Samples between two scans of an IMU with a lever arm, at the middle of its steps."""
    stamps = PERIOD_S * (k - 1) + np.arange(round(PERIOD_S * RATE_HZ)) / RATE_HZ
    rates, forces = [], []
    for t in stamps + 0.5 / RATE_HZ:
        _, yaw, rate, gain, force = state(t)
        cos, sin = np.cos(yaw), np.sin(yaw)
        level = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) @ force
        turn, more = np.array([0, 0, rate]), np.array([0, 0, gain])
        at_imu = level + np.cross(more, lever) + np.cross(turn, np.cross(turn, lever))
        rates.append(turn)
        forces.append(at_imu + np.array([0, 0, G]))
    return ImuSamples(stamps, np.array(rates), np.array(forces))


@pytest.mark.parametrize("lever", [(0.0, 0, 0), (2.0, -0.5, 0.3)])
def test_follows_a_drive_from_rest_wherever_the_imu_sits(lever):
    odometry = DeadReckoningOdometry()
    odometry.reset(Pose.from_euler(*lever))
    odometry.update(empty_scan(0))
    for k in range(1, 46):
        estimate = odometry.update(empty_scan(k), samples(k, np.array(lever)))
        place, yaw, *_ = state(PERIOD_S * k)
        assert estimate.ok
        assert estimate.start_from_lidar.translation == pytest.approx(place, abs=0.02)
        assert estimate.start_from_lidar.yaw == pytest.approx(yaw, abs=1e-3)
    assert np.linalg.norm(place) > 8


def test_a_bias_at_rest_is_removed():
    ends = []
    for bias in (0.0, 0.01):
        odometry = DeadReckoningOdometry()
        odometry.update(empty_scan(0))
        for k in range(1, 31):
            imu = samples(k, np.zeros(3))
            imu = ImuSamples(imu.stamps_s, imu.angular_velocity + bias, imu.specific_force + bias)
            estimate = odometry.update(empty_scan(k), imu)
        ends.append(estimate.start_from_lidar.translation)
    assert ends[0] == pytest.approx(ends[1], abs=0.02)


def test_without_samples_the_speed_is_kept_and_the_pose_degraded():
    odometry = DeadReckoningOdometry()
    odometry.update(empty_scan(0))
    for k in range(1, 31):
        before = odometry.update(empty_scan(k), samples(k, np.zeros(3)))
    after = odometry.update(empty_scan(31))
    speed = np.array([0.9 * 1.5**2, 0.15 * 1.5**2, 0])
    displacement = after.start_from_lidar.translation - before.start_from_lidar.translation
    assert displacement == pytest.approx(PERIOD_S * speed, abs=0.01)
    assert not after.ok
