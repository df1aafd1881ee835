"""`roadscope.leaderboard`: a suite is run, its results are kept, and a board is returned."""

import json
from pathlib import Path

import numpy as np
import pytest

from roadscope import Results, leaderboard
from roadscope.benchmarks import (
    FIRST_CALLS,
    Episode,
    FolderError,
    RunError,
    Suite,
    SuiteError,
    parse_suite,
    plan,
    sensed,
    timeline_path,
)
from roadscope.benchmarks.nodes import ego_motions
from roadscope.benchmarks.report import read_runs
from roadscope.core import SpecError

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
    return leaderboard(suite, out_dir=tmp_path_factory.mktemp("out"))


def test_both_boards_have_their_entries(results) -> None:
    assert results.boards() == ["detection", "tracking"]
    assert results.entries("detection") == ["pag", "oracle", "one-cluster"]
    assert set(results.entries("tracking")) == {"nearest", "nearest on oracle"}
    assert results.failures == ()


def test_a_run_keeps_its_worst_moments_and_shows_them_on_a_page(suite, tmp_path) -> None:
    page = tmp_path / "pages" / "mine.html"
    arguments = {"boards": ["detection"], "page": page}
    board_results = leaderboard(suite, [plugin("Scribbles")], out_dir=tmp_path / "out", **arguments)
    (run,) = read_runs(tmp_path / "out")
    assert run.results.rows == board_results.rows
    assert {moment.board for moment in run.moments} == {"detection"}
    assert {moment.entry for moment in run.moments} <= set(board_results.entries("detection"))
    assert "pag" in {moment.entry for moment in run.moments}
    assert page.is_file()
    page.unlink()
    leaderboard(suite, [plugin("Scribbles")], **arguments)
    assert page.is_file()


