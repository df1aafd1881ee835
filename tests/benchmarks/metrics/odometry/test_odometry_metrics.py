"""Errors of trajectories equal a slow computation and other programs, and obey invariants."""

import io
import math
import os
import shutil
import subprocess
import zipfile

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from roadscope.benchmarks.metrics import (
    KITTI_M,
    Trajectories,
    absolute_errors,
    drift,
    relative_errors,
    score_odometry,
)
from roadscope.core import RecordError
from roadscope.odometry import exp_se3

ALIGNMENTS = ("none", "origin", "yaw", "se3")


def drive(seed, n=300, speed=1.0, noise=0.01):
    """A winding way in space, and the same with errors that add up."""
    rng = np.random.default_rng(seed)
    steps = np.tile([speed, 0, 0, 0, 0, 0], (n, 1)) + 0.02 * rng.standard_normal((n, 6))
    truth, estimate = [exp_se3(rng.standard_normal(6))], [exp_se3(rng.standard_normal(6))]
    for step in steps[1:]:
        truth.append(truth[-1] @ exp_se3(step))
        estimate.append(estimate[-1] @ exp_se3(step + noise * rng.standard_normal(6)))
    return Trajectories(np.array(estimate), np.array(truth))


def turned(rotation):
    return np.linalg.norm(Rotation.from_matrix(rotation).as_rotvec())


def aligned_slowly(both, how):
    if how == "none":
        return both.estimate
    if how == "origin":
        return np.array(
            [both.truth[0] @ np.linalg.inv(both.estimate[0]) @ e for e in both.estimate]
        )
    start, aim = both.estimate[:, :3, 3], both.truth[:, :3, 3]
    mean, goal = start.mean(axis=0), aim.mean(axis=0)
    if how == "se3":
        rotation = Rotation.align_vectors(aim - goal, start - mean)[0].as_matrix()
    else:
        c, s = (start - mean)[:, :2], (aim - goal)[:, :2]

        def squares(yaw):
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            return ((s - c @ turn.T) ** 2).sum()

        about = min(np.linspace(-np.pi, np.pi, 361), key=squares)
        yaw = minimize_scalar(squares, (about - 0.02, about, about + 0.02), tol=1e-12).x
        rotation = Rotation.from_rotvec([0, 0, yaw]).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, goal - rotation @ mean
    return np.array([matrix @ e for e in both.estimate])


@pytest.mark.parametrize("how", ALIGNMENTS)
@pytest.mark.parametrize("seed", range(3))
def test_absolute_errors_equal_the_slow_computation(how, seed):
    both = drive(seed)
    errors = absolute_errors(both, how)
    moved = aligned_slowly(both, how)
    slow = [np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in zip(moved, both.truth, strict=True)]
    turns = [turned(b[:3, :3].T @ a[:3, :3]) for a, b in zip(moved, both.truth, strict=True)]
    near = 1e-5 if how == "yaw" else 1e-8
    assert errors.positions_m == pytest.approx(slow, abs=near)
    assert errors.rotations_rad == pytest.approx(turns, abs=near)


def test_no_alignment_is_better_than_the_best():
    for seed in range(5):
        both = drive(seed)
        whole = absolute_errors(both, "se3").rmse_m
        assert whole <= absolute_errors(both, "yaw").rmse_m <= absolute_errors(both, "none").rmse_m
        assert whole <= absolute_errors(both, "origin").rmse_m


