"""The most likely pose of a vehicle in one scan, its course known or not."""

import numpy as np
import pytest
from toy_lidar import CALIBRATION, scan

from roadscope.core import Pose
from roadscope.detectors import HEADING_RAD, AnsweredScan, KnownCourse, course_of, likely_pose
from roadscope.detectors.moving import Chain, View, lidar_of
from roadscope.detectors.pose import BodyModel, body_scan

FIGURES = {"range_noise_m": 0.02, "range_max_m": 100.0, "detection_limit": 0.4}
CAR = (4.6, 1.85, 1.5)
BRICK = BodyModel((4.6, 0.1), (1.85, 0.05), (0.0, 0.1))


def seen_car(x, y, yaw, first_deg=-180.0):
    """Return what a scan says of a car, the sensor's place being the calibration's."""
    azimuths = np.radians(first_deg + np.arange(0.0, 360.0, 0.25))
    sweep = scan(
        [(x, y, *CAR, yaw)], noise_m=0.02, elevations=np.arange(-8.0, 1.4, 0.66), azimuths=azimuths
    )
    mount = CALIBRATION.pose(sweep.sensor)
    places = mount.apply(sweep.points)
    own = (np.hypot(*(places[:, :2] - [x, y]).T) < 2.7) & (places[:, 2] > 0.2)
    spec = lidar_of(sweep, **FIGURES)
    assert spec is not None
    return body_scan(spec, sweep, own, mount)


@pytest.mark.parametrize("first_deg", [-180.0, 0.0, 30.0])
@pytest.mark.parametrize(("x", "y", "yaw"), [(15.0, 2.0, 0.4), (12.0, -5.0, 1.9), (18.0, 0.0, 0.0)])
def test_a_car_is_found_also_at_the_seam_of_the_sweep(x, y, yaw, first_deg):
    pose = likely_pose(seen_car(x, y, yaw, first_deg), BRICK, KnownCourse(0.0, yaw, HEADING_RAD))
    assert np.hypot(pose.x - x, pose.y - y) < 0.12
    assert abs((pose.yaw - yaw + np.pi) % (2 * np.pi) - np.pi) < np.radians(2.5)


def test_the_course_decides_which_end_of_a_car_is_the_front():
    car_view = seen_car(15.0, 2.0, 0.4)
    ahead, back = (
        likely_pose(car_view, BRICK, KnownCourse(0.0, heading, HEADING_RAD))
        for heading in (0.4, 0.4 - np.pi)
    )
    assert np.cos(ahead.yaw - 0.4) > 0.99
    assert np.cos(back.yaw - 0.4) < -0.99


@pytest.mark.parametrize("seed", range(5))
def test_the_sensor_moves_as_matrices_say(seed):
    rng = np.random.default_rng(seed)
    drive, mount = (
        Pose.from_euler(*rng.uniform(-50, 50, 3), yaw=yaw, pitch=0.0, roll=0.0)
        for yaw in rng.uniform(-3, 3, 2)
    )
    x_s, y_s, turn_s = twist = rng.uniform(-1, 1, 3) * [30.0, 2.0, 0.6]
    sweep = scan([(15.0, 0.0, *CAR, 0.0)])
    answered = AnsweredScan(sweep, View.of(sweep, mount, twist), drive, mount, None)
    after = drive.matrix @ Pose.planar(x_s * 1e-6, y_s * 1e-6, turn_s * 1e-6).matrix @ mount.matrix
    before = drive.matrix @ mount.matrix
    expected = (after - before)[:2, 3] / 1e-6
    assert answered.sensor_velocity == pytest.approx(expected, abs=1e-3)


def chain_of(times_s, velocity):
    chain = Chain()
    chain.times, chain.velocity = list(times_s), np.array(velocity)
    return chain


def test_a_car_that_stands_or_was_detected_once_has_no_course():
    assert course_of(chain_of([1.0], [20.0, 0.0])).sd == np.inf
    assert course_of(chain_of([1.0, 1.1, 1.2], [0.0, 0.0])).sd == np.inf
    assert course_of(chain_of([1.0, 1.1], [0.05, 0.0])).sd == np.inf
    course = course_of(chain_of([1.0, 1.1, 1.2, 1.3], [3.0, -4.0]))
    assert course.speed == pytest.approx(5.0)
    assert course.heading == pytest.approx(np.arctan2(-4.0, 3.0))
    assert HEADING_RAD < course.sd < np.radians(30.0)
