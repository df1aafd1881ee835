"""An odometry on a folder of scans, by function and by command."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from interrupts import heed_interrupts
from toy_bags import cloud, imu, write_bag
from toy_drive import ToyDrive, driven
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.formats import trajectory_text
from roadscope.benchmarks.isolation import PluginError
from roadscope.core import Pose
from roadscope.formats import read_trajectory

RUNNER = CliRunner()


@pytest.fixture
def folder(tmp_path):
    for k, (scan, _) in enumerate(driven(6)[1]):
        rows = np.column_stack([scan.points, scan.intensity, scan.time_offset_s])
        np.save(tmp_path / f"{k}.npy", rows)
    return tmp_path


def run_odometry(folder, *options):
    out = folder / "poses.txt"
    return RUNNER.invoke(app, ["run-odometry", str(folder), "--out", str(out), *options]), out


@pytest.mark.parametrize("form", ["kitti", "tum"])
def test_poses_are_written(folder, form):
    done, out = run_odometry(folder, "--format", form)
    assert done.exit_code == 0, done.output
    assert f"written: {out}" in done.stdout
    trajectory = read_trajectory(out, form)
    truth = driven(6)[0].pose(0.55)
    assert np.linalg.norm(trajectory.poses[-1].translation - truth[:3, 3]) < 0.1


@pytest.mark.parametrize("mcap", [False, True])
def test_a_bag_of_ros_has_scans_and_imu(folder, mcap):
    messages = []
    for scan, inertial in driven(6)[1]:
        names = {"t": scan.time_offset_s + np.float32(0.05), "intensity": scan.intensity}
        fields = {**dict(zip("xyz", scan.points.T, strict=True)), **names}
        start_s = scan.stamp_s - 0.05
        messages.append((start_s, "/points", cloud(start_s, fields)))
        samples = zip(
            inertial.stamps_s, inertial.angular_velocity, inertial.specific_force, strict=True
        )
        messages += [(s, "/imu", imu(s, rate, force)) for s, rate, force in samples]
    bag = write_bag(folder / "bag", messages, mcap=mcap)
    done, out = run_odometry(bag, "--format", "tum")
    assert done.exit_code == 0, done.output
    assert f"with {40 * 6} inertial samples of {bag}" in done.stderr
    trajectory = read_trajectory(out, "tum")
    assert np.diff(trajectory.stamps_s) == pytest.approx(np.full(5, 0.1), abs=1e-3)
    truth = driven(6)[0].pose(0.55)
    assert np.linalg.norm(trajectory.poses[-1].translation - truth[:3, 3]) < 0.1
    done, _ = run_odometry(bag, "--imu", "none", "--odometry", "still")
    assert done.exit_code == 0, done.output
    assert "inertial samples" not in done.stderr
    done, _ = run_odometry(bag, "--topic", "/odom")
    assert "no topic '/odom'" in str(done.exception)


def test_after_an_interrupt_poses_are_kept(folder, monkeypatch):
    from roadscope.odometry import StillOdometry

    update = StillOdometry.update

    def interrupted(self, scan, imu=None):
        if scan.stamp_s > 0.25:
            raise KeyboardInterrupt
        return update(self, scan, imu)

    monkeypatch.setattr(StillOdometry, "update", interrupted)
    done, out = run_odometry(folder, "--odometry", "still")
    assert done.exit_code != 0
    assert "3 of 6 poses are kept" in done.stderr
    assert len(read_trajectory(out, "kitti").poses) == 3


def test_a_scan_that_cannot_be_read_is_empty_and_reported(folder):
    (folder / "4.npy").write_bytes(b"nothing")
    done, out = run_odometry(folder, "--odometry", "still")
    assert done.exit_code == 0, done.output
    assert "1 scan is taken as empty: " in done.stderr
    assert "4.npy: expected an array saved by numpy" in done.stderr
    assert len(read_trajectory(out, "kitti").poses) == 6


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--odometry", "stil"], "no odometry 'stil' (did you mean 'still'?)"),
        (["--format", "evo"], "no format of trajectories 'evo'"),
        (["--rate-hz", "0"], "a rate above 0 Hz"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_written(folder, options, message):
    done, out = run_odometry(folder, *options)
    assert done.exit_code != 0
    assert message in str(done.exception)
    assert not out.exists()


MOUNTED = Pose.from_euler(0, 0, 0, yaw=np.pi / 2)


@pytest.fixture
def recording(folder):
    """The scans with times, samples of an IMU that is turned, and the truth in both formats."""
    stamps = [0.05 + 0.1 * k for k in range(6)]
    (folder / "times.txt").write_text("".join(f"{s:.9f}\n" for s in stamps))
    blocks = [imu for _, imu in driven(6)[1]]
    back = MOUNTED.rotation
    rows = np.vstack(
        [
            np.column_stack([i.stamps_s, i.angular_velocity @ back, i.specific_force @ back])
            for i in blocks
        ]
    )
    np.savetxt(
        folder / "imu.csv", rows, delimiter=",", header="stamp,wx,wy,wz,ax,ay,az", comments=""
    )
    truth = [Pose(ToyDrive().pose(s)) for s in np.arange(0, 0.7, 0.05)]
    times = np.arange(0, 0.7, 0.05).tolist()
    (folder / "truth.tum").write_text(trajectory_text("tum", truth, times))
    (folder / "truth.kitti").write_text(trajectory_text("kitti", truth[1:12:2], stamps))
    return folder


def command(folder, *options, **environment):
    """Run the command in a process of its own, 80 columns wide."""
    line = [sys.executable, "-m", "roadscope", "run-odometry", str(folder), *options]
    return subprocess.run(
        line,
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=120,
        env=os.environ | {"COLUMNS": "80"} | environment,
    )


def test_json_has_what_is_printed(recording):
    truth = str(recording / "truth.tum")
    done, out = run_odometry(recording, "--mounting", "0,0,0,0,0,90", "--truth", truth, "--json")
    report, poses = json.loads(done.stdout), read_trajectory(out, "kitti").poses
    assert (report["odometry"], report["scans"]) == ("lidar-inertial", 6)
    assert 0 < sum(report["degraded"].values()) < 6
    assert report["last_position_m"] == pytest.approx(poses[-1].translation, abs=1e-6)
    assert 0 < report["errors"]["end_m"] < 0.2
    done, _ = run_odometry(recording, "--mounting", "0,0,0,0,0,90", "--truth", truth, "--quiet")
    assert done.stdout == ""


@pytest.mark.parametrize("name", ["truth.tum", "truth.kitti"])
def test_imu_mounting_and_truth(recording, name):
    done, _ = run_odometry(
        recording, "--mounting", "0,0,0,0,0,90", "--truth", str(recording / name)
    )
    assert done.exit_code == 0, done.output
    assert f"with 240 inertial samples of {recording / 'imu.csv'}" in done.stderr
    assert f"compared with {recording / name}: 4.0 m: ATE 0.0" in done.stdout
    assert "too short for t_rel over 50 m" in done.stdout


@pytest.mark.parametrize(
    ("step_m", "lengths_m", "printed"),
    [(15.0, [50], "over 50 m"), (40.0, [50, 100], "over 50 to 100 m"), (9.0, [], "too short")],
)
def test_drift_is_over_lengths_that_the_drive_has(folder, step_m, lengths_m, printed):
    truth = folder / "truth.kitti"
    poses = [Pose.planar(step_m * k, 0.0, 0.0) for k in range(6)]
    truth.write_text(trajectory_text("kitti", poses, range(6)))
    options = "--imu", "none", "--odometry", "still", "--truth", str(truth)
    done, _ = run_odometry(folder, *options)
    assert printed in done.stdout
    done, _ = run_odometry(folder, *options, "--json")
    assert json.loads(done.stdout)["errors"]["lengths_m"] == lengths_m


TELLING = """
from dataclasses import replace
from roadscope.core import Pose
from roadscope.odometry.still import StillOdometry

