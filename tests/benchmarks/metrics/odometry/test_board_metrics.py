"""What the odometry board adds to drift: curves by distance, false motion, dynamic returns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.benchmarks.metrics import (
    AT_REST_M_S,
    DISTANCE,
    LEAST_REST_S,
    MARKS_M,
    Trajectories,
    by_distance,
    part_name,
    rests,
    score_moving,
    score_standing,
)
from roadscope.odometry import exp_se3

PERIOD_S = 0.1


def along(steps_m, yaw_rad=0.0):
    """Poses after each of some steps ahead, each of which turns a little."""
    poses = [np.eye(4)]
    for step_m in steps_m:
        poses.append(poses[-1] @ exp_se3(np.array([step_m, 0, 0, 0, 0, yaw_rad])))
    return np.array(poses)


def walk(truth_m, told_m, **turns):
    truth, told = along(truth_m), along(told_m, **turns)
    return Trajectories(told, truth), PERIOD_S * np.arange(len(truth))


def value(both, metric, mark_m):
    return by_distance(both)[part_name(metric, DISTANCE, str(mark_m))]


def test_a_scale_error_is_the_same_over_all_distances():
    both, _ = walk(np.full(300, 1.0), np.full(300, 1.02))
    for mark_m in MARKS_M:
        score = value(both, "t_rel", mark_m)
        if mark_m >= 300:
            assert score.n == 0
            assert value(both, "position_error", mark_m).n == 0
            continue
        # A stretch ends one step beyond its length.
        assert score.value == pytest.approx(2.0 * (mark_m + 1) / mark_m)
        at = value(both, "position_error", mark_m)
        assert (at.value, at.n) == (pytest.approx(0.02 * (mark_m + 1)), 1)
        assert value(both, "r_rel", mark_m).value == pytest.approx(0.0, abs=1e-9)


@given(st.integers(0, 1000))
def test_curves_are_those_of_stretches_one_by_one(seed):
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.0, 2.0, 60) * (rng.random(60) < 0.7)
    both, _ = walk(steps, steps + 0.05 * rng.standard_normal(60), yaw_rad=0.01)
    way = both.distances
    for mark_m in MARKS_M[:3]:
        shifts, turns = [], []
        for first in range(len(way)):
            beyond = np.flatnonzero(way > way[first] + mark_m)
            if not len(beyond):
                continue
            motions = [np.linalg.inv(p[first]) @ p[beyond[0]] for p in (both.truth, both.estimate)]
            off = np.linalg.inv(motions[0]) @ motions[1]
            shifts.append(np.linalg.norm(off[:3, 3]) / mark_m)
            turns.append(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)) / mark_m)
        score = value(both, "t_rel", mark_m)
        assert score.n == len(shifts)
        if shifts:
            assert score.value == pytest.approx(100 * np.mean(shifts))
            turned = 100 * np.rad2deg(np.mean(turns))
            assert value(both, "r_rel", mark_m).value == pytest.approx(turned, abs=1e-6)


@given(st.lists(st.booleans(), max_size=60))
def test_rests_are_the_longest_stretches_without_motion(stands):
    steps = np.where(np.array(stands, bool), 0.0, 1.0)
    both, stamps_s = walk(steps, steps)
    expected, k = [], 0
    while k < len(stands):
        end = k
        while end < len(stands) and stands[end]:
            end += 1
        if (end - k) * PERIOD_S >= LEAST_REST_S - 1e-9:
            expected.append((k, end))
        k = max(end, k + 1)
    assert rests(both, stamps_s) == expected


def test_false_motion_is_the_farthest_and_the_last_of_a_rest():
    stand = [0.0] * 20
    there_and_back = [0.1] * 10 + [-0.08] * 10
    both, stamps_s = walk([1.0] * 5 + stand + [1.0] * 3, [2.0] * 5 + there_and_back + [1.0] * 3)
    score = score_standing(both, stamps_s)
    assert score.false_motion.value == pytest.approx(1.0)
    assert score.false_motion_end.value == pytest.approx(0.2)
    assert score.false_motion.n == 21


def test_what_a_rocking_body_does_at_rest_is_no_false_motion():
    rocking = 0.4 * AT_REST_M_S * PERIOD_S * np.where(np.arange(30) % 2, 1, -1)
    both, stamps_s = walk(rocking, rocking)
    assert score_standing(both, stamps_s).false_motion.value == pytest.approx(0.0, abs=1e-9)


def test_who_never_stands_has_no_false_motion():
    both, stamps_s = walk([1.0] * 30, [1.0] * 30)
    score = score_standing(both, stamps_s)
    assert score.false_motion.n == 0
    assert score.false_motion.weight == 0
    assert score.false_motion_end.n == 0


def test_dynamic_returns_are_counted_over_scans():
    told = [np.array([1, 1, 0, 0], bool), np.array([1, 0, 0], bool)]
    true = [np.array([1, 0, 1, 1], bool), np.array([0, 0, 1], bool)]
    scores = score_moving(told, true)
    assert scores.dynamic_precision.value == pytest.approx(1 / 3)
    assert scores.dynamic_recall.value == pytest.approx(1 / 4)
    none = score_moving([np.zeros(3, bool)], [np.zeros(3, bool)])
    assert none.dynamic_precision.n == none.dynamic_recall.n == 0
