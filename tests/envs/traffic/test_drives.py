"""Properties of the scenarios for odometry."""

from functools import cache

import numpy as np
import pytest
from bodies import gaps_m, slips_m

from roadscope.core import Bounds, Category
from roadscope.envs.traffic import (
    SCENARIOS,
    SHARPEST_M,
    Bend,
    Course,
    accept,
    convoy_pull_away,
    record,
    winding,
)

SEEDS = range(8)
MOVING_M = {
    "convoy-pull-away": (240.0, 400.0),
    "platoon": (540.0, 830.0),
    "cold-start": (375.0, 900.0),
    "barriers": (430.0, 860.0),
    "tunnel": (400.0, 770.0),
    "stop-and-go": (170.0, 330.0),
}
"""Least and greatest way of the ego."""
STANDING = ("standing-in-traffic", "standing-barriers")
DRIVES = (*MOVING_M, *STANDING)


@pytest.fixture(scope="module")
def recorded():
    return cache(record)


def path_length_m(line):
    """Return the length of the ego's path."""
    return float(np.linalg.norm(np.diff(line.axles[:, 0], axis=0), axis=1).sum())


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", DRIVES)
def test_no_two_bodies_touch(recorded, name):
    for seed in SEEDS:
        line = recorded(name, seed)
        rows = range(0, len(line.stamps_s), 50)
        assert min(gaps_m(line, row).min() for row in rows) > 0.25, seed
        assert not line.crashed.any()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", DRIVES)
def test_motion_is_that_of_vehicles(recorded, name):
    for seed in SEEDS:
        line = recorded(name, seed)
        steps = np.diff(line.stamps_s)[:, None]
        both = line.present[1:] & line.present[:-1]
        turned = np.diff(np.unwrap(line.yaws, axis=0), axis=0)
        lateral = np.where(both, turned / steps * line.speeds[1:], 0.0)
        always = both[1:] & both[:-1]
        pull = np.diff(line.speeds, axis=0) / steps
        assert np.abs(lateral).max() < 2.0, seed
        assert np.abs(np.diff(lateral, axis=0) * always).max() / 0.04 < 2.0, seed
        assert pull[both].max() < 2.0, seed
        assert pull[both].min() > -3.0, seed
        assert np.abs(np.diff(pull, axis=0) * always).max() / 0.04 < 5.0, seed


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", DRIVES)
def test_rear_axles_do_not_slip(recorded, name):
    for seed in SEEDS:
        line = recorded(name, seed)
        assert np.abs(slips_m(line)[line.present[1:] & line.present[:-1]]).max() < 1e-3, seed


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", DRIVES)
def test_rear_axles_stay_on_their_lanes(recorded, name):
    from scipy.spatial import cKDTree

    for seed in SEEDS:
        line = recorded(name, seed)
        centre_lines = cKDTree(line.road.points)
        # Points of a centre line are 2 m apart: up to 1 m along it, 0.3 m across.
        assert centre_lines.query(line.axles[line.present])[0].max() < np.hypot(1.1, 0.3), seed


@pytest.mark.parametrize("name", DRIVES)
def test_there_is_traffic_and_each_seed_has_its_own(recorded, name):
    lines = [recorded(name, seed) for seed in SEEDS]
    assert min(accept(line).least_objects for line in lines) >= 4
    assert len({line.sizes.tobytes() for line in lines}) == len(SEEDS)
    for line in lines:
        assert line.end_s == pytest.approx(SCENARIOS[name].duration_s, abs=0.1)
        assert line.present[:, 0].all()
        assert line.categories[0] == Category.CAR


@pytest.mark.parametrize(("name", "span_m"), MOVING_M.items())
def test_the_ego_goes_as_far_as_promised(recorded, name, span_m):
    ways = [path_length_m(recorded(name, seed)) for seed in SEEDS]
    assert span_m[0] < min(ways)
    assert max(ways) < span_m[1]
    assert max(ways) > 1.2 * min(ways)


@pytest.mark.parametrize("name", STANDING)
def test_the_ego_stands_while_others_pass(recorded, name):
    for seed in SEEDS:
        line = recorded(name, seed)
        assert path_length_m(line) == 0.0
        relative, yaw = line.axles - line.axles[:, :1], line.yaws[0, 0]
        along = relative[..., 0] * np.cos(yaw) + relative[..., 1] * np.sin(yaw)
        there = line.present[1:] & line.present[:-1]
        passed = (np.sign(along[1:]) != np.sign(along[:-1])) & there
        assert passed[:, 1:].any(axis=0).sum() >= 8, seed


