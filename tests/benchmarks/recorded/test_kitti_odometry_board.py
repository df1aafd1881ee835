"""Odometries on KITTI's sequences, from the files to the drift."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from kitti_evaluation import odometry_errors
from toy_kitti_odometry import CAMERA_FROM_LIDAR, STEP_M, lidar_pose, write_odometry

from roadscope import leaderboard
from roadscope.benchmarks import kitti_suite
from roadscope.core import Pose, SpecError
from roadscope.formats import FormatError

RIGHT, LONG, TURNING, FAILS = (
    f"{Path(__file__).parents[2] / 'toy_kitti_odometry.py'}:Reads{arguments}"
    for arguments in ("", "?scale=1.02", "?turn_deg=0.1&scale=0.99", "?scale=far")
)
BOARD = "kitti odometry"
DRIVES = {"00": (70, 0.0), "03": (60, 0.01), "04": (15, 0.0)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("kitti") / "dataset"
    return write_odometry(place, DRIVES | {"11": (3, 0.0)}, unposed=("11",))


@pytest.fixture(scope="module")
def results(folder):
    entries = [RIGHT, LONG, TURNING, FAILS]
    return leaderboard(
        "quick", entries, boards=["odometry"], only=True, kitti=folder, out_dir=folder / "out"
    )


def value(results, entry, metric):
    return results.row(BOARD, entry, metric).value


def test_a_scale_is_the_drift(results, folder):
    assert value(results, RIGHT, "t_rel") == pytest.approx(0, abs=1e-3)
    assert value(results, LONG, "r_rel") == pytest.approx(0, abs=1e-3)
    # A stretch of 100 m ends with the first scan beyond it, after 20 steps of 5.1 m, and KITTI
    # divides the error of 102 m by 100 m. Sequence 00 is straight and has 70 scans; stretches begin
    # at every tenth.
    parts = {r.band: r.value for r in parts_of(results, LONG, "t_rel")}
    steps = {100: 20, 200: 40, 300: 59}
    straight = [
        STEP_M * count / length
        for first in range(0, 70, 10)
        for length, count in steps.items()
        if first + count < 70
    ]
    assert parts["00"] == pytest.approx(2 * np.mean(straight), rel=1e-3)
    assert "04" not in parts
    assert value(results, RIGHT, "call_p50_ms") > 0
    (entry,) = {failure.entry for failure in results.failures}
    assert entry == FAILS
    assert "## kitti odometry" in (folder / "out" / "leaderboard.md").read_text()


def parts_of(results, entry, metric):
    rows = results.breakdown("sequence", BOARD)
    return [row for row in rows if (row.entry, row.metric) == (entry, metric)]


@pytest.mark.parametrize(("entry", "scale", "turn_deg"), [(TURNING, 0.99, 0.1), (LONG, 1.02, 0)])
def test_drift_equals_the_plain_evaluation(results, entry, scale, turn_deg):
    errors = []
    for count, bend in DRIVES.values():
        truth = [lidar_pose(k, bend) for k in range(count)]
        estimated_poses = [
            Pose.from_euler(*(scale * pose.translation), yaw=k * (bend + np.deg2rad(turn_deg)))
            for k, pose in enumerate(truth)
        ]
        mount = CAMERA_FROM_LIDAR
        of_camera = [
            [(mount @ pose @ mount.inverse()).matrix.tolist() for pose in poses]
            for poses in (truth, estimated_poses)
        ]
        errors += odometry_errors(*of_camera)
    lengths, translations, rotations = map(np.array, zip(*errors, strict=True))
    # Points are float32: their numbers say where a scan was taken to about a tenth of a millimetre.
    assert value(results, entry, "t_rel") == pytest.approx(100 * translations.mean(), rel=2e-4)
    expected = 100 * np.rad2deg(rotations.mean())
    assert value(results, entry, "r_rel") == pytest.approx(expected, rel=1e-3, abs=1e-4)
    shown = {
        row.band: row.value
        for row in results.breakdown("distance", BOARD)
        if (row.entry, row.metric) == (entry, "t_rel")
    }
    for length in np.unique(lengths):
        of_length = 100 * translations[lengths == length].mean()
        assert shown[f"{length}"] == pytest.approx(of_length, rel=2e-4)


def test_figures_that_need_longer_sequences_are_reported(folder):
    for place in (folder, folder.parent):
        settings = kitti_suite(place).boards[BOARD]
        assert [drive.sequence.name for drive in settings.drives] == ["00", "03", "04"]
        assert "Sequence 00 is 352 m long: up to 300 m." in settings.remark
        assert "Sequence 04 is 71 m long, too short for any of these." in settings.remark
        assert "1 of 4 sequences are left out" in settings.remark


def test_an_oracle_cannot_know_what_moves(folder):
    with pytest.raises(SpecError, match="moving"):
        leaderboard("quick", ["oracle?odometry=voxel-map"], boards=["odometry"], kitti=folder)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda root: (root / "sequences/00/calib.txt").unlink(), ["00/calib.txt", "missing"]),
        (lambda root: (root / "sequences/00/times.txt").unlink(), ["00/times.txt", "missing"]),
        (lambda root: (root / "sequences/00/times.txt").write_text("0\n"), ["times.txt", "0 to 2"]),
        (lambda root: (root / "sequences/00/times.txt").write_text("2\n1\n0\n"), ["rise"]),
        (lambda root: (root / "poses/00.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n"), ["0 to 2"]),
        (lambda root: (root / "sequences/00/calib.txt").write_text("P2: 1\n"), ["calib.txt", "P2"]),
        (
            lambda root: (root / "sequences/00/velodyne/000001.bin").write_bytes(b"\0" * 15),
            ["15 bytes"],
        ),
        (lambda root: shutil.rmtree(root / "poses"), ["poses", "NN.txt", "00"]),
        (lambda root: shutil.rmtree(root / "sequences/00/velodyne"), ["velodyne/000000.bin"]),
        (lambda root: shutil.rmtree(root / "sequences"), ["sequences/NN", "poses"]),
    ],
)
def test_damage_is_one_clear_error(tmp_path, damage, words):
    root = write_odometry(tmp_path / "kitti", {"00": (3, 0.0)})
    damage(root)
    with pytest.raises(FormatError) as error:
        kitti_suite(root, ["odometry"])
    for word in words:
        assert word in str(error.value)


def test_another_level_of_the_folder_is_named(tmp_path):
    root = write_odometry(tmp_path / "kitti", {"00": (3, 0.0)})
    for place in (root / "sequences", root / "sequences" / "00", root / "poses"):
        with pytest.raises(FormatError) as error:
            kitti_suite(place, ["odometry"])
        assert f"name {root}" in str(error.value)