class Telling(StillOdometry):
    takes_imu = True

    def reset(self, lidar_from_imu=None):
        super().reset(lidar_from_imu)
        self.yaw, self.count = lidar_from_imu.yaw if lidar_from_imu else 0.0, 0

    def update(self, scan, imu=None):
        late = imu is not None and imu.stamps_s[-1] > scan.stamp_s + 0.05
        self.count += -1 if imu is None else 1000 * late + len(imu.stamps_s)
        return replace(super().update(scan, imu), start_from_lidar=Pose.planar(
            self.count, 0.0, self.yaw))
"""


ROLLING = (
    TELLING
    + """
    def add_wheels(self, wheels):
        self.count += 100 * len(wheels.stamps_s) + round(wheels.speeds.sum())
"""
)


def rolled(folder, *options):
    plugin = folder / "rolling.py"
    plugin.write_text(ROLLING)
    done, out = run_odometry(folder, "--imu", "none", "--odometry", f"{plugin}:Telling", *options)
    assert done.exit_code == 0, done.output
    return [round(p.translation[0]) for p in read_trajectory(out, "kitti").poses], done.stderr


def test_wheel_speeds_are_handed_on_up_to_the_end_of_each_sweep(recording):
    stamps = 0.01 + 0.02 * np.arange(30)
    np.savetxt(
        recording / "wheels.csv",
        np.column_stack([stamps, np.full(30, 8.0)]),
        delimiter=",",
        header="stamp,speed",
        comments="",
    )
    counts, printed = rolled(recording)
    assert counts == [(540 - 1) * k for k in range(1, 7)]
    assert f"with 30 wheel speeds of {recording / 'wheels.csv'}" in printed
    counts, printed = rolled(recording, "--wheels", "none")
    assert counts == [-1, -2, -3, -4, -5, -6]
    assert "wheel" not in printed


@pytest.mark.slow
def test_wheels_are_for_odometries_that_take_them(recording):
    np.savetxt(recording / "rolled.txt", [[0.0, 8.0], [0.5, 8.0]])
    done, _ = run_odometry(
        recording,
        "--odometry",
        "lidar-inertial?wheels=true",
        "--wheels",
        str(recording / "rolled.txt"),
    )
    assert "with 2 wheel speeds" in done.stderr
    for other in ("still", "lidar-inertial"):
        done = command(recording, "--odometry", other, "--wheels", "rolled.txt")
        assert done.returncode != 0
        assert f"{other} has no use for wheel speeds; lidar-inertial?wheels=true" in done.stderr
    np.savetxt(recording / "late.txt", [[100.0, 8.0], [100.5, 8.0]])
    done = command(recording, "--odometry", "lidar-inertial?wheels=true", "--wheels", "late.txt")
    assert "expected samples from 0.050 to 0.550 s, when scans were taken" in done.stderr


def test_what_is_not_used_is_said(recording):
    np.savetxt(recording / "wheels.csv", [[0.0, 8.0], [0.5, 8.0]], delimiter=",")
    done, _ = run_odometry(recording, "--odometry", "still")
    assert "imu.csv is not used: still has no use for an IMU; lidar-inertial does" in done.stderr
    assert "wheels.csv is not used: still has no use for wheel speeds" in done.stderr


def test_what_is_missing_is_reported(folder, recording):
    done, _ = run_odometry(recording)
    assert "no IMU" not in done.stderr
    assert "no times.txt" not in done.stderr
    assert "points without times" not in done.stderr
    (folder / "imu.csv").rename(folder / "IMU.dat")
    (folder / "times.txt").unlink()
    for file in folder.glob("*.npy"):
        np.save(file, np.load(file)[:, :4])
    done, _ = run_odometry(recording)
    assert done.exit_code == 0, done.output
    assert f"no IMU: imu.csv or imu.txt in or beside {folder}, or --imu FILE" in done.stderr
    assert "no times.txt: scans are taken to be 10 a second" in done.stderr
    assert "points without times: each scan is taken to be seen at once" in done.stderr
    assert "lidar-inertial: 6 scans" in done.stdout
    assert "no IMU" not in run_odometry(recording, "--imu", "none")[0].stderr


def test_samples_with_too_large_steps_are_reported(recording):
    lines = (recording / "imu.csv").read_text().splitlines()
    (recording / "imu.csv").write_text("\n".join(lines[1::20]))
    done, out = run_odometry(recording)
    assert "samples 0.05 s apart are too few: they are not used" in done.stderr
    assert "with 12 inertial samples" not in done.stderr
    without = out.read_bytes()
    run_odometry(recording, "--imu", "none")
    assert out.read_bytes() == without
    done, _ = run_odometry(recording, "--imu", str(recording / "imu.csv"))
    assert "samples 0.05 s apart are too few: they are used where" in done.stderr
    assert "with 12 inertial samples" in done.stderr


def test_if_no_scan_can_be_read_the_file_stays_as_it_is(folder):
    out = folder / "poses.txt"
    out.write_text("mine")
    for path in folder.glob("*.npy"):
        path.write_bytes(b"nothing")
    done, _ = run_odometry(folder)
    assert done.exit_code != 0
    assert "0.npy: expected an array saved by numpy" in str(done.exception)
    assert out.read_text() == "mine"


BROKEN = """
from roadscope.odometry.still import StillOdometry