def test_the_convoy_keeps_its_order_while_it_pulls_away(recorded):
    for seed in SEEDS:
        line = recorded("convoy-pull-away", seed)
        assert (line.speeds[line.stamps_s < 1.9, 0] == 0.0).all(), seed
        rows = (line.stamps_s > 0.0) & (line.stamps_s < 12.0)
        away = np.linalg.norm(line.axles - line.axles[:, :1], axis=-1)
        near = (away[0] < 15.0) & line.present[0]
        beside = np.abs(away[rows][:, near] - away[0, near])
        assert path_length_m(line) > 240.0
        assert np.median(beside[-1]) < 8.0, seed
        assert (line.sizes[near, 2] > 3.5).sum() >= 2, seed


def test_a_cold_start_is_at_15_to_35_m_s(recorded):
    first = [
        float(np.interp(0.0, line.stamps_s, line.speeds[:, 0]))
        for line in (recorded("cold-start", seed) for seed in range(20))
    ]
    assert 14.0 < min(first) < 19.0
    assert 30.0 < max(first) < 36.0


def test_stop_and_go_stops_and_goes(recorded):
    for seed in SEEDS:
        speeds = recorded("stop-and-go", seed).speeds[:, 0]
        stopped = speeds < 0.05
        assert (np.diff(stopped.astype(int)) == 1).sum() >= 2, seed
        assert speeds.max() > 5.0, seed


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_loop_comes_back_to_where_it_began(recorded, seed):
    line = recorded("racetrack-loop", seed)
    away = np.linalg.norm(line.axles[:, 0] - line.axles[0, 0], axis=1)
    left = int(np.argmax(away > 50.0))
    back = left + int(np.argmin(away[left:]))
    assert left > 0
    assert away[back] < 0.6
    turned = np.unwrap(line.yaws[:, 0])[back] - line.yaws[0, 0]
    assert abs(turned) == pytest.approx(2 * np.pi, abs=0.1)


def test_the_duration_given_cuts_and_does_not_shift():
    short, whole = convoy_pull_away("", 3, 5.0), convoy_pull_away("", 3, None)
    assert short.end_s == pytest.approx(5.0, abs=0.1)
    assert whole.end_s == pytest.approx(40.0, abs=0.1)
    assert np.array_equal(short.sizes[0], whole.sizes[0])


@pytest.mark.parametrize("seed", range(8))
def test_courses_bend_smoothly_and_not_too_sharply(seed):
    course = winding(np.random.default_rng(seed), Bounds(-200.0, 600.0), 100.0)
    along = np.arange(-250.0, 650.0, 0.25)
    assert course.bends
    assert np.abs(course.curvatures(along)).max() <= 1.0 / SHARPEST_M + 1e-12
    numeric = np.gradient(course.headings(along), along)
    np.testing.assert_allclose(course.curvatures(along), numeric, atol=2e-6)
    np.testing.assert_allclose(course.points(np.zeros(1), 0.0), [[0.0, 0.0]], atol=1e-12)


def test_parallels_of_a_course_keep_distance_and_direction():
    course = Course((Bend(10.0, 80.0, 0.9), Bend(120.0, 60.0, -0.5)))
    along = np.linspace(-30.0, 250.0, 4001)
    on, beside = course.points(along, np.zeros_like(along)), course.points(along, 3.5)
    np.testing.assert_allclose(np.linalg.norm(beside - on, axis=1), 3.5, atol=1e-9)
    tangents = np.diff(on, axis=0) / np.diff(along)[:, None]
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0, atol=1e-5)
    middle = course.headings((along[1:] + along[:-1]) / 2)
    np.testing.assert_allclose(tangents[:, 0], np.cos(middle), atol=1e-4)
    np.testing.assert_allclose(tangents[:, 1], np.sin(middle), atol=1e-4)


@pytest.mark.parametrize("name", ["tunnel", "barriers"])
def test_a_road_between_walls_is_walled(name):
    """From the ego's roof, walls to both sides over its whole way; in a tunnel a ceiling."""
    from roadscope.envs import find_rig
    from roadscope.envs.sensors import sense

    for frame, truth in sense(record(name, 3, 1.0), find_rig("vlp16"), 3):
        points = frame.lidar.points[truth.sources <= -2]
        beside = np.abs(points[:, 0]) < 5.0
        left, right = points[:, 1] > 2.5, points[:, 1] < -2.5
        high = points[:, 2] > -0.5
        assert (beside & left & high).sum() > 20
        assert (beside & right & high).sum() > 20
        assert ((points[:, 2] > 2.6) & (np.abs(points[:, 1]) < 3.0)).any() == (name == "tunnel")
