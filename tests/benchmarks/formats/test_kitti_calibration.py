"""KITTI's calibrations and poses: what they say, and how malformed ones are refused."""

from pathlib import Path

import numpy as np
import pytest
from toy_kitti import EGO_SPEED_M_S, FRAMES, write_kitti

from roadscope.benchmarks.formats import CAMERA_FROM_EGO, EGO_FROM_CAMERA
from roadscope.core import Pose
from roadscope.formats import (
    FormatError,
    read_kitti_calibration,
    read_kitti_oxts,
    read_kitti_poses,
    read_kitti_sequence,
)

POSE = "1 0 0 0 0 1 0 0 0 0 1 0"
CAMERA = f"P2: {POSE}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_kitti(tmp_path / "kitti")


def test_calibration_needs_its_keys(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text("P0: " + "1 " * 12)
    with pytest.raises(FormatError, match="expected the key P2, got P0"):
        read_kitti_calibration(path)
    path.write_text("P0: 1\nP2: " + "1 " * 11)
    with pytest.raises(FormatError, match="line 1: expected 12 finite numbers after P0"):
        read_kitti_calibration(path)
    path.write_text(
        CAMERA + "\nR_rect 9 0 0 0 1 0 0 0 1\nTr_velo_cam " + POSE + "\nTr_imu_velo " + POSE
    )
    with pytest.raises(FormatError, match=r"expected rotations in R0_rect, .*; R0_rect has none"):
        read_kitti_calibration(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("P2: " + "0 " * 12, "line 1: expected after P2 a projection: .* of rank 3, got '0 0"),
        (f"{CAMERA}\n\n{CAMERA}", "line 3: expected the key P2 once, got 'P2 a second time'"),
        (CAMERA.replace("1", "1e200", 1), r"line 1: expected numbers from -1e\+09 to 1e\+09 after"),
        (f"{CAMERA}\nR0_rect: 1\n", "line 2: expected 9 finite numbers after R0_rect, got '1'"),
    ],
)
def test_calibrations_that_no_camera_has_are_refused(tmp_path, text, message):
    path = tmp_path / "0000.txt"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as caught:
        read_kitti_calibration(path)
    assert str(caught.value).startswith(f"{path}, line ")


def test_poses_come_back(tmp_path):
    rng = np.random.default_rng(3)
    poses = [
        Pose.from_euler(*rng.normal(0, 50, 3), yaw=a, pitch=b, roll=c)
        for a, b, c in rng.normal(0, 1, (20, 3))
    ]
    rows = [(CAMERA_FROM_EGO @ p @ EGO_FROM_CAMERA).matrix[:3].ravel() for p in poses]
    np.savetxt(tmp_path / "poses.txt", rows)
    for one, other in zip(read_kitti_poses(tmp_path / "poses.txt"), poses, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-9)


def test_a_pose_that_does_not_turn_rigidly_is_refused(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(POSE + "\n" + POSE.replace("1", "2") + "\n")
    with pytest.raises(FormatError, match="line 2: expected a rotation"):
        read_kitti_poses(path)
    path.write_text(POSE[:-1] + "1e200\n")
    with pytest.raises(FormatError, match=r"line 1: expected r00 .* t2 from -1e\+08 to 1e\+08 m"):
        read_kitti_poses(path)


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("49 1e200 110 0 0 0", "line 1: expected lon from -360 to 360 degrees, got '1e200'"),
        ("49 8 1e200 0 0 0", r"line 1: expected alt from -1e\+08 to 1e\+08 m"),
        ("49 8 110 0 0 100", "line 1: expected roll pitch yaw from -12.5664 to 12.5664 rad"),
    ],
)
def test_records_of_nowhere_on_earth_are_refused(folder, place, message):
    path = folder / "oxts.txt"
    path.write_text(place + " 0" * 24)
    with pytest.raises(FormatError, match=message):
        read_kitti_oxts(path, read_kitti_calibration(folder / "calib" / "0000.txt"))


def test_the_inertial_unit_gives_poses_too(folder):
    """The same drive north and as camera poses: motion in the ego's own frame is the same."""
    calibration = read_kitti_calibration(folder / "calib" / "0000.txt")
    metres = np.arange(FRAMES) * EGO_SPEED_M_S * 0.1
    degrees = 49 + np.rad2deg(metres / 6378137.0)
    rows = [f"{lat:.12f} 8.4 110 0 0 {np.pi / 2}" + " 0" * 24 for lat in degrees]
    (folder / "oxts").mkdir()
    path = folder / "oxts" / "0000.txt"
    path.write_text("\n".join(rows))
    unit = read_kitti_oxts(path, calibration)
    camera = read_kitti_poses(folder / "ego_pose" / "0000.txt")
    for poses in (unit, camera):
        step = poses[0].inverse() @ poses[-1]
        np.testing.assert_allclose(step.translation, [metres[-1], 0, 0], atol=1e-3)
        np.testing.assert_allclose(step.rotation, np.eye(3), atol=1e-9)
    assert unit[0].yaw == pytest.approx(np.pi / 2)
    (folder / "ego_pose" / "0000.txt").unlink()
    assert read_kitti_sequence(folder, "0000").world_from_ego[0] == unit[0]


def test_oxts_without_calibration_of_the_unit_is_refused(tmp_path):
    (tmp_path / "calib.txt").write_text(CAMERA)
    calibration = read_kitti_calibration(tmp_path / "calib.txt")
    with pytest.raises(
        FormatError, match="a calibration with R0_rect, Tr_velo_to_cam, Tr_imu_to_velo"
    ):
        read_kitti_oxts(tmp_path / "oxts.txt", calibration)
