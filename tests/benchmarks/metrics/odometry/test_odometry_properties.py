"""What errors of trajectories must hold to, and ways on which little can be said."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.benchmarks.metrics import (
    AT_REST_M_S,
    DISTANCE,
    LEAST_REST_S,
    MARKS_M,
    Trajectories,
    absolute_errors,
    by_distance,
    drift,
    part_name,
    relative_errors,
    rests,
    score_moving,
    score_odometry,
    score_standing,
    truth_from_estimate,
)
from roadscope.odometry import exp_se3

seeds = st.integers(0, 9999)


def random_trajectory(rng, n, speed=1.0, spread=0.05):
    poses = [exp_se3(rng.standard_normal(6))]
    for _ in range(n - 1):
        step = np.array([speed, 0, 0, 0, 0, 0]) + spread * rng.standard_normal(6)
        poses.append(poses[-1] @ exp_se3(step))
    return np.array(poses)


def straight(n, speed=1.0):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = speed * np.arange(n)
    return poses


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_frames_of_either_trajectory_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    both = Trajectories(random_trajectory(rng, 80), random_trajectory(rng, 80))
    a, b = exp_se3(3 * rng.standard_normal(6)), exp_se3(3 * rng.standard_normal(6))
    moved = Trajectories(a @ both.estimate, b @ both.truth)
    for one, other in (
        (absolute_errors(both, "se3").positions_m, absolute_errors(moved, "se3").positions_m),
        (absolute_errors(both, "origin").positions_m, absolute_errors(moved, "origin").positions_m),
        (relative_errors(both, 3).translations_m, relative_errors(moved, 3).translations_m),
        (relative_errors(both, 3).rotations_rad, relative_errors(moved, 3).rotations_rad),
        (drift(both, (20.0,)).translations, drift(moved, (20.0,)).translations),
    ):
        assert one == pytest.approx(other, abs=1e-7)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_where_the_sensor_sits_matters_to_places_not_to_turns(seed):
    rng = np.random.default_rng(seed)
    both, mounted = (
        Trajectories(random_trajectory(rng, 40), random_trajectory(rng, 40)),
        exp_se3(rng.standard_normal(6)),
    )
    moved = Trajectories(both.estimate @ mounted, both.truth @ mounted)
    one, other = relative_errors(both), relative_errors(moved)
    assert one.rotations_rad == pytest.approx(other.rotations_rad, abs=1e-7)


@pytest.mark.parametrize("scale", [0.0, 0.9, 1.0, 1.03])
def test_a_wrong_scale_is_the_drift(scale):
    truth = straight(300, 0.5)
    estimate = truth.copy()
    estimate[:, 0, 3] *= scale
    errors = drift(Trajectories(estimate, truth), (50.0, 100.0), every=1)
    # A stretch ends with the first pose beyond its length, half a metre farther here.
    exact = 100 * abs(scale - 1) * (errors.lengths_m + 0.5) / errors.lengths_m
    assert 100 * errors.translations == pytest.approx(exact)
    assert errors.r_rel == 0
    assert len(errors.over(50.0)) == 300 - 101


def test_a_gyros_bias_is_the_turn_a_metre():
    level, turning = (
        np.array([exp_se3(k * np.array([1.0, 0, 0, 0, 0, rate])) for k in range(120)])
        for rate in (0.0, 0.001)
    )
    errors = drift(Trajectories(turning, level), (50.0,), every=1)
    assert errors.rotations == pytest.approx(0.001 * 51 / 50)


@settings(max_examples=25, deadline=None)
@given(seed=seeds, kind=st.sampled_from(["one", "line", "plane", "space", "mirror"]))
def test_alignment_is_a_rigid_motion_whatever_the_places(seed, kind):
    rng = np.random.default_rng(seed)
    rank = {"one": 0, "line": 1, "plane": 2, "space": 3, "mirror": 3}[kind]
    places = rng.standard_normal((20, rank)) @ rng.standard_normal((rank, 3)) + [1, 2, 3]
    motion = exp_se3(rng.standard_normal(6))
    aim = places @ motion[:3, :3].T + motion[:3, 3]
    if kind == "mirror":
        aim = aim * [1, 1, -1]
    for yaw_only in (False, True):
        aligned = truth_from_estimate(places, aim, yaw_only=yaw_only)
        assert aligned[:3, :3] @ aligned[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(aligned[:3, :3]) == pytest.approx(1)
    if kind != "mirror":
        aligned = truth_from_estimate(places, aim)
        assert places @ aligned[:3, :3].T + aligned[:3, 3] == pytest.approx(aim, abs=1e-9)


@pytest.mark.parametrize("how", ["none", "origin", "yaw", "se3"])
def test_one_pose_and_no_motion(how):
    for n in (1, 5):
        truth = np.tile(exp_se3(np.arange(6.0)), (n, 1, 1))
        errors = absolute_errors(Trajectories(truth, truth), how)
        assert errors.positions_m == pytest.approx(np.zeros(n), abs=1e-9)
        assert errors.distances_m == pytest.approx(np.zeros(n))
    assert len(absolute_errors(Trajectories(truth[:0], truth[:0]), how)) == 0


def test_a_sensor_that_stood_has_no_drift_and_may_have_failed():
    truth = np.tile(np.eye(4), (30, 1, 1))
    for off_m, failed in ((0.0, 0), (0.9, 0), (1.1, 1)):
        estimate = truth.copy()
        estimate[:, 1, 3] = np.linspace(0, off_m, 30)
        both = Trajectories(estimate, truth)
        scores = score_odometry(both).named()
        assert scores["t_rel"].n == scores["r_rel"].n == 0
        assert math.isnan(scores["t_rel"].value)
        assert scores["end"].value == pytest.approx(off_m)
        assert scores["failed"].value == failed
        stood = score_standing(both, 0.1 * np.arange(30)).named()
        assert stood["false_motion"].value == pytest.approx(off_m)
        curves = by_distance(both)
        assert all(score.n == 0 for score in curves.values())


def test_a_trajectory_shorter_than_all_lengths_has_no_drift():
    both = Trajectories(straight(40), straight(40))
    assert len(drift(both, (50.0, 100.0))) == 0
    assert math.isnan(drift(both, (50.0,)).t_rel)
    # No pose lies beyond 39 m.
    assert len(drift(both, (39.0,), every=1)) == 0
    assert len(drift(both, (38.0,), every=1)) == 1
    assert len(drift(both, ())) == 0
    with pytest.raises(ValueError, match="above 0 m"):
        drift(both, (0.0,))
    with pytest.raises(ValueError, match="1 or more"):
        drift(both, every=0)
    with pytest.raises(ValueError, match="1 or more"):
        relative_errors(both, 0)
    assert len(relative_errors(both, 40)) == 0


def slow_rests(places, stamps):
    intervals, first = [], None
    for k in range(len(places)):
        still = k + 1 < len(places) and np.linalg.norm(places[k + 1] - places[k]) <= AT_REST_M_S * (
            stamps[k + 1] - stamps[k]
        )
        if still and first is None:
            first = k
        if not still and first is not None:
            if stamps[k] - stamps[first] >= LEAST_REST_S - 1e-9:
                intervals.append((first, k))
            first = None
    return intervals


@settings(max_examples=40, deadline=None)
@given(seed=seeds, n=st.integers(0, 80))
def test_rests_equal_the_slow_computation(seed, n):
    rng = np.random.default_rng(seed)
    truth = np.tile(np.eye(4), (n, 1, 1))
    speeds = np.repeat(rng.choice([0.0, 0.05, 3.0], 12), rng.integers(1, 20, 12))[:n]
    truth[: len(speeds), 0, 3] = 0.1 * np.cumsum(speeds)
    truth[len(speeds) :, 0, 3] = 0.1 * speeds.sum()
    stamps = 0.1 * np.arange(n)
    assert rests(Trajectories(truth, truth), stamps) == slow_rests(truth[:, :3, 3], stamps)


def test_what_a_resting_sensor_truly_moves_is_no_false_motion():
    truth = straight(40, 0.005)
    stood = score_standing(Trajectories(truth, truth), 0.1 * np.arange(40)).named()
    assert stood["false_motion"].value == pytest.approx(0, abs=1e-12)


@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_curves_are_read_where_the_trajectory_passes_a_mark(seed):
    rng = np.random.default_rng(seed)
    both = Trajectories(random_trajectory(rng, 130), random_trajectory(rng, 130))
    curves, errors = by_distance(both), absolute_errors(both, "origin")
    for mark_m in MARKS_M:
        score = curves[part_name("position_error", DISTANCE, str(mark_m))]
        beyond = np.flatnonzero(errors.distances_m > mark_m)
        assert score.n == min(len(beyond), 1)
        if len(beyond):
            assert score.value == errors.positions_m[beyond[0]]
        known = drift(both, (float(mark_m),), every=1)
        for metric in ("t_rel", "r_rel"):
            curve = curves[part_name(metric, DISTANCE, str(mark_m))]
            assert curve.n == len(known)
            assert curve.value == pytest.approx(getattr(known, metric), nan_ok=True)


def ahead(estimate_m, truth_m):
    """Poses after steps straight ahead."""
    poses = np.tile(np.eye(4), (2, len(truth_m) + 1, 1, 1))
    poses[:, 1:, 0, 3] = np.cumsum([estimate_m, truth_m], axis=1)
    return Trajectories(*poses), 0.1 * np.arange(len(truth_m) + 1)


def test_false_motion_is_the_farthest_and_the_last_of_a_rest():
    there_and_back = [0.1] * 10 + [-0.08] * 10
    score = score_standing(
        *ahead([2.0] * 5 + there_and_back + [1.0] * 3, [1.0] * 5 + [0.0] * 20 + [1.0] * 3)
    )
    assert score.false_motion.value == pytest.approx(1.0)
    assert score.false_motion_end.value == pytest.approx(0.2)
    assert score.false_motion.n == 21


def test_a_drive_without_rest_has_no_false_motion():
    score = score_standing(*ahead([1.0] * 30, [1.0] * 30))
    assert score.false_motion.n == 0
    assert score.false_motion.weight == 0
    assert score.false_motion_end.n == 0


def test_dynamic_returns_are_counted_over_scans():
    predicted = [np.array([1, 1, 0, 0], bool), np.array([1, 0, 0], bool)]
    true = [np.array([1, 0, 1, 1], bool), np.array([0, 0, 1], bool)]
    scores = score_moving(predicted, true)
    assert scores.dynamic_precision.value == pytest.approx(1 / 3)
    assert scores.dynamic_recall.value == pytest.approx(1 / 4)
    none = score_moving([np.zeros(3, bool)], [np.zeros(3, bool)])
    assert none.dynamic_precision.n == none.dynamic_recall.n == 0