@pytest.mark.parametrize("step", [1, 7])
def test_relative_errors_equal_the_slow_computation(step):
    both = drive(3)
    errors = relative_errors(both, step)
    for k in range(len(both) - step):
        true = np.linalg.inv(both.truth[k]) @ both.truth[k + step]
        estimated_motion = np.linalg.inv(both.estimate[k]) @ both.estimate[k + step]
        rest = np.linalg.inv(true) @ estimated_motion
        assert errors.translations_m[k] == pytest.approx(np.linalg.norm(rest[:3, 3]), abs=1e-10)
        assert errors.rotations_rad[k] == pytest.approx(turned(rest[:3, :3]), abs=1e-10)
    assert len(errors) == len(both) - step
    assert errors.rmse_m == pytest.approx(math.sqrt(np.mean(errors.translations_m**2)))
    assert errors.rmse_rad == pytest.approx(math.sqrt(np.mean(errors.rotations_rad**2)))
    none = relative_errors(both, len(both))
    assert math.isnan(none.rmse_m)
    assert math.isnan(none.rmse_rad)


def slow_kitti_drift(both, lengths, every):
    """Return the errors of KITTI's definition, computed segment by segment."""
    distances_m = [0.0]
    for a, b in zip(both.truth[:-1], both.truth[1:], strict=True):
        distances_m.append(distances_m[-1] + math.dist(a[:3, 3], b[:3, 3]))
    rows = []
    for first in range(0, len(both), every):
        for length in lengths:
            last = next(
                (
                    k
                    for k in range(first, len(both))
                    if distances_m[k] > distances_m[first] + length
                ),
                None,
            )
            if last is None:
                continue
            true = np.linalg.inv(both.truth[first]) @ both.truth[last]
            estimated_motion = np.linalg.inv(both.estimate[first]) @ both.estimate[last]
            rest = np.linalg.inv(estimated_motion) @ true
            rows.append((np.linalg.norm(rest[:3, 3]) / length, turned(rest[:3, :3]) / length))
    return np.array(rows).reshape(-1, 2)


@pytest.mark.parametrize(("lengths", "every"), [((50, 100, 200), 1), (KITTI_M, 10)])
def test_drift_is_kittis(lengths, every):
    both = drive(5, n=600)
    errors, slow = drift(both, lengths, every=every), slow_kitti_drift(both, lengths, every)
    assert len(errors) == len(slow) > 50
    assert errors.translations == pytest.approx(slow[:, 0], abs=1e-10)
    assert errors.rotations == pytest.approx(slow[:, 1], abs=1e-10)
    assert errors.t_rel == pytest.approx(100 * slow[:, 0].mean())
    assert [n for *_, n in errors.curve()] == [
        (errors.lengths_m == m).sum() for m in lengths if m in errors.lengths_m
    ]


@pytest.mark.parametrize("seed", [6, 60, 61, 62, 63])
def test_kiss_icp_agrees_on_drift(seed):
    metrics = pytest.importorskip("kiss_icp.metrics", exc_type=ImportError)
    both = drive(seed, n=900)
    t_rel, r_rel = metrics.sequence_error(list(both.truth), list(both.estimate))
    ours = drift(both, KITTI_M)
    assert t_rel == pytest.approx(ours.t_rel, rel=1e-6)
    # Its degrees are computed with 3.14 and given for one metre.
    assert 100 * r_rel * 3.14 / math.pi == pytest.approx(ours.r_rel, rel=1e-6)


def run_evo(folder, program, *arguments):
    """Run one of evo's programs, in the folders of ROADSCOPE_WITNESSES or on the path."""
    executable = shutil.which(
        program, path=os.environ.get("ROADSCOPE_WITNESSES", os.environ["PATH"])
    )
    if executable is None:
        pytest.skip(f"{program} is not installed")
    result = folder / "result.zip"
    command = [executable, *arguments, "--save_results", str(result), "--no_warnings"]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run(
        command, capture_output=True, text=True, check=True, env=environment | {"HOME": str(folder)}
    )
    with zipfile.ZipFile(result) as files, files.open("error_array.npy") as array:
        return np.load(io.BytesIO(array.read()))


