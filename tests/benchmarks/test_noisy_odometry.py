"""Poses made from truth with errors of known size."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from node_answers import poses_of

from roadscope import Episode, Pose, leaderboard, load_suite
from roadscope.benchmarks import (
    ODOMETRY_NOISES,
    EgoNoise,
    check_ego,
    check_pose_source,
    names_of,
    noisy_poses,
    plan,
)
from roadscope.benchmarks.metrics import Trajectories, score_odometry
from roadscope.benchmarks.nodes import PoseNode
from roadscope.core import SpecError

NONE = {"scale": 0.0, "turn_deg": 0.0, "shift_m": 0.0, "shake_deg": 0.0}
EPISODE = Episode("cold-start", 10001, "vlp16-imu", 1.5)


def bends(n=60, step_m=1.0, yaw_rad=0.02):
    poses, step = [Pose.planar(5.0, -3.0, 0.7)], Pose.planar(step_m, 0.0, yaw_rad)
    for _ in range(n - 1):
        poses.append(poses[-1] @ step)
    return poses


def scored(truth, estimate):
    both = Trajectories(np.array([p.matrix for p in estimate]), np.array([p.matrix for p in truth]))
    return score_odometry(both, lengths_m=(20.0,))


def test_without_errors_poses_are_true():
    truth = bends()
    poses = noisy_poses(EgoNoise(**NONE), truth, 0)
    start = truth[0].inverse()
    assert np.allclose([p.matrix for p in poses], [(start @ p).matrix for p in truth])


@given(st.floats(-0.5, 0.5))
def test_scale_is_the_drift_of_a_straight_path(scale):
    truth = bends(yaw_rad=0.0)
    score = scored(truth, noisy_poses(EgoNoise(**(NONE | {"scale": scale})), truth, 0))
    assert score.t_rel.value == pytest.approx(100 * abs(scale) * 21 / 20, abs=1e-6)
    assert score.end.value == pytest.approx(59 * abs(scale), abs=1e-9)


def test_turn_is_the_drift_of_the_heading():
    truth = bends(step_m=0.5)
    score = scored(truth, noisy_poses(EgoNoise(**(NONE | {"turn_deg": 2.0})), truth, 0))
    assert score.r_rel.value == pytest.approx(2.0 * 20.5 / 20, rel=1e-3)


def test_noise_has_the_spread_that_is_asked_for():
    truth = bends(4000, 0.0, 0.0)
    poses = noisy_poses(EgoNoise(**(NONE | {"shift_m": 0.03})), truth, 1)
    steps = np.diff([p.translation for p in poses], axis=0)
    assert steps.std(axis=0) == pytest.approx(0.03, rel=0.05)


def test_jumps_come_as_often_as_asked_and_stay():
    truth = bends(2000, 0.0, 0.0)
    poses = noisy_poses(EgoNoise(**(NONE | {"jump": 0.05, "jump_m": 3.0})), truth, 2)
    steps = np.diff([p.translation for p in poses], axis=0)
    jumped = np.abs(steps).max(axis=1) > 0
    assert jumped.mean() == pytest.approx(0.05, abs=0.015)
    assert steps[jumped, :2].std() == pytest.approx(3.0, rel=0.2)
    assert not steps[:, 2].any()


def test_the_same_seed_gives_the_same_bytes():
    truth, noise = bends(), EgoNoise(jump=0.2)
    first = noisy_poses(noise, truth, 3)
    assert first == noisy_poses(noise, truth, 3)
    assert first != noisy_poses(noise, truth, 4)
    assert noisy_poses(noise, [], 3) == []


@pytest.mark.parametrize(
    "wrong", ["shift_m=-1", "jump=1.5", "scale=-1", "turn_deg=nan", "turn_deg=inf", "jump_m=x"]
)
def test_wrong_arguments_are_refused(wrong):
    with pytest.raises((ValueError, SpecError)):
        ODOMETRY_NOISES.make(f"noisy-odometry?{wrong}")


def test_an_imitation_is_an_entry_and_gives_trackers_poses():
    spec = "noisy-odometry?scale=0.1"
    check_ego(spec)
    with pytest.raises(SpecError, match="uses no scan that could lack returns"):
        check_pose_source(f"oracle?odometry={spec}")
    with pytest.raises(SpecError, match="jump must be at most 1"):
        check_pose_source("noisy-odometry?jump=2")
    jobs = plan(load_suite("odometry"), [spec], boards=["odometry"], only=True).jobs
    assert {(job.entry, job.mark) for job in jobs} == {(spec, "imitation")}
    assert "noisy-odometry" in {name for name, _ in names_of("odometries")}


def test_an_imitation_has_its_scores_and_no_cost():
    spec = "noisy-odometry?scale=0.1&shift_m=0"
    answers = poses_of(spec, EPISODE)
    assert len(answers.trajectories) == len(answers.stamps_s) > 10
    assert not answers.degraded.any()
    suite = replace(
        load_suite("odometry"),
        scenarios=(EPISODE.scenario,),
        seeds=(EPISODE.seed,),
        duration_s=EPISODE.duration_s,
    ).with_settings("odometry", lengths_m=(10.0,))
    results = leaderboard(suite, [spec], boards=["odometry"], only=True)
    assert not results.failures
    assert results.row("odometry", spec, "t_rel").value == pytest.approx(10, rel=0.3)
    assert results.row("odometry", spec, "call_p50_ms") is None
    assert results.row("odometry", spec, "dynamic_recall") is None


def test_other_arguments_of_an_imitation_are_another_key():
    keys = {
        PoseNode(check_pose_source(f"noisy-odometry?scale={scale}"), EPISODE).key
        for scale in (0.1, 0.1, 0.2)
    }
    assert len(keys) == 2
