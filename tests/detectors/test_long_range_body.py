"""A body's rays are found about it as in all of the scan; the way of sensor and body is right."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, scan

from roadscope.core import Pose
from roadscope.detectors.long_range_body import BUDGET, HEADING_RAD, MARK_M, VAGUE_RAD, Shot
from roadscope.detectors.moving.lidar import lidar_of
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_glance import ways
from roadscope.detectors.pose.body_rays import sight
from roadscope.detectors.pose.body_sight_kernels import Motion, rays_about, returns_about

FIGURES = {"range_noise_m": 0.02, "range_max_m": 100.0, "detection_limit": 0.4}
CAR = (4.6, 1.85, 1.5)


@pytest.mark.parametrize("first_deg", [-180.0, 0.0, 30.0])
@given(y=st.integers(-80, 80), yaw=st.integers(-300, 300), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_the_columns_about_a_body_tell_all(first_deg, y, yaw, seed) -> None:
    """Also of a body at the seam of the sweep."""
    azimuths = np.radians(first_deg + np.arange(0.0, 360.0, 0.5))
    boxes = [(15.0, y / 10, *CAR, yaw / 100), (20, -12, 30, 0.4, 3.0, 0.0)]
    beams = np.arange(-8.0, 1.4, 1.33)
    seen = scan(boxes, noise_m=0.02, seed=seed, elevations=beams, azimuths=azimuths)
    mount = CALIBRATION.pose(seen.sensor)
    places = mount.apply(seen.points)
    own = (np.hypot(*(places[:, :2] - [15.0, y / 10]).T) < 2.6) & (places[:, 2] > 0.2)
    spec = lidar_of(seen, **FIGURES)
    assert own.any()
    assert spec is not None
    shot = Shot.of(seen, View.of(seen, mount, np.zeros(3)), Pose.identity(), mount, spec)
    ordered = shot.order, shot.columns
    part, _ = returns_about(shot.returns, ordered, np.flatnonzero(own), spec.columns)
    assert len(part.ring) < len(seen) / 2
    (matrix,), velocity = shot.moves([0.0])
    lidar = shot.beams, Motion(matrix, velocity, 0.0, 1.0)
    few, _ = rays_about(shot.returns, ordered, np.flatnonzero(own), lidar, BUDGET)
    whole = sight(spec, seen, own, mount, budget=BUDGET)
    for one, other in zip(few, whole.rays, strict=True):
        assert np.array_equal(one, other)


def slow_motion(drive, mount, twist, time_s):
    """Return matrix and velocity as matrix products say them."""
    x_s, y_s, turn_s = twist
    turned = drive @ Pose.planar(0.0, 0.0, turn_s * time_s).matrix @ mount
    turned[:3, 3] = (drive @ mount)[:3, 3]
    x, y = mount[:2, 3]
    return turned, drive[:2, :2] @ [x_s - turn_s * y, y_s + turn_s * x]


@pytest.mark.parametrize("seed", range(20))
def test_the_sensor_goes_as_matrices_say(seed) -> None:
    rng = np.random.default_rng(seed)
    drive, mount = (
        Pose.from_euler(*rng.uniform(-50, 50, 3), yaw=yaw, pitch=0.1, roll=-0.2).matrix
        for yaw in rng.uniform(-3, 3, 2)
    )
    twist, times_s = rng.uniform(-1, 1, 3) * [30.0, 2.0, 0.6], rng.uniform(-0.1, 0.1, 4)
    seen = scan([(15.0, 0.0, *CAR, 0.0)])
    view = View.of(seen, Pose(mount), twist)
    found, velocity = Shot.of(seen, view, Pose(drive), Pose(mount), None).moves(times_s)
    for matrix, time_s in zip(found, times_s, strict=True):
        expected, speed = slow_motion(drive, mount, twist, time_s)
        assert matrix == pytest.approx(expected, abs=1e-12)
        assert velocity == pytest.approx(speed, abs=1e-12)


def slow_way(times_s, velocity):
    spread, speed = np.sqrt(((times_s - times_s.mean()) ** 2).sum()), np.hypot(*velocity)
    if spread > 0 and speed > 0:
        sd = np.hypot(HEADING_RAD, MARK_M / spread / speed)
        if sd < VAGUE_RAD:
            return speed, np.arctan2(velocity[1], velocity[0]), sd
    return 0.0, 0.0, np.inf


def test_what_stands_or_was_met_once_has_no_way() -> None:
    rng = np.random.default_rng(0)
    counts = [1, 2, 3, 4, 4, 4, 2]
    velocities = rng.uniform(-20, 20, (len(counts), 2))
    velocities[3:6] = [0.0, 0.0], [0.05, 0.0], [3.0, -4.0]
    times_s = [1.0 + 0.1 * np.arange(count) for count in counts]
    starts = np.cumsum([0, *counts])
    going = np.column_stack([np.hypot(*velocities.T), np.arctan2(*velocities.T[::-1])])
    found = ways(np.concatenate(times_s), starts, going, (HEADING_RAD, MARK_M, VAGUE_RAD))
    for row, times, velocity in zip(found, times_s, velocities, strict=True):
        assert row == pytest.approx(slow_way(times, velocity), rel=1e-12)
    assert np.isinf(found[:, 2]).tolist() == [k in (0, 3, 4) for k in range(len(counts))]
