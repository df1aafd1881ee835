"""An odometry on a folder of scans, by function and by command."""

import numpy as np
import pytest
from toy_drive import driven
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.formats.trajectories import read_trajectory

RUNNER = CliRunner()


@pytest.fixture
def folder(tmp_path):
    for k, (scan, _) in enumerate(driven(6)[1]):
        rows = np.column_stack([scan.points, scan.intensity, scan.time_offset_s])
        np.save(tmp_path / f"{k}.npy", rows)
    return tmp_path


def follow(folder, *options):
    out = folder / "poses.txt"
    return RUNNER.invoke(app, ["run-odometry", str(folder), "--out", str(out), *options]), out


@pytest.mark.parametrize("form", ["kitti", "tum"])
def test_poses_are_written(folder, form):
    done, out = follow(folder, "--format", form)
    assert done.exit_code == 0, done.output
    assert f"written: {out}" in done.stdout
    found = read_trajectory(out, form)
    truth = driven(6)[0].pose(0.55)
    assert np.linalg.norm(found.poses[-1].translation - truth[:3, 3]) < 0.1


def test_after_an_interrupt_poses_are_kept(folder, monkeypatch):
    from roadscope.odometry.still import StillOdometry

    update = StillOdometry.update

    def interrupted(self, scan, imu=None):
        if scan.stamp_s > 0.25:
            raise KeyboardInterrupt
        return update(self, scan, imu)

    monkeypatch.setattr(StillOdometry, "update", interrupted)
    done, out = follow(folder, "--odometry", "still")
    assert done.exit_code != 0
    assert "3 of 6 poses are kept" in done.stderr
    assert len(read_trajectory(out, "kitti").poses) == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--odometry", "stil"], "no odometry 'stil' (did you mean 'still'?)"),
        (["--format", "evo"], "no format of trajectories 'evo'"),
        (["--rate-hz", "0"], "a rate is above 0 Hz"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_written(folder, options, message):
    done, out = follow(folder, *options)
    assert done.exit_code != 0
    assert message in str(done.exception)
    assert not out.exists()