class Resets(StillOdometry):
    def reset(self):
        pass

class Raises(StillOdometry):
    def update(self, scan, imu=None):
        raise KeyError("oops")

class Leaves(StillOdometry):
    def update(self, scan, imu=None):
        raise SystemExit(3)

class Answers(StillOdometry):
    def update(self, scan, imu=None):
        return super().update(scan, imu).start_from_lidar

class Lists(StillOdometry):
    def update(self, scan, imu=None):
        return [super().update(scan, imu)]
"""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Resets", "takes 1 positional argument but 2 were given"),
        ("Raises", "KeyError: 'oops' (broken.py:10)"),
        ("Leaves", "SystemExit: 3 (broken.py:14)"),
        ("Answers", "update returned Pose, not OdometryEstimate"),
        ("Lists", "update returned a list or tuple, not OdometryEstimate"),
    ],
)
def test_what_a_plug_in_does_wrong_is_reported_in_a_line(folder, name, message):
    (folder / "broken.py").write_text(BROKEN)
    done, out = run_odometry(folder, "--odometry", f"{folder / 'broken.py'}:{name}")
    assert done.exit_code != 0
    assert isinstance(done.exception, PluginError)
    assert f"broken.py:{name}: " in str(done.exception)
    assert message in str(done.exception)
    assert not out.exists()


def test_lines_without_information_are_left_out_and_reported(recording):
    lines = (recording / "imu.csv").read_text().splitlines()
    lines[40] = ",".join([lines[40].split(",")[0], *["nan"] * 6])
    lines[80] = "1e9" + lines[80][lines[80].index(",") :]
    (recording / "imu.csv").write_text("\n".join(lines))
    done, out = run_odometry(recording, "--mounting", "0,0,0,0,0,90")
    assert "with 238 inertial samples" in done.stderr
    assert "(2 left out: no numbers, or stamps that do not rise)" in done.stderr
    truth = driven(6)[0].pose(0.55)
    last = read_trajectory(out, "kitti").poses[-1]
    assert np.linalg.norm(last.translation - truth[:3, 3]) < 0.1


DOUBTFUL = """
from dataclasses import replace
from roadscope.core import OdometryStatus
from roadscope.odometry.still import StillOdometry

