import json
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.cache import FolderError
from roadscope.benchmarks.episode import Episode, sensed, timeline_path
from roadscope.benchmarks.jobs.plan import plan
from roadscope.benchmarks.jobs.stack import ego_velocities
from roadscope.benchmarks.perceived import Perceived
from roadscope.benchmarks.runner import RunError, run
from roadscope.benchmarks.suite import Suite, parse_suite

PLUGINS = Path(__file__).parent / "plugins.py"
TINY = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-three-vehicles", "lu2018-occlusion"]
split = "validation"
seeds = 2
duration_s = 0.9
[detection]
entries = ["pag"]
[tracking]
entries = ["nearest"]
detectors = ["pag", "oracle"]
"""
EPISODES = 4


def plugin(name: str) -> str:
    return f"{PLUGINS}:{name}"


@pytest.fixture(scope="module")
def suite() -> Suite:
    return parse_suite(TINY, "tiny")


@pytest.fixture(scope="module")
def results(suite, tmp_path_factory) -> Results:
    return run(suite, out_dir=tmp_path_factory.mktemp("out"))


def test_both_boards_have_their_entries(results) -> None:
    assert results.boards() == ["detection", "tracking"]
    assert results.entries("detection") == ["pag", "oracle", "one-cluster"]
    assert set(results.entries("tracking")) == {"nearest", "nearest on oracle"}
    assert results.failures == ()


def test_marks_are_not_ranked(results) -> None:
    places = {(s.board, s.entry): (s.mark, s.rank) for s in results.standings}
    assert places == {
        ("detection", "pag"): (None, 1),
        ("detection", "oracle"): ("upper mark", None),
        ("detection", "one-cluster"): ("lower mark", None),
        ("tracking", "nearest"): (None, 1),
        ("tracking", "nearest on oracle"): ("upper mark", None),
    }


def test_what_is_broken_down_adds_up(results) -> None:
    whole = results.row("detection", "pag", "detection_rate")
    for by in ("range", "category", "occlusion", "points", "weather", "scenario"):
        rows = [
            row
            for row in results.breakdown(by)
            if (row.entry, row.metric) == ("pag", "detection_rate")
        ]
        assert sum(row.samples for row in rows) == whole.samples
        found = sum(row.value * row.samples for row in rows)
        assert found == pytest.approx(whole.value * whole.samples)
    assert {row.band for row in results.breakdown("weather", "tracking")} == {"clear"}


def test_the_oracle_is_the_upper_mark(results) -> None:
    for metric in ("detection_rate", "precision", "f1", "ap"):
        row = results.row("detection", "oracle", metric)
        assert row is not None
        assert row.value == row.low == row.high == 1.0
        assert row.n == EPISODES


def test_rows_are_complete(results) -> None:
    for row in results.rows:
        assert row.better in ("higher", "lower")
        assert row.unit
        if row.low is not None:
            assert row.low <= row.value <= row.high
    cost = results.row("tracking", "nearest", "call_p50_ms")
    assert cost is not None
    assert cost.value > 0


def test_the_board_is_written_as_json(suite, tmp_path) -> None:
    results = run(suite, boards=["detection"], out_dir=tmp_path)
    board = json.loads((tmp_path / "leaderboard.json").read_text())
    assert set(board) >= {"manifest", "rows"}
    assert set(board["rows"][0]) == {
        "board", "entry", "metric", "value", "low", "high", "n", "unit", "better", "by", "band",
        "samples",
    }  # fmt: skip
    assert len(board["rows"]) == len(results.rows)
    assert len(board["parts"]) == len(results.parts) > 0
    assert [place["entry"] for place in board["standings"]] == results.entries("detection")
    assert board["manifest"]["suite"] == "tiny"
    assert board["manifest"]["libraries"]["highway-env"]


def test_a_second_run_does_nothing_again(suite, tmp_path) -> None:
    log = tmp_path / "log"
    entry = f"{plugin('Logged')}?log={log}"
    stages = []
    for _ in range(2):
        run(
            suite, [entry], boards=["detection"], only=True, out_dir=tmp_path / "out",
            progress=lambda stage, done, total: stages.append((stage, done, total)),
        )  # fmt: skip
    assert log.read_text().count("begun") == EPISODES
    assert stages[-1] == ("detection", EPISODES, EPISODES)
    run(suite, [entry], boards=["detection"], only=True, out_dir=tmp_path / "out", fresh=True)
    assert log.read_text().count("begun") == 2 * EPISODES


def test_trackers_share_one_run_of_the_detector(suite, tmp_path) -> None:
    log = tmp_path / "log"
    detector = f"{plugin('Logged')}?log={log}"
    text = TINY.replace('detectors = ["pag", "oracle"]', f"detectors = ['{detector}']")
    run(parse_suite(text, "x"), ["nearest-q"], boards=["tracking"], out_dir=tmp_path / "out")
    assert log.read_text().count("begun") == EPISODES


def test_bad_plug_ins_become_rows_with_reasons_and_the_rest_goes_on(suite, tmp_path) -> None:
    bad = ["Raises", "RaisesWhenMade", "ReturnsNonsense", "ReturnsNan", "Exits", "Late"]
    results = run(suite, [plugin(b) for b in bad], boards=["detection"], out_dir=tmp_path)
    reasons = {entry.partition(":")[2]: reason for entry, _, reason in results.reasons()}
    assert set(reasons) == set(bad)
    assert "KeyError: 'what\\nis this' (plugins.py:" in reasons["Raises"]
    assert "no weights" in reasons["RaisesWhenMade"]
    assert "detect returned list, not Detections" in reasons["ReturnsNonsense"]
    assert "must be finite" in reasons["ReturnsNan"]
    assert "(plugins.py:" in reasons["ReturnsNan"]
    assert "SystemExit: 3 (plugins.py:" in reasons["Exits"]
    assert "their frame is at" in reasons["Late"]
    assert all("\n" not in reason for reason in reasons.values())
    failed = results.row("detection", plugin("Raises"), "failed_episodes")
    assert failed is not None
    assert failed.value == failed.n == EPISODES
    good = results.row("detection", "pag", "f1")
    assert good is not None
    assert good.n == EPISODES
    assert results.entries("detection")[0] == "pag"
    assert results.entries("detection")[-2:] == ["oracle", "one-cluster"]


def test_what_plug_ins_print_is_no_result(suite, tmp_path, capsys) -> None:
    run(suite, [plugin("Prints")], boards=["detection"], only=True, out_dir=tmp_path, fresh=True)
    shown = capsys.readouterr()
    assert "hello" not in shown.out
    assert "hello" in shown.err


def test_failures_are_tried_again(suite, tmp_path) -> None:
    own = tmp_path / "mine.py"
    flag = tmp_path / "flag"
    own.write_text(
        "from pathlib import Path\nfrom roadscope.core import Detections\n"
        f"class Mine:\n    def reset(self): assert Path({str(flag)!r}).exists()\n"
        "    def detect(self, frame): return Detections.empty(frame.stamp_s)\n"
    )
    options = {"boards": ["detection"], "only": True, "out_dir": tmp_path / "out"}
    assert len(run(suite, [f"{own}:Mine"], **options).failures) == EPISODES
    flag.touch()
    assert run(suite, [f"{own}:Mine"], **options).failures == ()


def test_a_failing_public_detector_is_named_by_its_trackers(tmp_path) -> None:
    text = TINY.replace('detectors = ["pag", "oracle"]', f"detectors = ['{plugin('Raises')}']")
    results = run(parse_suite(text, "x"), boards=["tracking"], out_dir=tmp_path)
    assert results.barren()
    assert "KeyError" in results.failures[0].reason


def test_a_plug_in_cannot_change_what_others_see(suite, tmp_path) -> None:
    alone = run(suite, boards=["detection"], out_dir=tmp_path / "a", fresh=True)
    after = run(
        suite, [plugin("Scribbles")], boards=["detection"], out_dir=tmp_path / "b", fresh=True
    )
    for metric in ("f1", "ap", "position_rmse_m"):
        assert alone.row("detection", "pag", metric) == after.row("detection", "pag", metric)


def test_parallel_jobs_find_the_same(suite, results, tmp_path) -> None:
    parallel = run(suite, jobs=2, out_dir=tmp_path, fresh=True)
    timed = ("call_p50_ms", "call_p99_ms")
    assert [r for r in parallel.rows if r.metric not in timed] == [
        r for r in results.rows if r.metric not in timed
    ]


def test_a_dead_worker_is_told_in_one_line(suite, tmp_path) -> None:
    with pytest.raises(RunError, match="a worker process died"):
        run(suite, [plugin("Dies")], boards=["detection"], jobs=2, out_dir=tmp_path)


def test_velocities_in_the_ego_frame_are_relative_to_the_ego(suite, tmp_path) -> None:
    """A tracker that says 0 in the ego frame claims that all move as the ego does."""
    results = run(suite, [plugin("EgoFrame")], boards=["tracking"], only=True, out_dir=tmp_path)
    row = results.row("tracking", f"{plugin('EgoFrame')} on oracle", "velocity_rmse_m_s")
    assert row is not None
    episode = plan(suite, [], ("detection",)).detection[0].episode
    truths = [truth for _, truth in sensed(episode)]
    speed = np.hypot(*ego_velocities(truths)[:, :2].T).mean()
    assert speed > 5.0
    assert row.value < speed / 2


def test_what_is_kept_of_an_episode_is_read_back_whole(suite, tmp_path) -> None:
    job = next(j for j in plan(suite, [], ("detection",)).detection if j.entry == "pag")
    run(suite, boards=["detection"], out_dir=tmp_path)
    first = Perceived.load(job.detections_path)
    copy = tmp_path / "copy.npz"
    first.save(copy)
    assert Perceived.load(copy) == first
    assert len(first.truths) == len(first.detections) == len(first.calls_ms)
    job.detections_path.write_bytes(b"half a file")
    run(suite, boards=["detection"], out_dir=tmp_path / "again", fresh=True)
    assert Perceived.load(job.detections_path).truths == first.truths


def test_traffic_is_recorded_once_and_a_broken_file_is_made_again(suite) -> None:
    episode = Episode("lu2018-occlusion", 10_000, "lux", 0.9)
    before = [truth for _, truth in sensed(episode)]
    path = timeline_path(episode)
    written = path.stat().st_mtime_ns
    assert [truth for _, truth in sensed(episode)] == before
    assert path.stat().st_mtime_ns == written
    path.write_bytes(b"broken")
    assert [truth for _, truth in sensed(episode)] == before


def test_bad_settings_are_refused(suite, tmp_path) -> None:
    with pytest.raises(RunError, match="1 or more worker"):
        run(suite, jobs=0, out_dir=tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(FolderError, match="cannot write to folder"):
        run(suite, out_dir=tmp_path / "file")
