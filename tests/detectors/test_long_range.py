"""Detectors of moving vehicles: when they answer, what for, and how near."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, scan, scan_of

from roadscope.core import Category, Frame, Pose
from roadscope.detectors import DETECTORS

CAUSAL = ("zhang2017", "zhang2017-multi-causal", "zhang2017-ransac", "long-range")
ALL = (*CAUSAL, "zhang2017-multi")
BEAMS_DEG = np.arange(-8.0, 1.4, 1.33)
CAR = (4.6, 1.85, 1.5)
SCENE = [(40, 14, 60, 0.4, 3.0, 0.0), (30, -9, 1.2, 1.2, 1.4, 0.0), (24, -6, *CAR, 0.0)]
SPEED, YAW, STEP_S = 12.0, np.pi - 0.3, 0.1


def place(frame_index):
    distance_m = SPEED * STEP_S * frame_index
    return np.array([34 + distance_m * np.cos(YAW), 3 + distance_m * np.sin(YAW)])


def frames(count=10, ego_m_s=0.0):
    """Return frames of a car that comes nearer, with a wall, a bush and a car that stand."""
    drive = []
    for k in range(count):
        shift = np.array([ego_m_s * STEP_S * k, 0.0])
        moving = (*(place(k) - shift), *CAR, YAW)
        boxes = [moving, *((b[0] - shift[0], *b[1:]) for b in SCENE)]
        sweep = scan(boxes, noise_m=0.02, seed=k, elevations=BEAMS_DEG)
        sweep = replace(sweep, stamp_s=1 + 0.1 * k)
        motion = Pose.planar(ego_m_s * STEP_S, 0, 0) if k else None
        drive.append(Frame(sweep.stamp_s, CALIBRATION, sweep, previous_from_ego=motion))
    return drive


@pytest.mark.parametrize("ego_m_s", [0.0, 10.0])
@pytest.mark.parametrize("name", ALL)
def test_the_moving_car_is_found_and_only_it(name, ego_m_s) -> None:
    detector = DETECTORS.make(name)
    for frame in frames(ego_m_s=ego_m_s):
        boxes = detector.detect(frame)
    index = round((boxes.stamp_s - 1.0) / STEP_S)
    where = place(index) - [ego_m_s * STEP_S * index, 0.0]
    assert len(boxes) == 1
    assert np.hypot(*(boxes.centres[0, :2] - where)) < 0.5
    off = (boxes.yaws[0] - YAW + np.pi / 2) % np.pi - np.pi / 2
    assert abs(np.degrees(off)) < 5
    assert boxes.categories[0] == Category.CAR


@pytest.mark.parametrize("name", CAUSAL)
def test_the_causal_ones_answer_for_the_frame_itself(name) -> None:
    detector = DETECTORS.make(name)
    for frame in frames(6):
        assert detector.detect(frame).stamp_s == frame.stamp_s


def test_the_papers_multi_frame_fit_answers_one_frame_late() -> None:
    detector, drive = DETECTORS.make("zhang2017-multi"), frames(8)
    first, *rest = [detector.detect(frame) for frame in drive]
    assert (len(first), first.stamp_s) == (0, drive[0].stamp_s)
    assert [boxes.stamp_s for boxes in rest] == [frame.stamp_s for frame in drive[:-1]]
    assert len(rest[-1]) == 1


def test_a_frame_without_a_scan_is_passed_over() -> None:
    detector, drive = DETECTORS.make("zhang2017-multi"), frames(9)
    drive[5] = Frame(drive[5].stamp_s, CALIBRATION)
    stamps = [detector.detect(frame).stamp_s for frame in drive]
    assert stamps[5] == drive[5].stamp_s
    assert stamps[6] == drive[4].stamp_s
    assert stamps[7] == drive[6].stamp_s


@pytest.mark.parametrize("name", ALL)
def test_a_clock_that_begins_anew_is_a_new_drive(name) -> None:
    detector, drive = DETECTORS.make(name), frames(8)
    first = [detector.detect(frame) for frame in drive]
    assert [detector.detect(frame) for frame in drive] == first


def test_an_unknown_fit_is_refused_by_name() -> None:
    detector = "roadscope.detectors.long_range:LongRangeDetector?fit=spline"
    with pytest.raises(ValueError, match="no fit 'spline'; known: single, multi, ransac, body"):
        DETECTORS.make(detector)


@pytest.mark.parametrize("name", ALL)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 80), grid=st.booleans())
@settings(max_examples=10)
def test_any_clouds_in_a_row_give_proper_boxes(name, seed, count, grid) -> None:
    rng, detector = np.random.default_rng(seed), DETECTORS.make(name)
    for k in range(5):
        points = rng.uniform(-20, 20, (count, 3)) * [1, 1, 0.05]
        points = np.round(points) if grid else points
        ring, column = rng.integers(0, 4, count), rng.integers(0, 400, count)
        sweep = scan_of(points, ring, column, stamp_s=1.0 + k / 10)
        boxes = detector.detect(Frame(sweep.stamp_s, CALIBRATION, sweep))
        assert (np.abs(boxes.centres[:, :2]) < 60).all()
