"""LiDARs whose x axis does not point ahead: scans show where they drive to."""

import json
from pathlib import Path

import numpy as np
import pytest
from toy_drive import ScansInMemory, ToyDrive, driven
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks import Episode, drive
from roadscope.benchmarks.formats import trajectory_text
from roadscope.core import Pose
from roadscope.formats import read_trajectory
from roadscope.odometry import ODOMETRIES, direction_of_travel, turned_back, turned_scan

SCANS = 30
TRUTH = [Pose(ToyDrive().pose(0.05 + 0.1 * k)) for k in range(SCANS)]


def lidar_from_ahead(degrees: float) -> Pose:
    return Pose.from_euler(0, 0, 0, yaw=np.deg2rad(degrees))


def record(folder: Path, mount: Pose) -> Path:
    """Write scans and IMU samples in the axes of a LiDAR that is mounted otherwise."""
    blocks = []
    for k, (scan, imu) in enumerate(driven(SCANS)[1]):
        points = scan.points @ mount.rotation.T
        np.save(folder / f"{k}.npy", np.column_stack([points, scan.intensity, scan.time_offset_s]))
        turned = [
            getattr(imu, name) @ mount.rotation.T for name in ("angular_velocity", "specific_force")
        ]
        blocks.append(np.column_stack([imu.stamps_s, *turned]))
    (folder / "times.txt").write_text("".join(f"{0.05 + 0.1 * k}\n" for k in range(SCANS)))
    np.savetxt(folder / "imu.csv", np.vstack(blocks), delimiter=",")
    poses = [mount @ pose @ mount.inverse() for pose in TRUTH]
    (folder / "truth.txt").write_text(trajectory_text("kitti", poses, ()))
    return folder


def run(folder: Path, *options: str):
    out = str(folder / "poses.txt")
    line = [
        "run-odometry",
        str(folder),
        "--out",
        out,
        "--truth",
        str(folder / "truth.txt"),
        "--json",
    ]
    done = CliRunner().invoke(app, [*line, *options])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout), done.stderr


@pytest.mark.parametrize("degrees", [30, 180, -90])
def test_scans_are_turned_to_where_they_drive_and_poses_are_the_lidars(tmp_path, degrees):
    folder = record(tmp_path, lidar_from_ahead(degrees))
    report, log = run(folder)
    assert "the LiDAR drives to" in log
    assert report["errors"]["end_m"] < 0.3
    assert sum(report["degraded"].values()) <= 3
    last = read_trajectory(folder / "poses.txt", "kitti").poses[-1]
    expected_pose = lidar_from_ahead(degrees) @ TRUTH[-1]
    assert last.translation == pytest.approx(expected_pose.translation, abs=0.3)


def test_a_lidar_with_its_x_axis_ahead_is_left_alone(tmp_path):
    assert "drives to" not in run(record(tmp_path, Pose.identity()))[1]


def test_an_unobservable_direction_is_reported(tmp_path):
    folder = record(tmp_path, Pose.identity())
    for k in range(1, SCANS):
        (folder / f"{k}.npy").write_bytes((folder / "0.npy").read_bytes())
    log = run(folder, "--imu", "none")[1]
    assert "scans do not show where the LiDAR drives to: its x axis is taken to point ahead" in log


def test_a_mounting_that_is_given_is_not_doubted(tmp_path):
    """Also one that is tilted, which scans do not show."""
    roll, yaw = 90.0, 40.0
    mount = Pose.from_euler(0, 0, 0, roll=np.deg2rad(roll), yaw=np.deg2rad(yaw))
    folder = record(tmp_path, mount.inverse())
    report, log = run(folder, "--lidar-mounting", f"0,0,0,{roll},0,{yaw}")
    assert "drives to" not in log
    assert report["errors"]["end_m"] < 0.3


def test_a_mounting_that_scans_contradict_is_reported(tmp_path):
    log = run(record(tmp_path, Pose.identity()), "--lidar-mounting", "0,0,0,0,0,180")[1]
    assert "is --lidar-mounting right?" in log


@pytest.mark.parametrize("odometry", ["voxel-map"])
def test_estimates_of_turned_scans_come_back_as_those_of_the_scans(odometry):
    turn = Pose.from_euler(0, 0, 0, yaw=0.7)
    plain, turned = ODOMETRIES.make(odometry), ODOMETRIES.make(odometry)
    for scan, _ in driven(8)[1]:
        one = plain.update(scan)
        other = turned_back(turned.update(turned_scan(scan, turn.rotation)), turn)
        assert other.start_from_lidar.matrix == pytest.approx(one.start_from_lidar.matrix, abs=0.02)
        assert np.trace(other.covariance) == pytest.approx(np.trace(one.covariance), rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario", ["stop-and-go", "dense-motorway", "convoy-pull-away", "motorway", "racetrack-loop"]
)
def test_traffic_around_turns_no_lidar(scenario):
    """Matches that moving objects mislead point anywhere."""
    scans = [step.scan for step in drive(Episode(scenario, 10000, "vlp16-imu", 10.0))]
    azimuth = direction_of_travel(ScansInMemory(scans))  # type: ignore[arg-type]
    assert azimuth is None or abs(azimuth) < np.deg2rad(15)
