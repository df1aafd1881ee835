"""`run-odometry` on KITTI's folders as they are on disk: odometry sequences and raw drives."""

import json
from pathlib import Path

import numpy as np
import pytest
from toy_drive import ToyDrive, driven
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.formats import trajectory_text
from roadscope.core import Pose
from roadscope.formats import FormatError, ScanFolder

SCANS = 6
CAMERA_FROM_LIDAR = Pose.from_parts(
    np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.1, -0.08, -0.27])
)
IMU_MOUNT = Pose.from_euler(-0.8, 0.3, -0.8, yaw=0.01)
STAMPS_S = [0.05 + 0.1 * k for k in range(SCANS)]


def text_of(numbers: np.ndarray) -> str:
    return " ".join(f"{value:.12e}" for value in np.ravel(numbers))


def write_scans(folder: Path) -> None:
    folder.mkdir(parents=True)
    for k, (scan, _) in enumerate(driven(SCANS)[1]):
        rows = np.column_stack([scan.points, scan.intensity])
        rows.astype("<f4").tofile(folder / f"{k:010d}.bin")


def run(folder: Path, out: Path, *options: str):
    done = CliRunner().invoke(
        app, ["run-odometry", str(folder), "--out", str(out), "--json", *options]
    )
    return done, json.loads(done.stdout) if done.exit_code == 0 else {}


@pytest.fixture(scope="module")
def sequence(tmp_path_factory) -> Path:
    """A sequence of KITTI odometry; `poses` beside the sequences has those of the camera."""
    root = tmp_path_factory.mktemp("odometry")
    folder = root / "sequences" / "00"
    write_scans(folder / "velodyne")
    (folder / "times.txt").write_text("".join(f"{s:.6e}\n" for s in STAMPS_S))
    (folder / "calib.txt").write_text(f"Tr: {text_of(CAMERA_FROM_LIDAR.matrix[:3])}\n")
    mount = CAMERA_FROM_LIDAR
    first = Pose(ToyDrive().pose(STAMPS_S[0])).inverse()
    poses = [mount @ first @ Pose(ToyDrive().pose(s)) @ mount.inverse() for s in STAMPS_S]
    (root / "00.txt").write_text(trajectory_text("kitti", poses, ()))
    return folder


@pytest.mark.parametrize("below", ["", "velodyne"])
def test_a_sequence_is_found_and_poses_of_its_camera_are_brought_to_the_lidar(
    sequence, below, tmp_path
):
    truth = str(sequence.parent.parent / "00.txt")
    done, report = run(sequence / below, tmp_path / "poses.txt", "--truth", truth)
    assert done.exit_code == 0, done.output
    assert report["scans"] == SCANS
    assert report["errors"]["end_m"] < 0.25
    assert "no times.txt" not in done.stderr


def test_poses_of_a_camera_are_refused_without_a_calibration(sequence, tmp_path):
    calibration = sequence / "calib.txt"
    calibration.rename(sequence / "hidden")
    try:
        truth = str(sequence.parent.parent / "00.txt")
        done, _ = run(sequence, tmp_path / "poses.txt", "--truth", truth)
    finally:
        (sequence / "hidden").rename(calibration)
    assert "its z axis points ahead" in str(done.exception)
    assert isinstance(done.exception, FormatError)


@pytest.fixture(scope="module")
def raw_drive(tmp_path_factory) -> Path:
    """A raw drive with unsynchronised IMU records."""
    date = tmp_path_factory.mktemp("raw") / "2011_09_26"
    drive = date / "2011_09_26_drive_0009_extract"
    write_scans(drive / "velodyne_points" / "data")
    day = np.datetime64("2011-09-26T13:02:25", "ns")

    def stamps(seconds) -> str:
        texts = (str(day + np.timedelta64(round(1e9 * s), "ns")) for s in seconds)
        return "".join(f"{text.replace('T', ' ')}\n" for text in texts)

    (drive / "velodyne_points" / "timestamps.txt").write_text(stamps(STAMPS_S))
    (drive / "oxts" / "data").mkdir(parents=True)
    back, samples = IMU_MOUNT.rotation, [imu for _, imu in driven(SCANS)[1]]
    seconds = np.concatenate([imu.stamps_s for imu in samples])
    rates, forces = (
        np.concatenate([getattr(imu, name) for imu in samples]) @ back
        for name in ("angular_velocity", "specific_force")
    )
    (drive / "oxts" / "timestamps.txt").write_text(stamps(seconds))
    for k in range(len(seconds)):
        row = np.zeros(30)
        row[11:14], row[17:20] = forces[k], rates[k]
        (drive / "oxts" / "data" / f"{k:010d}.txt").write_text(text_of(row))
    (date / "calib_imu_to_velo.txt").write_text(
        f"calib_time: 25-May-2012 16:47:16\nR: {text_of(back)}\nT: {text_of([-0.8, 0.3, -0.8])}\n"
    )
    return drive


@pytest.mark.parametrize("below", ["", "velodyne_points/data"])
def test_a_raw_drive_has_dates_and_an_imu_with_its_mounting(raw_drive, below, tmp_path):
    scans = ScanFolder.find(raw_drive / below)
    assert np.diff(scans.stamps_s) == pytest.approx([0.1] * (SCANS - 1), abs=1e-6)
    done, report = run(raw_drive / below, tmp_path / "poses.txt")
    assert done.exit_code == 0, done.output
    assert "with 240 inertial samples of" in done.stderr
    assert "--mounting" not in done.stderr
    truth = np.linalg.inv(ToyDrive().pose(STAMPS_S[0])) @ ToyDrive().pose(STAMPS_S[-1])
    assert report["last_position_m"] == pytest.approx(truth[:3, 3], abs=0.25)


def test_dates_are_refused_by_line(raw_drive, tmp_path):
    lines = (raw_drive / "velodyne_points" / "timestamps.txt").read_text().splitlines()
    folder = tmp_path / "velodyne_points"
    write_scans(folder / "data")
    (folder / "timestamps.txt").write_text("\n".join([*lines[:3], "soon", *lines[4:]]))
    with pytest.raises(FormatError, match="line 4: expected a date and a time"):
        ScanFolder.find(tmp_path)
