"""Episodes of a leaderboard run, shown from its stored files."""

from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from toy_kitti import write_kitti

from roadscope import leaderboard
from roadscope.benchmarks import Eligibility, FolderError, load_suite
from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.results import JobScores, results_of
from roadscope.benchmarks.viewing import (
    EpisodeChoice,
    EpisodeView,
    StoredAnswersError,
    view_of_results,
)

SEEDS = 20000, 20001
SCENARIOS = "lu2018-three-vehicles", "lu2018-occlusion"
SUITE = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-three-vehicles", "lu2018-occlusion"]
seeds = [20000, 20001]
duration_s = 0.6
[detection]
entries = ["distance-l-shape"]
[tracking]
entries = ["nearest", "gnn"]
detectors = ["distance-l-shape"]
[odometry]
entries = ["still"]
"""


def write_suite(folder: Path) -> Path:
    path = folder / "tiny.toml"
    path.write_text(SUITE)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("results")
    suite = write_suite(place)
    for board in ("odometry", "detection", "tracking"):
        leaderboard(load_suite(suite), boards=[board], out_dir=place)
    return place


def test_an_entry_is_shown_with_all_that_is_stored(folder: Path) -> None:
    choice = EpisodeChoice("tracking", "gnn", "lu2018-occlusion", SEEDS[1])
    view = view_of_results(folder, choice)
    assert "gnn" in view.title
    assert f"lu2018-occlusion, seed {SEEDS[1]}" in view.title
    assert len(view.tracks) == len(view.truths) == len(view.detections) > 5
    assert sum(map(len, view.tracks)) > 0
    assert view.timeline is not None
    assert view.episode is not None
    assert (view.episode.scenario, view.episode.seed) == ("lu2018-occlusion", SEEDS[1])
    assert "hota" in view.scores["tracking"]
    stamps_s = [truth.stamp_s for truth in view.truths]
    assert [tracks.stamp_s for tracks in view.tracks] == pytest.approx(stamps_s)


def test_another_choice_is_another_episode(folder: Path) -> None:
    views = [view_of_results(folder, EpisodeChoice("tracking", seed=seed)) for seed in SEEDS]
    ends = [view.truths[-1].world_from_ego.translation for view in views]
    assert not np.allclose(*ends)
    detection = view_of_results(folder, EpisodeChoice("detection"))
    assert detection.tracks == ()
    assert len(detection.detections) == len(detection.truths)
    odometry = view_of_results(folder, EpisodeChoice("odometry"))
    assert odometry.poses is not None
    assert [curve.metric for curve in odometry.curves] == ["position_error"]
    assert len(odometry.truths) == len(odometry.poses.stamps_s)


@pytest.mark.parametrize(
    ("choice", "named"),
    [
        (EpisodeChoice(entry="nobody"), "nearest"),
        (EpisodeChoice(seed=77), f"seed: {SEEDS[0]}, {SEEDS[1]}"),
        (EpisodeChoice(board="fusion"), "tracking"),
    ],
)
def test_what_is_not_there_is_refused_with_what_is(
    folder: Path, choice: EpisodeChoice, named: str
) -> None:
    with pytest.raises(StoredAnswersError, match=named):
        view_of_results(folder, choice)


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FolderError):
        view_of_results(tmp_path, EpisodeChoice())


def test_answers_that_were_removed_are_said_to_be(folder: Path, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "another"))
    with pytest.raises(StoredAnswersError, match="ROADSCOPE_CACHE"):
        view_of_results(folder, EpisodeChoice())


def notes_of(view: EpisodeView) -> str:
    return " ".join(view.notes)


def test_all_that_is_stored_is_shown_without_a_note(folder: Path) -> None:
    for board in ("detection", "tracking", "odometry"):
        view = view_of_results(folder, EpisodeChoice(board))
        assert view.notes == []
        assert {curve.board for curve in view.curves} >= {board}


def test_a_tracker_with_a_tuned_threshold_has_truth_and_detections(tmp_path: Path) -> None:
    suite = replace(load_suite(write_suite(tmp_path)), seeds=SEEDS[:1], scenarios=SCENARIOS[:1])
    entry = "nearest?least_score=tuned"
    leaderboard(suite, [entry], only=True, boards=["tracking"], out_dir=tmp_path)
    view = view_of_results(tmp_path, EpisodeChoice("tracking", entry))
    assert view.episode is not None
    assert view.episode.seed == SEEDS[0]
    assert len(view.tracks) == len(view.truths) == len(view.detections) > 5
    assert view.notes == []


def test_scores_over_time_need_a_known_rule_alone(tmp_path: Path) -> None:
    suite = replace(load_suite(write_suite(tmp_path)), seeds=SEEDS[:1], scenarios=SCENARIOS[:1])
    others = suite.with_settings("tracking", detectors=("oracle",))
    odd = replace(suite, eligibility=Eligibility(min_returns=7))
    for name, changed, has_scores in (("others", others, True), ("odd", odd, False)):
        leaderboard(changed, ["nearest"], only=True, boards=["tracking"], out_dir=tmp_path / name)
        view = view_of_results(tmp_path / name, EpisodeChoice())
        assert bool(view.curves) == has_scores
        assert ("eligible" in notes_of(view)) != has_scores
        assert view.episode is not None


def test_of_recorded_data_the_tracks_are_shown_and_the_notes_say_so(tmp_path: Path) -> None:
    kitti = write_kitti(tmp_path / "kitti")
    leaderboard(
        "quick", ["nearest"], only=True, boards=["tracking"], kitti=kitti, out_dir=tmp_path / "out"
    )
    view = view_of_results(tmp_path / "out", EpisodeChoice())
    assert sum(map(len, view.tracks)) > 0
    assert view.episode is None
    assert "recorded" in notes_of(view)
    assert "changed" not in notes_of(view)
    assert "eligible" not in notes_of(view)


def test_a_rig_that_is_another_one_now_has_no_sensor_data(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "other"
    copytree(folder, place)
    for path in place.glob("leaderboard*.json"):
        path.write_text(path.read_text().replace('"rig": "lux"', '"rig": "wide"'))
    view = view_of_results(place, EpisodeChoice("odometry"))
    assert view.episode is None
    assert view.poses is not None
    assert "LiDAR" in notes_of(view)
    assert "rig has changed" in notes_of(view)


def test_an_entry_that_always_failed_is_said_to_have(tmp_path: Path) -> None:
    score = {"f1": Score(0.5, "1", "higher", 1)}
    jobs = [
        JobScores("detection", entry, "merge", 20000, "clear", "", scores, **failure)
        for entry, scores, failure in (("pag", score, {}), ("Bad", {}, {"reason": "raised: no"}))
    ]
    results = results_of(jobs, {"suite": "quick", "rig": "lux"})
    (tmp_path / "leaderboard.json").write_text(results.to_json())
    for choice in (EpisodeChoice(entry="Bad"), EpisodeChoice("detection", "Bad", "merge", 20000)):
        with pytest.raises(StoredAnswersError, match=r"'Bad'.* failed in every.*raised: no"):
            view_of_results(tmp_path, choice)
    with pytest.raises(StoredAnswersError, match=r"no episode has entry 'nobody'.*pag, Bad"):
        view_of_results(tmp_path, EpisodeChoice(entry="nobody"))


def test_that_drives_are_not_shown_is_said_with_what_shows_them(tmp_path: Path) -> None:
    reward = {"reward": Score(0.5, "1", "higher", 1)}
    drive = JobScores("driving", "idm-mobil on truth", "motorway", 20000, "clear", "truth", reward)
    results = results_of([drive], {"suite": "driving", "rig": "vlp16"})
    (tmp_path / "leaderboard.json").write_text(results.to_json())
    with pytest.raises(StoredAnswersError, match=r"on truth, motorway.*is a drive.*report"):
        view_of_results(tmp_path, EpisodeChoice())
