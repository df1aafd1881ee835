"""Thresholds of scores that are chosen on other sequences, or on train seeds."""

import pytest
from toy_kitti import write_kitti

from roadscope import Spec, leaderboard, load_suite
from roadscope.benchmarks import kitti_suite, plan, run_jobs
from roadscope.benchmarks.boards import JobOptions, board_named
from roadscope.benchmarks.nodes import THRESHOLDS, TunedNode, at_threshold, is_tuned
from roadscope.benchmarks.recorded import MotRecording
from roadscope.core import SpecError

TUNED = "gnn?least_score=tuned"
DETECTORS = ("DPM", "FRCNN", "SDP")


@pytest.fixture
def folder(tmp_path):
    """Cars have scores of about 0.98, and each frame has boxes of 0.6 that are no cars."""
    folder = write_kitti(tmp_path / "kitti")
    for path in (folder / "det_toy" / "Car").glob("*.txt"):
        rows = [line.split(",") for line in path.read_text().splitlines()]
        wrong = [[*row[:6], "0.4", *row[7:10], "-8", *row[11:]] for row in rows]
        lines = [",".join([*row[:6], "4.0", *row[7:]]) for row in rows]
        lines += [",".join(row) for row in wrong]
        path.write_text("\n".join(sorted(lines, key=lambda line: int(line.split(",")[0]))) + "\n")
    return folder


def tracks_of(folder, entry):
    """Tracks by sequence."""
    made = plan(kitti_suite(folder), [entry], boards=["tracking"], only=True)
    jobs = [job for job in made.jobs if job.board.name == "kitti car"]
    failures = []
    run_jobs(jobs, lambda job, outcome: failures.append(outcome.reason))
    assert failures == [None] * len(jobs)
    return {job.episode.sequence: job.answers.read().tracks for job in jobs}


@pytest.mark.slow
def test_the_best_threshold_of_the_others_is_taken(folder):
    assert tracks_of(folder, TUNED) == tracks_of(folder, "gnn?least_score=0.7")
    assert tracks_of(folder, TUNED) != tracks_of(folder, "gnn")


def test_no_recording_of_the_same_video_trains_a_threshold(folder):
    made = plan(kitti_suite(folder), [TUNED], boards=["tracking"], only=True)
    for job in made.jobs:
        judges = {node.judge for nodes in job.answers.training for node in nodes}
        assert judges
        assert job.episode.sequence not in {judge.sequence for judge in judges}


def test_mot17_has_each_video_three_times():
    video, other = (
        {MotRecording("", f"MOT17-{number}-{d}", "pedestrian", "det", 0).video for d in DETECTORS}
        for number in ("02", "04")
    )
    assert len(video) == len(other) == 1
    assert video != other
    assert MotRecording("", "MOT16-02", "pedestrian", "det", 0).video == "MOT16-02"


@pytest.mark.slow
def test_own_labels_change_no_track_of_a_sequence(folder):
    before = tracks_of(folder, TUNED)
    labels = folder / "label_02" / "0000.txt"
    rows = [line for line in labels.read_text().splitlines() if " Car " not in line]
    labels.write_text("\n".join(rows) + "\n")
    after = tracks_of(folder, TUNED)
    assert after["0000"] == before["0000"]


@pytest.mark.slow
def test_any_tracker_can_have_a_threshold_and_the_row_says_so(folder):
    entries = ["nearest?least_score=tuned", "nearest?least_score=tuned&ego=none"]
    results = leaderboard("quick", entries, boards=["tracking"], only=True, kitti=folder)
    assert not results.failures
    assert set(results.entries("kitti car")) == set(entries)


def test_arguments_get_the_threshold():
    spec = Spec.parse("bytetrack?low_score=0.0&high_score=tuned&new_score=tuned&ego=none")
    at = at_threshold(spec, 0.3)
    assert dict(at.arguments) == {"low_score": 0.0, "high_score": 0.3, "new_score": 0.3}
    assert str(at) == "bytetrack?low_score=0.0&high_score=0.3&new_score=0.3&ego=none"
    assert is_tuned(spec)
    assert not is_tuned(at)
    assert at_threshold(Spec.parse(TUNED), 0.3) == Spec.parse("gnn")


def test_wrong_arguments_are_refused_before_a_run(folder):
    for entry in ("gnn?gate=tuned", "gnn?least_score=tuned&gate=3"):
        with pytest.raises(SpecError, match="gate"):
            plan(kitti_suite(folder), [entry], boards=["tracking"], only=True)


def test_one_sequence_has_none_to_choose_on(tmp_path):
    folder = write_kitti(tmp_path / "kitti", ("0000",))
    results = leaderboard("quick", [TUNED], boards=["tracking"], only=True, kitti=folder)
    assert "only one" in results.failures[0].reason


def test_on_simulated_traffic_thresholds_are_chosen_on_train_seeds():
    board, suite = board_named("tracking"), load_suite("quick")
    jobs = board.jobs(suite, [board.check_entry(Spec.parse(TUNED))], JobOptions(marks=False))
    for job in jobs:
        assert isinstance(job.answers, TunedNode)
        scores = [node for nodes in job.answers.training for node in nodes]
        seeds = {node.tracks.detections.episode.seed for node in scores}
        assert max(seeds) < 10_000 <= job.episode.seed
        assert len(job.answers.candidates) == len(THRESHOLDS)