@pytest.fixture(params=[7, 70, 71])
def written(request, tmp_path):
    both = drive(request.param)
    for name in ("truth", "estimate"):
        rows = getattr(both, name)[:, :3].reshape(-1, 12)
        np.savetxt(tmp_path / f"{name}.txt", rows, fmt="%.17g")
    return both, [str(tmp_path / "truth.txt"), str(tmp_path / "estimate.txt")]


@pytest.mark.parametrize(
    ("how", "options"), [("none", []), ("se3", ["--align"]), ("origin", ["--align_origin"])]
)
def test_evo_agrees_on_absolute_errors(written, tmp_path, how, options):
    both, files = written
    ours = absolute_errors(both, how)
    for relation, values in (("trans_part", ours.positions_m), ("angle_rad", ours.rotations_rad)):
        evo_errors = run_evo(tmp_path, "evo_ape", "kitti", *files, "-r", relation, *options)
        assert values == pytest.approx(evo_errors, abs=1e-8)


@pytest.mark.parametrize("step", [1, 5])
def test_evo_agrees_on_relative_errors(written, tmp_path, step):
    both, files = written
    ours = relative_errors(both, step)
    options = ["--delta", str(step), "--delta_unit", "f", "--all_pairs"]
    for relation, values in (
        ("trans_part", ours.translations_m),
        ("angle_rad", ours.rotations_rad),
    ):
        evo_errors = run_evo(tmp_path, "evo_rpe", "kitti", *files, "-r", relation, *options)
        assert values == pytest.approx(evo_errors, abs=1e-8)


def test_perfect_poses_have_no_error():
    both = drive(8, noise=0.0)
    scores = score_odometry(both).named()
    assert scores.pop("below_1").value == 1
    for score in scores.values():
        assert score.value == pytest.approx(0, abs=1e-9)


def test_frames_do_not_matter_where_they_should_not():
    both = drive(9)
    elsewhere = exp_se3(np.array([100.0, -3, 2, 0.4, 0.3, 2]))
    moved = Trajectories(elsewhere @ both.estimate, both.truth)
    before, after = score_odometry(both).named(), score_odometry(moved).named()
    for name in before:
        assert before[name].value == pytest.approx(after[name].value, abs=1e-8)


def test_scores_say_unit_direction_and_number():
    both = drive(10, n=150, noise=1e-4)
    scores = score_odometry(both).named()
    assert {name: s.unit for name, s in scores.items()}["r_rel"] == "deg/100m"
    assert {name for name, s in scores.items() if s.better == "higher"} == {"below_1"}
    assert scores["ate"].n == 150
    assert scores["rpe"].n == 149
    assert scores["failed"].value == 0
    assert scores["error_min"].value <= scores["error_mean"].value <= scores["error_max"].value


def test_standing_still_while_moving_is_failing():
    both = drive(11)
    still = Trajectories(np.tile(both.truth[0], (len(both), 1, 1)), both.truth)
    scores = score_odometry(still)
    assert scores.failed.value == 1
    assert scores.below_1.value == 0
    assert scores.t_rel.value > 90


@pytest.mark.parametrize("n", [0, 1, 2])
def test_short_trajectories_have_no_drift(n):
    whole = drive(12, n=3)
    scores = score_odometry(Trajectories(whole.estimate[:n], whole.truth[:n]))
    assert math.isnan(scores.t_rel.value)
    assert scores.t_rel.n == 0
    assert math.isnan(scores.ate.value) == (n == 0)


def test_poses_a_little_askew_are_put_right_and_others_refused():
    both = drive(14)
    seven_digits = np.array([[[float(f"{v:.6e}") for v in row] for row in p] for p in both.truth])
    assert absolute_errors(Trajectories(seven_digits, both.truth), "none").rmse_m < 1e-3
    with pytest.raises(RecordError, match=r"Trajectories\.estimate: expected rigid motions"):
        Trajectories(1.1 * both.estimate, both.truth)
    with pytest.raises(RecordError, match="N = 300"):
        Trajectories(both.estimate, both.truth[1:])
