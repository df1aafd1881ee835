"""The board of image sequences, from MOTChallenge's files to the table."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_boxes import image_detections
from typer.testing import CliRunner

from roadscope import Category, ImageDetections, Tracks, leaderboard
from roadscope.__main__ import app
from roadscope.benchmarks import plan, score_mot_results
from roadscope.benchmarks.recorded import ImagePlane, mot_suite, recordings_of
from roadscope.formats import FormatError, read_mot

TRACKERS = ["nearest", "gnn", "existence"]
FRAMES = 40
BOARD = "mot pedestrian"


def write_mot(folder, name="MOT17-02", seed=0):
    """Three people walk through the image; one detection in twenty is missing."""
    rng, root = np.random.default_rng(seed), folder / name
    start = np.array([[100.0, 300, 40, 100], [400, 320, 44, 110], [700, 280, 36, 90]])
    pace = np.array([[3.0, 0.3, 0, 0], [-2, 0.2, 0, 0], [-2.5, -0.1, 0, 0]])
    detection_lines, true = [], []
    for t in range(1, FRAMES + 1):
        for k, (left, top, width, height) in enumerate(start + t * pace):
            true.append(f"{t},{k + 1},{left:.1f},{top:.1f},{width:.0f},{height:.0f},1,1,1")
            off = rng.normal(0, 1.5, 2)
            if rng.random() < 0.95:
                box = f"{left + off[0]:.1f},{top + off[1]:.1f},{width:.0f},{height:.0f}"
                detection_lines.append(f"{t},-1,{box},0.{rng.integers(85, 99)}")
    for place, lines in (("det/det.txt", detection_lines), ("gt/gt.txt", true)):
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        (root / place).write_text("\n".join(lines) + "\n")
    (root / "seqinfo.ini").write_text(
        f"[Sequence]\nname={name}\nframeRate=25\nseqLength={FRAMES}\nimWidth=960\nimHeight=540\n"
    )
    return folder


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder, out = tmp_path_factory.mktemp("mot"), tmp_path_factory.mktemp("out")
    write_mot(write_mot(folder), "MOT17-04", seed=1)
    board_results = leaderboard(
        "quick", TRACKERS, boards=["tracking"], only=True, mot=folder, out_dir=out
    )
    return board_results, folder


def test_trackers_are_ranked_on_image_boxes(results):
    board_results, _ = results
    assert board_results.boards() == [BOARD]
    assert not board_results.failures
    for entry in TRACKERS:
        row = board_results.row(BOARD, entry, "hota")
        assert row.n == 2
        assert 0.75 < row.value < 1
        assert board_results.row(BOARD, entry, "idf1").value > 0.9
    assert {r.band for r in board_results.breakdown("sequence", BOARD)} == {"MOT17-02", "MOT17-04"}


def test_the_command_writes_board_and_tracks_that_score_the_same(results, tmp_path):
    board_results, folder = results
    command_result = CliRunner().invoke(
        app,
        [
            "leaderboard",
            "tracking",
            "--mot",
            str(folder),
            "--entry",
            "gnn",
            "--only",
            "--jobs",
            "1",
            "--out",
            str(tmp_path / "board"),
            "--tracks",
            str(tmp_path / "tracks"),
            "--by",
            "sequence",
        ],
    )
    assert command_result.exit_code == 0, command_result.output
    assert "MOTChallenge" in command_result.output
    rows = json.loads((tmp_path / "board" / "leaderboard.json").read_text())["rows"]
    assert {row["board"] for row in rows} == {BOARD}
    tracks = tmp_path / "tracks" / "motchallenge" / "gnn" / "pedestrian" / "MOT17-02.txt"
    assert len(read_mot(tracks)) > 2 * FRAMES
    again = score_mot_results(folder / "MOT17-02", tracks)
    (whole,) = (
        r.value
        for r in board_results.breakdown("sequence", BOARD)
        if (r.entry, r.band, r.metric) == ("gnn", "MOT17-02", "hota")
    )
    assert again["hota"].value == pytest.approx(whole, abs=1e-9)


@pytest.mark.parametrize(
    ("file", "line", "wanted"),
    [
        ("det/det.txt", "1,-1,10,10,abc,20,0.9", "number"),
        ("det/det.txt", "1,-1,10,10,-5,20,0.9", "a width and height above 0"),
        ("gt/gt.txt", "0,1,10,10,5,20,1,1,1", "from 1 to 500000"),
        ("gt/gt.txt", "1,9,10,10,5,20,1,99,1", "a class from 1 to 13"),
    ],
)
def test_malformed_files_are_refused_by_file_line_and_what_was_expected(
    tmp_path, file, line, wanted
):
    path = write_mot(tmp_path) / "MOT17-02" / file
    path.write_text(line + "\n" + path.read_text())
    command_result = CliRunner().invoke(
        app, ["leaderboard", "--mot", str(tmp_path), "--entry", "gnn", "--only", "--jobs", "1"]
    )
    assert command_result.exit_code != 0
    output = f"{command_result.output} {command_result.exception}"
    assert f"{path}, line 1: expected" in output, output
    assert wanted in output


def test_what_is_no_folder_of_sequences_is_refused(tmp_path):
    with pytest.raises(FormatError, match="no such folder"):
        mot_suite(tmp_path / "none")
    (tmp_path / "images").mkdir()
    with pytest.raises(FormatError, match=r"expected SEQ/det/det\.txt and SEQ/gt.*got images"):
        mot_suite(tmp_path)


def test_a_sequence_alone_and_a_train_folder_are_taken_too(tmp_path):
    write_mot(tmp_path / "train")
    for folder in (tmp_path, tmp_path / "train", tmp_path / "train" / "MOT17-02"):
        (recording,) = recordings_of(mot_suite(folder))
        assert recording.sequence == "MOT17-02"
    assert (tmp_path / "train").is_dir()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--suite", "mot"], "name its folder with --mot DIR"),
        (["--mot", "x", "--kitti", "y"], "give one of them"),
        (["--mot", "x", "--suite", "tracking"], "--mot is a suite of its own"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, message):
    command_result = CliRunner().invoke(app, ["leaderboard", *options])
    assert command_result.exit_code != 0
    assert message in f"{command_result.output} {command_result.exception}"


def test_files_decide_the_key_and_their_place_does_not(tmp_path):
    def keys(where):
        jobs = plan(mot_suite(where), ["gnn"], boards=["tracking"], only=True).jobs
        return [job.key for job in jobs]

    before = keys(write_mot(tmp_path / "a"))
    moved = (tmp_path / "a").rename(tmp_path / "b")
    assert keys(moved) == before
    path = moved / "MOT17-02" / "gt" / "gt.txt"
    path.write_text(path.read_text().replace(",1,1,1", ",0,1,1", 1))
    assert keys(moved) != before


box = st.tuples(*[st.floats(0, 2000)] * 2, *[st.floats(5, 500)] * 2)


@given(st.lists(box, min_size=1, max_size=6), st.sampled_from([None, (1920, 1080), (640, 480)]))
def test_flat_boxes_come_back_as_they_were(given_boxes, image_size):
    left_top, size = np.split(np.array(given_boxes), 2, axis=1)
    detections = image_detections(
        np.hstack([left_top, left_top + size]), categories=Category.PEDESTRIAN
    )
    plane = ImagePlane.of([replace(detections, stamp_s=1.0)], image_size)
    flat = plane.boxes_on_plane(detections)
    assert np.median(flat.sizes[:, 0]) == pytest.approx(1.7)
    assert plane.image_boxes(Tracks.of(flat, np.arange(len(flat)))) == pytest.approx(
        detections.boxes, abs=1e-6
    )


def test_only_people_are_tracked():
    kinds = np.array([Category.PEDESTRIAN, Category.CAR], np.int8)
    boxes = np.array([[0, 0, 40, 100], [100, 0, 240, 60.0]])
    detections = ImageDetections(boxes, kinds, np.full(2, 0.9), 0.0)
    assert len(ImagePlane.of([detections], None).boxes_on_plane(detections)) == 1
