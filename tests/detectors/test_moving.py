"""What moves is found, what stands is not, on a standing and on a moving sensor."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, scan

from roadscope.core import Frame, Pose
from roadscope.detectors.moving import (
    NOISE_USUAL_M,
    Memory,
    View,
    deskewed,
    extract,
    lidar_of,
    linked,
    range_noise_of,
    thinned,
    whole_body,
)

STEP_S = 0.1
BEAMS_DEG = np.arange(-8.0, 1.4, 1.33)
WALL, RAIL = (45, 14, 60, 0.4, 3.0, 0.0), (40, -7, 80, 0.1, 0.75, 0.0)
BUSHES = [(20 + 9 * k, 9 + k % 2, 1.2, 1.2, 1.4, 0.0) for k in range(6)]
POLES = [(25 + 15 * k, -5.5, 0.3, 0.3, 4.0, 0.0) for k in range(4)]
STANDING = [WALL, RAIL, *BUSHES, *POLES]
CAR = (4.6, 1.85, 1.5)


def drive(cars, *, ego_m_s=0.0, count=12, with_motion=True, noise_m=0.02):
    """Return frames of cars given as (x, y, yaw, speed), world frame, and their places at the end.

    The sensor drives along x; scans are instantaneous, so no sweep is skewed.
    """
    frames = []
    for k in range(count):
        shift = ego_m_s * STEP_S * k
        places = [
            (x + v * STEP_S * k * np.cos(yaw), y + v * STEP_S * k * np.sin(yaw), *CAR, yaw)
            for x, y, yaw, v in cars
        ]
        boxes = [(b[0] - shift, *b[1:]) for b in [*places, *STANDING]]
        sweep = scan(boxes, noise_m=noise_m, seed=k, elevations=BEAMS_DEG)
        sweep = replace(sweep, stamp_s=1.0 + STEP_S * k)
        motion = Pose.planar(ego_m_s * STEP_S, 0.0, 0.0) if with_motion and k else None
        frames.append(Frame(sweep.stamp_s, CALIBRATION, sweep, previous_from_ego=motion))
    return frames, [(b[0] - shift, b[1]) for b in places]


def candidates(frames):
    memory = Memory()
    for frame in frames:
        memory.add(frame)
    return extract(memory.now, memory.earlier_views())


@pytest.mark.parametrize("ego_m_s", [0.0, 12.0, 30.0])
@pytest.mark.parametrize("speed", [-30.0, -5.0, 8.0, 12.0, 30.0])
def test_a_passing_car_is_found_and_the_roadside_is_not(ego_m_s, speed) -> None:
    start = 32 + (ego_m_s - speed) * STEP_S * 11
    frames, [place] = drive([(start, 3.5, 0.0, speed)], ego_m_s=ego_m_s)
    moving = candidates(frames)
    off = [np.hypot(*(c.points[:, :2].mean(axis=0) - place)) for c in moving]
    assert min(off) < 2.6
    assert len(moving) == 1


@pytest.mark.parametrize("ego_m_s", [0.0, 4.0, 8.0])
def test_where_nothing_moves_nothing_is_found(ego_m_s) -> None:
    frames, _ = drive([(40, 3.5, 0.0, 0.0), (25, -3.5, np.pi, 0.0)], ego_m_s=ego_m_s, count=14)
    memory = Memory()
    for frame in frames:
        memory.add(frame)
        assert extract(memory.now, memory.earlier_views()) == []


def test_a_moving_sensor_without_its_motion_takes_the_roadside_for_moving() -> None:
    frames, _ = drive([], ego_m_s=12.0, with_motion=False)
    assert len(candidates(frames)) > 0


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -2.0])
def test_all_of_the_car_is_gathered_and_nothing_else(yaw) -> None:
    speed = 6.0
    x, y = 28 - speed * 1.1 * np.cos(yaw), 1 - speed * 1.1 * np.sin(yaw)
    frames, [place] = drive([(x, y, yaw, speed)], noise_m=0.01)
    [car] = candidates(frames)
    local = car.points[:, :2] - place
    along, across = local @ [np.cos(yaw), np.sin(yaw)], local @ [-np.sin(yaw), np.cos(yaw)]
    assert np.abs(along).max() < 2.4
    assert np.abs(across).max() < 1.05
    own = np.hypot(*(frames[-1].lidar.points[:, :2] + [5, 0] - place).T) < 2.0
    high = frames[-1].lidar.points[:, 2] + 0.55 > 0.2
    assert set(np.flatnonzero(own & high)) <= set(car.rows)


@pytest.mark.parametrize("together", ["abreast", "in a row"])
def test_cars_close_together_stay_separate(together) -> None:
    abreast = [(20, y, 0.0, 10.0) for y in (-3.5, 0, 3.5)]
    in_a_row = [(28 + 8.5 * k, 5.5, np.pi, 10.0) for k in range(2)]
    cars = abreast if together == "abreast" else in_a_row
    frames, _ = drive(cars)
    assert len(candidates(frames)) == len(cars)


def test_a_lost_scan_costs_one_frame_only() -> None:
    frames, [place] = drive([(22, 3.5, 0.0, 10.0)], ego_m_s=5.0)
    frames[8] = Frame(frames[8].stamp_s, CALIBRATION, None, None, None, frames[8].previous_from_ego)
    [car] = candidates(frames)
    assert np.hypot(*(car.points[:, :2].mean(axis=0) - place)) < 2.6


@given(
    speed=st.floats(-30, 30), side=st.floats(-2, 2), turn=st.floats(-0.5, 0.5), seed=st.integers(0)
)
@settings(max_examples=30)
def test_a_sweep_from_a_moving_sensor_puts_what_stands_where_it_stands(speed, side, turn, seed):
    rng = np.random.default_rng(seed)
    fixed = rng.uniform(-40, 40, (50, 3))
    times = rng.uniform(-0.05, 0.05, 50)
    measured = np.array(
        [
            Pose.planar(speed * t, side * t, turn * t).inverse().apply(p)
            for p, t in zip(fixed, times, strict=True)
        ]
    )
    carried = deskewed(measured, np.eye(4), times, np.array([speed, side, turn]))
    assert np.allclose(carried, fixed, atol=1e-9)


@given(seed=st.integers(0), count=st.integers(1, 200), grid=st.booleans())
@settings(max_examples=40)
def test_one_return_a_voxel_remains(seed, count, grid) -> None:
    points = np.random.default_rng(seed).uniform(-3, 3, (count, 3))
    points = np.round(points) if grid else points
    rows, voxels = thinned(points, 0.5, 0.7)
    keys = [tuple(k) for k in np.floor(points / [0.5, 0.5, 0.7]).astype(int)]
    assert len(rows) == len(set(keys)) == len({keys[r] for r in rows})
    assert all(
        tuple(points[r]) == min(tuple(p) for p, k in zip(points, keys, strict=True) if k == keys[r])
        for r in rows
    )
    assert [keys[r] for r in rows[voxels]] == keys


@given(seed=st.integers(0), count=st.integers(1, 60), link=st.floats(0.1, 3))
@settings(max_examples=40)
def test_linked_points_are_those_of_a_slow_search(seed, count, link) -> None:
    points = np.random.default_rng(seed).uniform(-8, 8, (count, 3))
    inside = {0}
    distances_m = np.hypot(*(points[:, None, :2] - points[:, :2]).transpose(2, 0, 1))
    while True:
        more = {int(k) for row in inside for k in np.flatnonzero(distances_m[row] <= link)}
        if more <= inside:
            break
        inside |= more
    assert set(linked(points, np.array([0]), link, 99.0)) == inside


def test_a_part_of_a_wall_stays_a_part() -> None:
    wall = np.column_stack([np.arange(0, 30, 0.3), np.zeros(100), np.full(100, 1.0)])
    part = np.arange(40, 50)
    assert np.array_equal(whole_body(wall, part), part)
    lorry = np.column_stack([np.arange(0, 12, 0.3), np.zeros(40), np.full(40, 2.0)])
    assert len(whole_body(lorry, np.arange(5))) == 40


def test_the_lidar_is_estimated_from_its_returns() -> None:
    sweep = scan([WALL], elevations=BEAMS_DEG)
    spec = lidar_of(sweep, range_noise_m=0.02, range_max_m=100.0, detection_limit=0.4)
    assert np.allclose(np.degrees(spec.elevations), BEAMS_DEG[: spec.beams], atol=1e-4)
    column = sweep.column[0]
    assert np.isclose(spec.azimuths()[column], np.arctan2(*sweep.points[0, 1::-1]), atol=1e-5)
    none = scan([], ground=False)
    assert lidar_of(none, range_noise_m=0.02, range_max_m=9.0, detection_limit=0.0) is None


def test_a_view_of_nothing_is_a_view() -> None:
    view = View.of(scan([], ground=False), CALIBRATION.pose("lux"), np.zeros(3))
    assert len(view.points) == 0
    assert np.allclose(view.origin(), [5.0, 0.0])


@pytest.mark.parametrize("noise_m", [0.01, 0.03, 0.1])
@pytest.mark.parametrize("edges", [0.0, 0.2])
def test_the_range_noise_is_read_off_smooth_faces(noise_m, edges) -> None:
    """Of slanted ones too, with holes and with every fifth return on another thing."""
    rng = np.random.default_rng(0)
    image = 20.0 + 0.05 * np.arange(900.0) + noise_m * rng.standard_normal((16, 900))
    image[rng.random(image.shape) < edges] += 5.0
    image[rng.random(image.shape) < 0.1] = np.nan
    assert range_noise_of(image.astype(np.float32)) == pytest.approx(noise_m, rel=0.1)


def test_few_returns_do_not_determine_the_range_noise() -> None:
    image = np.full((2, 8), np.float32(9.0))
    assert range_noise_of(image) == NOISE_USUAL_M
    assert range_noise_of(np.full((2, 800), np.float32(9.0))) < NOISE_USUAL_M


def test_an_estimated_lidar_has_the_noise_of_its_returns() -> None:
    sweep = scan([WALL], noise_m=0.08, elevations=BEAMS_DEG)
    spec = lidar_of(sweep, range_noise_m=None, range_max_m=100.0, detection_limit=0.4)
    assert spec.range_noise_m == pytest.approx(0.08, rel=0.15)
