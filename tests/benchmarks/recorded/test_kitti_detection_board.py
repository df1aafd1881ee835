"""LiDAR detectors on KITTI's scans: object data and tracking data, from the files to the board."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from toy_kitti_scans import Corners, cars_of, scan_of, write_objects, write_tracking
from typer.testing import CliRunner

from roadscope import leaderboard
from roadscope.__main__ import app
from roadscope.benchmarks import kitti_suite
from roadscope.benchmarks.boards import chosen_boards
from roadscope.benchmarks.formats import IMAGES, SCANS, find_kitti_frames
from roadscope.benchmarks.report import breakdown_tables
from roadscope.core import SpecError
from roadscope.formats import FormatError

FINDS, SHIFTED, FAILS = (
    f"{Path(__file__).parents[2] / 'toy_kitti_scans.py'}:{name}"
    for name in ("Corners", "Corners?shift_m=0.6", "Corners?shift_m=far")
)
BOARD = "kitti detection car"


def drives_of(folder, **options):
    return kitti_suite(folder, ["detection"], **options).boards[BOARD].drives


def check(folder):
    """Read all files of a folder, as a run does before anything else."""
    for drive in drives_of(folder):
        drive.check()


def run(folder, entries=(FINDS, SHIFTED), **options):
    return leaderboard(
        "quick", list(entries), boards=["detection"], only=True, kitti=folder, **options
    )


def test_object_data_from_files_to_the_board(tmp_path):
    results = run(write_objects(tmp_path / "kitti", 4), (FINDS, SHIFTED, FAILS))
    assert results.boards() == [BOARD]
    (failure,) = results.failures
    assert failure.entry == FAILS
    # Eight cars, each a step of recall: the best is 7 of 40. Of the shifted boxes, those of the
    # four cars that stand across the shift match no more.
    for metric in ("ap_3d_easy", "ap_3d_moderate", "ap_3d_hard", "ap_bev_easy", "ap_bev_hard"):
        assert results.row(BOARD, FINDS, metric).value == pytest.approx(7 / 40)
        assert results.row(BOARD, SHIFTED, metric).value < 4 / 40
        assert results.row(BOARD, FINDS, metric).samples == 8
    assert results.row(BOARD, FINDS, "boxes_per_frame").value == 2
    assert results.entries(BOARD)[0] == FINDS


def test_tracking_data_have_sequences_and_the_labels_as_a_mark(tmp_path):
    folder = write_tracking(tmp_path / "kitti")
    results = leaderboard(
        kitti_suite(folder, ["detection"]).with_settings(BOARD, entries=()),
        [FINDS],
        boards=["detection"],
    )
    for entry in (FINDS, "oracle"):
        assert results.row(BOARD, entry, "ap_3d_hard").value == pytest.approx(11 / 40)
    assert results.standing(BOARD, "oracle").mark
    parts = {(row.band, row.value) for row in results.breakdown("sequence", BOARD)}
    assert parts == {("0000", 5 / 40), ("0001", 5 / 40)}
    (table,) = breakdown_tables(results, BOARD, "sequence", 120)
    assert [list(column.cells)[-1] for column in table.columns[1:]] == ["6", "6"]


def test_detectors_that_the_suite_names_are_entries_too(tmp_path):
    folder = write_objects(tmp_path / "kitti", 1)
    assert run(folder, ["cluster-boxes"]).entries(BOARD) == ["cluster-boxes"]
    with pytest.raises(SpecError, match="least"):
        run(folder, ["cluster-boxes?least=1"])
    with pytest.raises(SpecError, match="a row beside the detectors of a suite"):
        run(folder, ["oracle"])


def test_results_are_reused_and_changed_files_count_as_new(tmp_path):
    folder, stages = write_objects(tmp_path / "kitti", 2), []

    def run_again():
        stages.clear()
        results = run(folder, [FINDS], progress=lambda stage, done, total: stages.append(stage))
        return results.row(BOARD, FINDS, "ap_3d_easy").value

    before = run_again()
    assert "detections" in stages
    assert run_again() == before
    assert not stages
    shutil.copytree(folder, tmp_path / "copy", copy_function=shutil.copy2)
    folder = tmp_path / "copy"
    run_again()
    assert not stages
    label = folder / "training" / "label_2" / "000001.txt"
    label.write_text(label.read_text().replace("Car 0.00 0", "Car 0.20 0"))
    assert run_again() < before


def test_scans_come_in_the_frame_of_the_vehicle(tmp_path):
    for folder in (write_objects(tmp_path / "a"), write_tracking(tmp_path / "b")):
        (drive, *_) = drives_of(folder, lidar_height_m=2.0)
        for frame, (frame_data, truth) in enumerate(drive.scans()):
            assert frame_data.calibration.pose("lidar").translation.tolist() == [0, 0, 2.0]
            raw = scan_of(frame)
            assert len(frame_data.lidar) == len(raw)
            np.testing.assert_allclose(frame_data.lidar.points, raw[:, :3], atol=1e-6)
            # The corners in the scan, in the vehicle's frame, are those of the labels.
            boxes = Corners().detect(frame_data).moved(truth.world_from_ego, "world")
            np.testing.assert_allclose(truth.centres, boxes.centres, atol=2e-3)
            assert len(truth) == len(cars_of(frame))
    assert frame_data.previous_from_ego.translation == pytest.approx([1.5, -0.2, 0], abs=0.03)


def without(name):
    def damage(root):
        (root / name).unlink()

    return damage


def text(name, content):
    return lambda root: (root / name).write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (without("calib/000001.txt"), ["calib/000001.txt", "velodyne/000001.bin", "1 of 3"]),
        (without("label_2/000002.txt"), ["label_2/000002.txt", "velodyne/000002.bin"]),
        (lambda root: shutil.rmtree(root / "velodyne"), ["velodyne", "label_2"]),
        (lambda root: shutil.rmtree(root / "calib"), ["calib"]),
        (text("velodyne/7.bin", b"\0" * 16), ["7.bin", "six digits"]),
        (text("velodyne/000001.bin", b"\0" * 18), ["000001.bin", "18 bytes"]),
        (text("label_2/000001.txt", b"Car 0.00 0 -1.6\n"), ["000001.txt", "line 1", "15 columns"]),
        (text("calib/000001.txt", b"P2: 1 2 3\n"), ["calib/000001.txt", "P2"]),
        (text("velodyne/000000.bin", np.tile(scan_of(0), (1, 2))[:, :5].tobytes()), ["000000.bin"]),
        (
            lambda root: [p.write_text("") for p in (root / "label_2").iterdir()],
            ["label_2", "Car", "got none"],
        ),
    ],
)
def test_damage_of_object_data_is_one_clear_error(tmp_path, damage, words):
    folder = write_objects(tmp_path / "kitti")
    damage(folder / "training")
    with pytest.raises(FormatError) as error:
        check(folder)
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (without("calib/0001.txt"), ["calib/0001.txt", "0001"]),
        (text("ego_pose/0000.txt", b"1 0 0 0 0 1 0 0 0 0 1 0\n"), ["ego_pose/0000.txt", "0 to 2"]),
        (lambda root: shutil.rmtree(root / "velodyne" / "0000"), None),
        (lambda root: (root / "velodyne").rename(root / "velodyne_points"), ["velodyne"]),
    ],
)
def test_damage_of_tracking_data_is_one_clear_error(tmp_path, damage, words):
    folder = write_tracking(tmp_path / "kitti")
    damage(folder)
    if words is None:
        assert [drive.name for drive in drives_of(folder)] == ["0001"]
        return
    with pytest.raises(FormatError) as error:
        check(folder)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("place", ["training/velodyne", "..", "training/label_2"])
def test_another_level_of_the_folder_is_named(tmp_path, place):
    folder = write_objects(tmp_path / "here" / "kitti")
    if place == "..":
        place = "../"
    with pytest.raises(FormatError) as error:
        drives_of(folder / place)
    assert str(folder) in str(error.value) or "training" in str(error.value)
    with pytest.raises(FormatError) as error:
        kitti_suite(folder / place)
    assert "sequences and poses; name " in str(error.value)
    with pytest.raises(FormatError, match="no such folder"):
        drives_of(folder / "nothing")
    with pytest.raises(FormatError, match="a file"):
        drives_of(folder / "training" / "velodyne" / "000000.bin")


def test_frames_without_scan_are_left_out_and_reported(tmp_path):
    root = write_objects(tmp_path / "kitti") / "training"
    (root / "velodyne" / "000001.bin").write_bytes(b"")
    (root / "velodyne" / "._000002.bin").write_bytes(b"hidden")
    (root / "label_2" / "000002.txt").write_text("")
    shutil.copy(root / "label_2" / "000000.txt", root / "label_2" / "000009.txt")
    selection = find_kitti_frames(root, [SCANS])
    assert [frames.numbers for frames in selection.frames] == [(0, 2)]
    assert len(selection.notes) == 3
    folder = write_tracking(tmp_path / "tracking")
    (folder / "velodyne" / "0001" / "000001.bin").unlink()
    selection = find_kitti_frames(folder, [SCANS])
    assert [frames.numbers for frames in selection.frames] == [(0, 1, 2), (0, 2)]
    assert "0001" in selection.notes[0]
    assert len(list(drives_of(folder)[1].scans())) == 2
    with pytest.raises(FormatError, match="image_02"):
        find_kitti_frames(folder, [IMAGES])


def test_points_that_are_left_out_are_reported(tmp_path):
    root = write_objects(tmp_path / "objects", 3)
    assert not find_kitti_frames(root, [SCANS]).notes
    lost = 0
    for path in sorted(root.rglob("velodyne/*.bin")):
        rows = np.fromfile(path, "<f4").reshape(-1, 4)
        rows[::7, 0] = np.nan
        lost += int(np.isnan(rows[:, 0]).sum())
        rows.tofile(path)
    (note,) = find_kitti_frames(root, [SCANS]).notes
    assert f"Of 3 scans looked at, {lost} points are left out: without a return" in note


def test_a_plain_run_takes_the_boards_that_the_folder_has_files_for(tmp_path):
    assert list(kitti_suite(write_objects(tmp_path / "a")).boards) == [BOARD]
    suite = kitti_suite(write_tracking(tmp_path / "b"))
    assert list(suite.boards) == [BOARD]
    with pytest.raises(SpecError, match="detectors"):
        chosen_boards(suite, ["tracking"])


def test_the_command_line(tmp_path):
    folder = write_objects(tmp_path / "kitti", 2)
    options = ["--kitti", str(folder), "--entry", FINDS, "--only", "--jobs", "1"]
    done = CliRunner().invoke(app, ["leaderboard", "detection", *options, "--json"])
    assert done.exit_code == 0, done.output
    content = json.loads(done.stdout)
    assert {row["board"] for row in content["rows"]} == {BOARD}
    shown = CliRunner().invoke(app, ["leaderboard", "detection", *options, "--by", "sequence"])
    assert shown.exit_code == 0
    assert "1.73 m" in shown.stdout
    assert "intervals" not in shown.stdout
    (folder / "training" / "calib" / "000001.txt").unlink()
    failed = CliRunner().invoke(app, ["leaderboard", "detection", *options])
    assert isinstance(failed.exception, FormatError)