class Doubtful(StillOdometry):
    def update(self, scan, imu=None):
        foggy = scan.stamp_s > 0.3
        estimate = super().update(scan, imu)
        doubt = {"status": OdometryStatus.DEGRADED, "reason": "[fog] of [/x]"}
        return replace(estimate, **doubt) if foggy else estimate
"""


def test_many_degraded_scans_are_warned_of(recording):
    plugin = recording / "doubtful.py"
    plugin.write_text(DOUBTFUL)
    done, _ = run_odometry(recording, "--odometry", f"{plugin}:Doubtful")
    assert "degraded in 3 of 6 scans, mostly: [fog] of [/x]" in done.stdout
    assert "check the poses before you use them" in done.stderr


def test_samples_and_mounting_are_handed_on(recording):
    plugin = recording / "telling.py"
    plugin.write_text(TELLING)

    def positions_and_yaw(*options):
        done, out = run_odometry(recording, "--odometry", f"{plugin}:Telling", *options)
        assert done.exit_code == 0, done.output
        poses = read_trajectory(out, "kitti").poses
        return [round(p.translation[0]) for p in poses], poses[-1].yaw

    counts, yaw = positions_and_yaw("--mounting", "1 0 0 0 0 90")
    assert counts == [40 * k for k in range(1, 7)]
    assert yaw == pytest.approx(np.pi / 2)
    assert positions_and_yaw()[1] == 0
    assert positions_and_yaw("--imu", "none") == ([-1, -2, -3, -4, -5, -6], 0)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--imu", "imo.csv"], "imo.csv: cannot be read: No such file"),
        (["--imu", "none", "--mounting", "0,0,0,0,0,0"], "a mounting is of an IMU: expected"),
        (["--imu", "late.csv"], "expected samples from 0.050 to 0.550 s, when scans were taken"),
        (["--truth", "times.txt"], "times.txt, line 1: expected 12 columns"),
        (["--truth", "short.kitti"], "short.kitti: expected 6 poses, one a scan, got 1"),
        (["--truth", "nothing.tum"], "nothing.tum: cannot be read"),
        (["--out", "nowhere/poses.txt"], "poses.txt: cannot be written: --out needs a file"),
        (
            ["--odometry", "oracle?odometry=still"],
            "is made from the truth: it can run only on boards",
        ),
        (["--odometry", "noisy-odometry"], "is made from the truth: it can run only on"),
        (["--odometry", "still", "--imu", "imu.csv"], "still has no use for an IMU"),
        (["--odometry", "still", "--mounting", "0,0,0,0,0,90"], "still has no use for an IMU"),
        (["--mounting", "0,0,nan,0,0,90"], "expected a mounting x,y,z,roll,pitch,yaw"),
    ],
)
def test_what_is_wrong_beside_the_scans_is_said(recording, options, message):
    rows = np.loadtxt(recording / "imu.csv", delimiter=",", skiprows=1)
    np.savetxt(recording / "late.csv", rows + 100 * np.eye(1, 7), delimiter=",")
    first = (recording / "truth.kitti").read_text().splitlines()[0]
    (recording / "short.kitti").write_text(first + "\n")
    done = command(recording, *options)
    assert done.returncode != 0
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (recording / "poses.txt").exists()


@pytest.mark.parametrize("name", ["truth.tum", "imu.csv", "wheels.csv", "times.txt", "3.npy"])
def test_what_is_read_is_not_written_over(recording, name):
    np.savetxt(recording / "wheels.csv", [[0.0, 8.0], [0.5, 8.0]], delimiter=",")
    before = (recording / name).read_bytes()
    out = str(recording / name)
    done, _ = run_odometry(recording, "--truth", str(recording / "truth.tum"), "--out", out)
    assert f"{out} is an input of this run" in str(done.exception)
    assert (recording / name).read_bytes() == before


@pytest.mark.slow
def test_as_a_stranger_runs_it(recording):
    done = command(recording, "--odometry", "still", "--truth", "truth.tum")
    assert done.returncode == 0, done.stderr
    assert "written: poses.txt" in done.stdout
    assert len(read_trajectory(recording / "poses.txt", "kitti").poses) == 6
    (recording / "empty").mkdir()
    done = command(recording / "empty")
    assert done.returncode != 0
    assert "expected files .bin, .pcd, .npy" in done.stderr
    printed = command(recording, "--help").stdout
    assert "--mounting" in printed
    assert max(map(len, printed.splitlines())) <= 80


SLOW = """
import time
from roadscope.odometry.still import StillOdometry

class Slow(StillOdometry):
    def update(self, scan, imu=None):
        time.sleep(20 if scan.stamp_s > 0.2 else 0)
        return super().update(scan, imu)
"""


def test_ctrl_c_keeps_poses(recording):
    (recording / "slow.py").write_text(SLOW)
    line = [sys.executable, "-m", "roadscope", "run-odometry", ".", "--odometry", "slow.py:Slow"]
    running = subprocess.Popen(
        line, cwd=recording, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts
    )
    out = recording / "poses.txt"
    try:
        while not out.exists() or len(out.read_text().splitlines()) < 2:
            assert running.poll() is None
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        _, printed = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == 130
    assert "2 of 6 poses are kept in poses.txt" in printed
    assert "Traceback" not in printed
    assert len(read_trajectory(out, "kitti").poses) == 2
