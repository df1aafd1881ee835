"""Tracks of recorded sequences as files that others read."""

import numpy as np
import pytest
from toy_kitti import FRAMES, write_kitti
from toy_kitti_scans import write_objects
from typer.testing import CliRunner

from roadscope import leaderboard
from roadscope.__main__ import app
from roadscope.benchmarks import FolderError, RunOptions, kitti_suite, plan
from roadscope.benchmarks.recorded import apply_kitti_rules, sequence_scores
from roadscope.benchmarks.report import folder_names, save_tracks
from roadscope.formats import KittiType, read_kitti_labels, read_kitti_sequence, read_mot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_kitti(tmp_path_factory.mktemp("kitti"))


def jobs_of(folder, *trackers):
    return plan(kitti_suite(folder), trackers, boards=["tracking"], only=True).jobs


def test_the_command_writes_both_formats(folder, tmp_path):
    out = tmp_path / "tracks"
    options = ["--kitti", str(folder), "--entry", "nearest?gate_m=2.5", "--only"]
    options += ["--tracks", str(out), "--out", str(tmp_path / "board"), "--jobs", "1"]
    assert CliRunner().invoke(app, ["leaderboard", "tracking", *options]).exit_code == 0
    files = sorted(str(p.relative_to(out)) for p in out.rglob("*.txt"))
    name = "nearest_gate_m=2.5"
    assert files == [
        f"kitti/{name}/0000.txt",
        f"kitti/{name}/0001.txt",
        *(f"motchallenge/{name}/{c}/000{n}.txt" for c in ("car", "pedestrian") for n in (0, 1)),
    ]


def test_what_is_written_scores_as_the_board_says(folder, tmp_path):
    jobs = jobs_of(folder, "nearest")
    assert save_tracks(jobs, tmp_path) == []
    rows = read_kitti_labels(tmp_path / "kitti" / "nearest" / "0000.txt", results=True)
    assert set(rows.types.tolist()) == {KittiType.CAR, KittiType.PEDESTRIAN}
    sequence = read_kitti_sequence(folder, "0000")
    counted = apply_kitti_rules(sequence.label_rows, rows.by_frame(FRAMES), KittiType.CAR)
    job = next(j for j in jobs if j.episode.category == "car")
    scores = job.board.score(job, job.answers.read(), RunOptions())
    for metric, score in sequence_scores(counted, 0.5).items():
        np.testing.assert_allclose(score.value, scores[metric].value, atol=1e-5, err_msg=metric)


@pytest.mark.slow
def test_a_run_and_its_track_files_call_a_tracker_once_a_sequence(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    plugin, log = tmp_path / "mine.py", tmp_path / "log"
    plugin.write_text(
        "from roadscope import Tracks\n"
        "class Mine:\n"
        f"    def reset(self): open({str(log)!r}, 'a').write('begun\\n')\n"
        "    def update(self, detections, ego_pose):\n"
        "        return Tracks.empty(detections.stamp_s, detections.frame)\n"
    )
    jobs = jobs_of(folder, f"{plugin}:Mine")
    leaderboard(kitti_suite(folder), [f"{plugin}:Mine"], only=True)
    assert log.read_text().count("begun") == len(jobs)
    assert save_tracks(jobs, tmp_path / "out") == []
    assert log.read_text().count("begun") == len(jobs)


def test_both_formats_hold_the_same_boxes_and_no_id_is_of_two_classes(folder, tmp_path):
    save_tracks(jobs_of(folder, "nearest"), tmp_path)
    rows = read_kitti_labels(tmp_path / "kitti" / "nearest" / "0001.txt", results=True)
    cars = rows.ids[rows.types == KittiType.CAR]
    people = rows.select(rows.types == KittiType.PEDESTRIAN)
    assert not set(cars.tolist()) & set(people.ids.tolist())
    boxed = read_mot(tmp_path / "motchallenge" / "nearest" / "pedestrian" / "0001.txt")
    assert len(boxed) == len(people) > 0
    np.testing.assert_array_equal(boxed.frames, people.frames + 1)
    np.testing.assert_allclose(boxed.boxes, people.boxes, atol=1e-5)


def test_a_tracker_that_fails_is_left_out_and_named(folder, tmp_path):
    plugin = tmp_path / "bad.py"
    plugin.write_text(
        "class Bad:\n    def reset(self): pass\n    def update(self, detections, ego_pose): 1 / 0\n"
    )
    out = tmp_path / "out"
    assert save_tracks(jobs_of(folder, f"{plugin}:Bad", "nearest"), out) == [f"{plugin}:Bad"]
    assert [p.name for p in (out / "kitti").iterdir()] == ["nearest"]


def test_names_are_plain_and_differ():
    long = [f"{place}/{'deep/' * 90}mine.py:Mine" for place in "ab"]
    entries = ["gnn", "GNN", "a/b.py:C", "a:b.py:C", "gnn", "x?a=1 on y", *long]
    names = folder_names(entries)
    assert names["gnn"] == "gnn"
    assert names["x?a=1 on y"] == "x_a=1_on_y"
    assert len({name.lower() for name in names.values()}) == len(set(entries))
    assert not any(c in name for name in names.values() for c in "/:? ")
    assert max(map(len, names.values())) < 60


@pytest.mark.parametrize("options", [[], ["--kitti", "."]])
def test_wrong_options_are_named_before_anything_runs(options, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    (tmp_path / "file").write_text("")
    command = ["leaderboard", "tracking", *options, "--tracks", str(tmp_path / "file")]
    caught = CliRunner().invoke(app, command).exception
    message = "a file is in the way" if options else "name its folder with --kitti"
    assert isinstance(caught, ValueError)
    assert message in str(caught)
    with pytest.raises(FolderError, match="a file is in the way"):
        save_tracks(jobs_of(folder, "nearest"), tmp_path / "file")


def test_a_board_without_trackers_writes_no_tracks(tmp_path):
    scans = write_objects(tmp_path / "scans")
    command = ["leaderboard", "detection", "--kitti", str(scans), "--tracks", str(tmp_path / "t")]
    caught = CliRunner().invoke(app, command).exception
    assert isinstance(caught, ValueError)
    assert "--tracks is for the board tracking, not" in str(caught)
    assert not (tmp_path / "t").exists()
