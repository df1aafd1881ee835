"""A rig calibrated with a target, as a function and on the command line."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from interrupts import heed_interrupts
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks import (
    CalibrationTrial,
    PoseRow,
    RigCalibration,
    TargetView,
    calibrate_rig,
    calibration_from_views,
    projection_of,
    random_poses,
    save_rig_calibration,
    sufficient_poses,
    target_views,
    true_corners,
)
from roadscope.envs import find_rig
from roadscope.fusion import CalibrationError, TriangularTarget, read_calibration


def true_views(carrier, poses: int, noise_px: float, seed: int = 0) -> list[TargetView]:
    """Corners where they truly are, without scans and images."""
    rng = np.random.default_rng(seed)
    views = []
    for pose in random_poses(carrier, poses, rng):
        corners = true_corners(TriangularTarget(), pose)
        pixels = projection_of(carrier).project(corners)[0]
        views.append(TargetView(corners, pixels + noise_px * rng.standard_normal((3, 2))))
    return views


def calibrated(poses: int, noise_px: float = 0.5, *, outliers=0.0, **settings) -> RigCalibration:
    """Calibrate from corners that are known to half a pixel: no target is sensed."""
    carrier = find_rig("wide")
    views = true_views(carrier, poses, noise_px)
    trial = CalibrationTrial(carrier, **settings)
    return calibration_from_views(trial, views, poses, outliers=outliers)


def test_corners_without_errors_give_the_truth() -> None:
    last = calibrated(8, 0.0).rows[-1]
    assert last.held_out_px < 1e-3
    assert last.position_m < 1e-4
    assert last.rotation_deg < 1e-3


def test_more_poses_are_reported_to_be_better() -> None:
    rows = calibrated(20).rows
    assert [row.poses for row in rows] == [4, 6, 8, 10, 12, 16, 20]
    assert rows[0].held_out_px > rows[-1].held_out_px


def test_the_progress_of_both_stages_is_reported() -> None:
    reported_steps = []
    calibration = calibrate_rig(
        "wide", poses=6, scans=2, progress=lambda *t: reported_steps.append(t)
    )
    assert [row.poses for row in calibration.rows] == [4, 6]
    assert reported_steps[:7] == [("poses", done, 6) for done in range(7)]
    assert reported_steps[7:] == [("solving", done, 2) for done in range(3)]


def test_known_intrinsics_leave_less_to_be_wrong() -> None:
    free, known = (calibrated(6, known_intrinsics=k).rows[-1].rotation_deg for k in (False, True))
    assert known < free


@pytest.mark.slow
def test_misread_corners_are_left_out() -> None:
    clean, spoilt = (calibrated(20, outliers=share) for share in (0.0, 0.3))
    assert clean.result.inliers.all()
    assert (~spoilt.result.inliers).sum() == 6
    assert spoilt.rows[-1].held_out_px < 2 * clean.rows[-1].held_out_px
    with pytest.raises(CalibrationError, match=r"outliers: expected a share from 0 to 0\.5, got 1"):
        calibrate_rig("wide", outliers=1)


@pytest.mark.slow
def test_the_joint_calibration_beats_corners_alone_which_stay_callable() -> None:
    joint = calibrate_rig("li2021", poses=8, seed=3).rows[-1]
    corners = calibrate_rig("li2021", poses=8, seed=3, corners_only=True).rows[-1]
    assert corners.held_out_px == corners.corners_px == joint.corners_px
    assert joint.held_out_px < 0.7 * joint.corners_px
    with pytest.raises(CalibrationError, match="at least 1, got 0"):
        calibrate_rig("li2021", scans=0)


def test_how_many_are_enough() -> None:
    def row(poses, off):
        return PoseRow(poses, 1.0, off, off, 0.0, 0.0)

    assert (
        sufficient_poses([row(4, 3.0), row(6, 1.4), row(8, 1.6), row(10, 1.2), row(12, 1.0)]) == 10
    )
    assert sufficient_poses([row(4, 1.0), row(6, 1.0)]) == 4


def test_what_is_written_is_what_fusion_reads(tmp_path: Path) -> None:
    calibration = calibrated(6)
    for name in ("rig.json", "rig.toml"):
        save_rig_calibration(calibration, tmp_path / name, "a target")
        assert np.allclose(
            read_calibration(tmp_path / name).matrix,
            calibration.result.projection.matrix,
            rtol=1e-12,
        )
    assert json.loads((tmp_path / "rig.json").read_text())["width"] == 640
    assert sorted(p.name for p in tmp_path.iterdir()) == ["rig.json", "rig.toml"]


def test_what_cannot_be_calibrated_is_named() -> None:
    with pytest.raises(CalibrationError, match="at least 4, got 3"):
        calibrate_rig("wide", poses=3)
    with pytest.raises(ValueError, match="rig 'lux' has no camera"):
        calibrate_rig("lux")
    carrier = find_rig("wide")
    few = true_views(carrier, 3, 0.0)
    with pytest.raises(CalibrationError, match="in 3 of 20 poses only, 4 are needed"):
        calibration_from_views(CalibrationTrial(carrier), few, 20)
    tiny = TriangularTarget(base_m=0.05, height_m=0.05)
    with pytest.raises(CalibrationError, match="none of 5 poses showed the target"):
        target_views(carrier, 5, np.random.default_rng(0), target=tiny, scans=1)


def test_the_command_prints_errors_and_a_table(tmp_path: Path) -> None:
    out = tmp_path / "calibration.json"
    result = CliRunner().invoke(
        app, ["calibrate", "--rig", "wide", "--poses", "8", "--scans", "2", "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    for words in ("reprojection error", "camera's pose", "poses", f"written: {out}"):
        assert words in result.output
    assert read_calibration(out).width == 640


def test_the_command_prints_json_alone(tmp_path: Path) -> None:
    out = tmp_path / "calibration.json"
    options = "--rig", "wide", "--poses", "6", "--scans", "2", "--out", str(out)
    table = json.loads(CliRunner().invoke(app, ["calibrate", *options, "--json"]).stdout)
    assert (table["poses"], table["rows"][-1]["poses"]) == (6, table["usable_poses"])
    np.testing.assert_allclose(table["matrix"], read_calibration(out).matrix)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "calibration.png"], "ends in .json or .toml"),
        (["--rig", "lux"], "rig 'lux' has no camera"),
        (["--rig", "nowhere"], "no rig 'nowhere'"),
    ],
)
def test_bad_input_is_one_error(arguments, words) -> None:
    result = CliRunner().invoke(app, ["calibrate", *arguments])
    assert result.exit_code != 0
    assert words in str(result.exception)


@pytest.mark.slow
def test_an_interrupt_ends_it_and_writes_nothing(tmp_path: Path) -> None:
    out = tmp_path / "rig.json"
    command = [sys.executable, "-m", "roadscope", "calibrate", "--poses", "100", "--out", str(out)]
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    assert child.stderr is not None
    assert child.stderr.readline()  # The first line of its progress.
    child.send_signal(signal.SIGINT)
    _, complaint = child.communicate(timeout=60)
    assert child.returncode == 130
    assert complaint.strip().endswith("interrupted")
    assert list(tmp_path.iterdir()) == []