@pytest.mark.slow
def test_the_first_run_on_an_installation_compiles_before_it_begins(
    suite, tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    short = suite.with_settings("tracking", detectors=("oracle",))
    boards = []
    for compiled in (False, True):
        calls: list[tuple[str, int, int]] = []
        board_results = leaderboard(
            short,
            [plugin("EgoFrame")],
            boards=["tracking"],
            jobs=2,
            fresh=True,
            progress=lambda *call, calls=calls: calls.append(call),
        )
        # Of ours alone; the plug-in of a stranger is not called.
        of_first = [call for call in calls if call[0] == FIRST_CALLS]
        assert of_first == ([] if compiled else [(FIRST_CALLS, 0, 1), (FIRST_CALLS, 1, 1)])
        assert calls[: len(of_first)] == of_first
        assert board_results.failures == ()
        boards.append(without_times(board_results))
    assert boards[0] == boards[1]


def without_times(results: Results) -> list[str]:
    """Return the rows but for those of computing times, as text."""
    return [repr(row) for row in results.rows if not row.metric.endswith("_ms")]


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
        total = sum(row.value * row.samples for row in rows)
        assert total == pytest.approx(whole.value * whole.samples)
    assert {row.band for row in results.breakdown("weather", "tracking")} == {"clear"}
    assert {row.band for row in results.breakdown("detector", "tracking")} == {"pag", "oracle"}


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
    results = leaderboard(suite, boards=["detection"], out_dir=tmp_path)
    board = json.loads((tmp_path / "leaderboard.json").read_text())
    assert set(board) >= {"manifest", "rows", "parts", "standings", "failures", "scores"}
    assert len(board["scores"]) == len(results.jobs) == 3 * EPISODES
    assert set(board["rows"][0]) == {
        "board",
        "entry",
        "metric",
        "value",
        "low",
        "high",
        "n",
        "unit",
        "better",
        "by",
        "band",
        "samples",
    }
    assert len(board["rows"]) == len(results.rows)
    assert len(board["parts"]) == len(results.parts) > 0
    assert [place["entry"] for place in board["standings"]] == results.entries("detection")
    assert board["manifest"]["suite"] == "tiny"
    assert board["manifest"]["libraries"]["highway-env"]


@pytest.mark.slow
def test_a_second_run_does_nothing_again(suite, tmp_path) -> None:
    log = tmp_path / "log"
    entry = f"{plugin('Logged')}?log={log}"
    stages = []
    for _ in range(2):
        leaderboard(
            suite,
            [entry],
            boards=["detection"],
            only=True,
            out_dir=tmp_path / "out",
            progress=lambda stage, done, total: stages.append((stage, done, total)),
        )
    assert log.read_text().count("begun") == EPISODES
    computed = [each for each in stages if each[0] != "worst moments"]
    assert computed[-1][1:] == (EPISODES, EPISODES)
    assert "detection" in computed[-1][0]
    leaderboard(
        suite, [entry], boards=["detection"], only=True, out_dir=tmp_path / "out", fresh=True
    )
    assert log.read_text().count("begun") == 2 * EPISODES


@pytest.mark.slow
def test_trackers_share_one_run_of_the_detector(suite, tmp_path) -> None:
    log = tmp_path / "log"
    detector = f"{plugin('Logged')}?log={log}"
    text = TINY.replace('detectors = ["pag", "oracle"]', f"detectors = ['{detector}']")
    leaderboard(
        parse_suite(text, "x"), ["nearest-q"], boards=["tracking"], out_dir=tmp_path / "out"
    )
    assert log.read_text().count("begun") == EPISODES


TIMES = ("call_p50_ms", "call_p99_ms", "wall_p50_ms")


def untimed(results: Results, board: str, *entries: str) -> list:
    """Return all rows of a board, or of some entries, but times."""
    every = [row for row in (*results.rows, *results.parts) if row.board == board]
    names = entries or results.entries(board)
    return [row for row in every if row.metric not in TIMES and row.entry in names]


@pytest.mark.slow
def test_what_plug_ins_print_is_no_result_and_stands_in_the_log_of_a_failure(
    suite, tmp_path, capfd
) -> None:
    own = tmp_path / "mine.py"
    own.write_text(
        "class Wrong:\n    def reset(self): print('hello from mine')\n"
        "    def detect(self, frame): return 7\n"
        "class Raises(Wrong):\n    def detect(self, frame): raise KeyError(7)\n"
        "class Dies(Wrong):\n    def detect(self, frame): import os; os._exit(3)\n"
    )
    bad = [f"{own}:{name}" for name in ("Wrong", "Raises", "Dies")]
    options = {"boards": ["detection"], "only": True, "out_dir": tmp_path, "fresh": True}
    board_results = leaderboard(suite, [plugin("Prints"), *bad], **options)
    assert "hello" not in capfd.readouterr().out
    assert board_results.failed_entries == bad
    assert all("hello from mine" in failure.log for failure in board_results.failures)


def test_failures_are_tried_again(suite, tmp_path) -> None:
    own = tmp_path / "mine.py"
    flag = tmp_path / "flag"
    own.write_text(
        "from pathlib import Path\nfrom roadscope import Detections\n"
        f"class Mine:\n    def reset(self): assert Path({str(flag)!r}).exists()\n"
        "    def detect(self, frame): return Detections.empty(frame.stamp_s)\n"
    )
    options = {"boards": ["detection"], "only": True, "out_dir": tmp_path / "out"}
    assert len(leaderboard(suite, [f"{own}:Mine"], **options).failures) == EPISODES
    flag.touch()
    assert leaderboard(suite, [f"{own}:Mine"], **options).failures == ()


def test_a_failing_public_detector_is_named_by_its_trackers(tmp_path) -> None:
    text = TINY.replace('detectors = ["pag", "oracle"]', f"detectors = ['{plugin('Raises')}']")
    board_results = leaderboard(parse_suite(text, "x"), boards=["tracking"], out_dir=tmp_path)
    assert board_results.row("tracking", "nearest", "hota") is None
    assert len(board_results.failures) == EPISODES
    assert all(f"{plugin('Raises')}: KeyError" in f.reason for f in board_results.failures)


def test_a_plug_in_cannot_change_what_others_get(suite, results, tmp_path) -> None:
    board_results = leaderboard(
        suite, [plugin("Scribbles")], boards=["detection"], out_dir=tmp_path, fresh=True
    )
    assert untimed(board_results, "detection", "pag", "oracle") == untimed(
        results, "detection", "pag", "oracle"
    )


@pytest.mark.slow
def test_parallel_jobs_give_the_same(suite, results, tmp_path) -> None:
    parallel = leaderboard(suite, jobs=2, out_dir=tmp_path, fresh=True)
    for board in ("detection", "tracking"):
        assert untimed(parallel, board) == untimed(results, board)


@pytest.mark.slow
def test_velocities_in_the_ego_frame_are_relative_to_the_ego(suite, tmp_path) -> None:
    """A tracker that says 0 in the ego frame claims that all move as the ego does."""
    entries = [plugin("EgoFrame")]
    board_results = leaderboard(suite, entries, boards=["tracking"], only=True, out_dir=tmp_path)
    row = board_results.row("tracking", f"{plugin('EgoFrame')} on oracle", "velocity_rmse_m_s")
    episode = plan(suite, [], boards=["detection"]).jobs[0].episode
    truths = [truth for _, truth in sensed(episode)]
    motions = ego_motions([t.stamp_s for t in truths], [t.world_from_ego for t in truths])
    speed = np.hypot(*motions[:, :2].T).mean()
    assert speed > 5.0
    assert row.value < speed / 2


@pytest.mark.slow
def test_a_damaged_file_of_an_episode_is_named_and_made_again(suite, tmp_path) -> None:
    jobs = plan(suite, [], boards=["detection"]).jobs
    job = next(j for j in jobs if j.entry == "pag")
    first = job.answers.read()
    assert len(first.truths) == len(first.detections) == len(first.times.wall_ms)
    job.answers.path.write_bytes(b"half a file")
    with pytest.warns(UserWarning, match=job.answers.path.name):
        leaderboard(suite, boards=["detection"], out_dir=tmp_path)
    again = job.answers.read()
    assert (again.detections, again.truths) == (first.detections, first.truths)


def test_traffic_is_recorded_once_and_a_broken_file_is_made_again(suite) -> None:
    episode = Episode("lu2018-occlusion", 10_000, "lux", 0.9)
    before = [truth for _, truth in sensed(episode)]
    path = timeline_path(episode)
    written = path.stat().st_mtime_ns
    assert [truth for _, truth in sensed(episode)] == before
    assert path.stat().st_mtime_ns == written
    path.write_bytes(b"broken")
    with pytest.warns(UserWarning, match=path.name):
        assert [truth for _, truth in sensed(episode)] == before


def test_bad_settings_are_refused(suite, tmp_path) -> None:
    with pytest.raises(RunError, match="jobs"):
        leaderboard(suite, jobs=0, out_dir=tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(FolderError, match="cannot write to folder"):
        leaderboard(suite, out_dir=tmp_path / "file")


@pytest.mark.parametrize("entry", ["oracle", "noisy?miss=0.2", "fused?lidar=cluster-boxes"])
def test_an_unranked_source_of_detections_is_distinguished_from_an_unknown_name(suite, entry):
    with pytest.raises(SpecError) as error:
        leaderboard(suite, [entry], boards=["detection"])
    assert f"--detections '{entry}'" in str(error.value)
    assert ("a row beside" in str(error.value)) == (entry == "oracle")


@pytest.mark.parametrize(
    ("entries", "options", "error"),
    [
        (["neerest"], {}, SpecError),
        (["nearest?gate=2"], {}, SpecError),
        (["nearest"], {"boards": ["detection"]}, SpecError),
        (["voxel-map"], {}, SpecError),
        (["nowhere.at.all:Mine"], {}, SpecError),
        ([], {"boards": ["drift"]}, SpecError),
        ([], {"only": True}, SpecError),
        ([], {"boards": ["camera"]}, ValueError),
    ],
)
def test_what_cannot_be_run_is_refused_before_anything_runs(
    suite, tmp_path, entries, options, error
) -> None:
    stages = []
    good = f"{plugin('Logged')}?log={tmp_path / 'log'}"
    with pytest.raises(error):
        leaderboard(
            suite,
            [good, *entries] if entries else entries,
            out_dir=tmp_path / "out",
            progress=lambda *stage: stages.append(stage),
            **options,
        )
    assert stages == []
    assert not (tmp_path / "log").exists()
    assert not (tmp_path / "out").exists()


def test_a_suite_that_names_what_there_is_not_is_refused_by_its_name(tmp_path) -> None:
    wrong = parse_suite(TINY.replace('entries = ["nearest"]', 'entries = ["neerest"]'), "x")
    with pytest.raises(SuiteError, match=r"tiny v1: tracking\.entries: .*'nearest'"):
        leaderboard(wrong, out_dir=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_only_leaves_the_suites_entries_and_the_marks_out(suite, tmp_path) -> None:
    board_results = leaderboard(
        suite, ["distance"], boards=["detection"], only=True, out_dir=tmp_path
    )
    assert board_results.entries("detection") == ["distance"]
    assert board_results.boards() == ["detection"]
    beside = leaderboard(suite, ["distance"], boards=["detection"], out_dir=tmp_path)
    assert set(beside.entries("detection")) == {"distance", "pag", "oracle", "one-cluster"}
    assert untimed(beside, "detection", "distance") == [
        row for row in untimed(board_results, "detection") if row.metric
    ]


def test_a_strangers_tracker_and_detector_stand_on_their_boards(suite, tmp_path) -> None:
    own = tmp_path / "mine.py"
    own.write_text(
        "from roadscope import Detections\n"
        "from roadscope.trackers import NearestTracker\n"
        "class Tracker(NearestTracker):\n    kind = 'tracker'\n"
        "class Blind:\n    def reset(self): pass\n"
        "    def detect(self, frame): return Detections.empty(frame.stamp_s)\n"
    )
    board_results = leaderboard(suite, [f"{own}:Tracker", f"{own}:Blind"], out_dir=tmp_path / "out")
    assert board_results.failures == ()
    ours = untimed(board_results, "tracking", "nearest")
    same = untimed(board_results, "tracking", f"{own}:Tracker")
    assert [row.value for row in ours] == [row.value for row in same]
    assert board_results.row("detection", f"{own}:Blind", "detection_rate").value == 0.0
    assert board_results.row("detection", f"{own}:Blind", "call_p50_ms").value > 0
    assert board_results.row("detection", f"{own}:Blind", "wall_p50_ms").value > 0


def test_what_is_not_installed_is_named_before_anything_runs(suite, tmp_path) -> None:
    own, events = tmp_path / "mine.py", []
    own.write_text(
        "from roadscope.core import Requirement\n"
        "from roadscope.trackers import NearestTracker\n"
        "class Needy(NearestTracker):\n    kind = 'tracker'\n"
        "    requires = Requirement('no-such-library', 'pip install no-such-library')\n"
    )
    board_results = leaderboard(
        suite,
        [f"{own}:Needy"],
        boards=["tracking"],
        out_dir=tmp_path / "out",
        notice=events.append,
        progress=lambda *stage: events.append(stage),
    )
    assert isinstance(events[0], str)
    assert f"{own}:Needy" in events[0]
    assert "pip install no-such-library" in events[0]
    assert board_results.not_installed(f"{own}:Needy")
    assert board_results.failed_entries == []
    assert board_results.row("tracking", "nearest", "hota").n == EPISODES
