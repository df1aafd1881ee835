"""The board of odometries, on a suite of seconds."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.boards.breakdown_tables import breakdown_tables
from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.boards.tables import board_table
from roadscope.benchmarks.drive import drive, imu_mounting, moving_in
from roadscope.benchmarks.episode import Episode, sensing_of, timeline_of
from roadscope.benchmarks.jobs.plan import episodes, plan
from roadscope.benchmarks.jobs.ride import ride
from roadscope.benchmarks.oracle_odometry import entry_of, method_of, odometry_mark
from roadscope.benchmarks.runner import run
from roadscope.benchmarks.suite import SuiteError, load_suite, parse_suite
from roadscope.core import SpecError
from roadscope.core.registry import split_spec
from roadscope.odometry import ODOMETRIES

PLUGINS = Path(__file__).parent / "check" / "bad_odometries.py"
GOOD = f"{PLUGINS}:Good"
TINY = """
name = "tiny"
version = 1
rig = "vlp16-imu"
duration_s = 2.5
scenarios = ["cold-start", "standing-in-traffic"]
faults = ["clear", "dropped-scans:2"]
split = "validation"
seeds = [10001, 10002]
[odometry]
entries = ["scan-to-scan", "dead-reckoning", "still"]
lengths_m = [10, 20]
"""
STANDING = Episode("standing-in-traffic", 10001, "vlp16-imu", 2.5)


@pytest.fixture(scope="module")
def suite():
    return parse_suite(TINY, "tiny")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def results(suite, out) -> Results:
    return run(suite, boards=("odometry",), out_dir=out)


def test_marks_are_who_looks_at_no_scan_and_who_is_spared_what_moves(results) -> None:
    assert {s.entry: s.mark for s in results.standings} == {
        "scan-to-scan": None, "scan-to-scan on oracle": "upper mark",
        "dead-reckoning": "lower mark", "still": "lower mark",
    }  # fmt: skip


def test_who_does_not_move_is_all_of_the_way_off(results) -> None:
    assert results.row("odometry", "still", "t_rel").value == pytest.approx(100, abs=15)
    # It fails where the ego drives, and nowhere else.
    assert results.row("odometry", "still", "failed").value == pytest.approx(0.5)
    assert results.row("odometry", "still", "false_motion").value == pytest.approx(0, abs=1e-3)
    assert results.row("odometry", "still", "error_max").value >= (
        results.row("odometry", "still", "end").value - 1e-9
    )


def test_parts_are_of_scenarios_conditions_and_distances(results, suite) -> None:
    for by, bands in (
        ("scenario", set(suite.scenarios)),
        ("condition", {"clear", "dropped-scans:2"}),
        ("distance", {"10", "20", "50"}),
    ):
        rows = [r for r in results.breakdown(by, "odometry") if r.entry == "still"]
        assert bands <= {r.band for r in rows}
        tables = list(breakdown_tables(results, "odometry", by, 80, ("t_rel", "end")))
        assert tables
        assert all(Console(width=80).measure(table).minimum <= 80 for table in tables)


def test_tables_fit_a_terminal(results) -> None:
    assert Console(width=80).measure(board_table(results, "odometry", 80)).minimum <= 80


def test_every_kind_of_file_is_written(results, out) -> None:
    written = json.loads((out / "leaderboard.json").read_text())
    assert {row["board"] for row in written["rows"]} == {"odometry"}
    assert "t_rel" in (out / "leaderboard.csv").read_text()
    assert "### t_rel (%) by distance, m" in (out / "leaderboard.md").read_text()
    assert r"\begin{tabular}" in (out / "leaderboard.tex").read_text()


def test_a_second_run_does_nothing_again(suite, out, results, monkeypatch) -> None:
    for name in ("execute_odometries", "apart"):
        monkeypatch.setattr(f"roadscope.benchmarks.runner.{name}", None)
    again = run(suite, boards=("odometry",), out_dir=out)
    assert again.row("odometry", "scan-to-scan", "t_rel") == results.row(
        "odometry", "scan-to-scan", "t_rel"
    )


def test_strangers_that_raise_end_hang_or_take_all_memory_become_rows(suite, out) -> None:
    small = replace(suite, seeds=suite.seeds[:1], faults=((),), scenarios=suite.scenarios[:1])
    told, rate = {}, {}
    for names, deadline_s in (
        (("Good", "Raises", "Ends", "Greedy", "ReturnsNan"), 300.0), (("Hangs",), 1.0),
    ):  # fmt: skip
        specs = [f"{PLUGINS}:{name}" for name in names]
        found = run(
            small, specs, boards=("odometry",), only=True, out_dir=out, deadline_s=deadline_s
        )
        told |= {name.rpartition(":")[2]: reason for name, _, reason in found.reasons()}
        rate |= {n: found.row("odometry", f"{PLUGINS}:{n}", "failed_episodes").value for n in names}
    assert rate == {"Good": 0, "Raises": 1, "Ends": 1, "Greedy": 1, "ReturnsNan": 1, "Hangs": 1}
    assert "KeyError" in told["Raises"]
    assert "ended its whole process, exit code 3" in told["Ends"]
    assert "MemoryError" in told["Greedy"]
    assert "finite" in told["ReturnsNan"]
    assert "no answer within 1 s: it hangs" in told["Hangs"]


def test_an_oracle_sees_nothing_that_moves() -> None:
    found, spared = (ride(spec, STANDING) for spec in ("still", "oracle?odometry=still"))
    moving = [each.sum() for each in found.moving]
    assert min(moving) > 0
    for all_of_it, rest, gone in zip(found.moving, spared.moving, moving, strict=True):
        assert not rest.any()
        assert len(rest) == len(all_of_it) - gone
        assert gone < len(all_of_it) / 2


def test_what_moves_is_what_the_truth_says() -> None:
    (_, truth), *_ = sensing_of(STANDING).whole(timeline_of(STANDING))
    moving = moving_in(truth)
    speeds = dict(zip(truth.ids.tolist(), np.hypot(*truth.velocities.T), strict=True))
    expected = [speeds.get(source, 0.0) > 0.1 for source in truth.sources.tolist()]
    assert moving.tolist() == expected
    assert 0 < moving.sum() < len(moving)


def test_a_drive_is_the_same_every_time_and_may_be_written_to() -> None:
    once = list(drive(STANDING))
    for step in once:
        step.scan.points[:] = 0
        step.imu.specific_force[:] = 0
    again, third = list(drive(STANDING)), list(drive(STANDING))
    assert again == third
    assert all(np.abs(step.scan.points).max() > 1 for step in again)


def test_inertial_samples_of_lost_scans_come_with_the_next() -> None:
    whole = len(list(drive(STANDING)))
    every = (replace(STANDING, faults=(f"dropped-scans:{severity}",)) for severity in (3, 4, 5))
    lossy, steps = next((e, s) for e in every if 0 < len(s := list(drive(e))) < whole)
    stamps = np.concatenate([step.imu.stamps_s for step in steps])
    gaps = np.diff(stamps)
    assert (gaps > 0).all()
    assert gaps.max() < 1.5 / 400
    assert imu_mounting(lossy) is not None


@pytest.mark.parametrize(
    ("spec", "method", "entry", "mark"),
    [
        ("voxel-map", "voxel-map", "voxel-map", None),
        ("still", "still", "still", "lower mark"),
        ("dead-reckoning", "dead-reckoning", "dead-reckoning", "lower mark"),
        ("oracle?odometry=a?b=1&c=2", "a?b=1&c=2", "a?b=1&c=2 on oracle", "upper mark"),
    ],
)
def test_oracles_name_their_method(spec, method, entry, mark) -> None:
    assert (method_of(spec), entry_of(spec), odometry_mark(spec)) == (method, entry, mark)


def test_each_ranked_odometry_of_a_suite_has_its_oracle(suite) -> None:
    planned = {job.odometry for job in plan(suite, [GOOD], ("odometry",)).odometry}
    ranked = {"scan-to-scan", GOOD}
    oracles = {f"oracle?odometry={spec}" for spec in ranked}
    assert planned == {*ranked, *oracles, "still", "dead-reckoning"}
    alone = {job.odometry for job in plan(suite, [GOOD], ("odometry",), only=True).odometry}
    assert alone == {GOOD}
    asked = plan(suite, ["oracle?odometry=still"], ("odometry",), only=True).odometry
    assert {job.entry for job in asked} == {"still on oracle"}


def test_the_suite_of_the_package_has_the_hard_scenarios_and_what_is_registered() -> None:
    loaded = load_suite("odometry")
    assert len(loaded.seeds) >= 5
    assert (
        {"lidar-inertial", "zhang2022", "kiss-icp", "still"}
        <= {split_spec(spec)[0] for spec in loaded.odometries}
        <= set(ODOMETRIES.names())
    )
    assert len(episodes(loaded)) == len(loaded.scenarios) * len(loaded.seeds)


def test_what_is_no_odometry_is_named_before_anything_runs(suite) -> None:
    for spec, words in (
        ("nobody", "no odometry 'nobody'"),
        ("nearest", "is a tracker; it belongs on the tracking board"),
        ("voxel-map?match_m=0", "match_m must be above 0"),
    ):
        with pytest.raises(SpecError, match=words):
            plan(suite, [spec], ("odometry",))
    with pytest.raises(SuiteError, match=r"odometry\.lengths_m: expected metres above 0"):
        parse_suite(TINY.replace("[10, 20]", "[0]"), "tiny")


def test_the_command_line_shows_the_board(tmp_path, suite, results, monkeypatch) -> None:
    small = TINY.replace('"scan-to-scan", ', "").replace(', "dropped-scans:2"', "")
    (tmp_path / "tiny.toml").write_text(small.replace(', "standing-in-traffic"', ""))
    for by, words in (("distance", "t_rel (%) by distance"), ("scenario", "stand")):
        said = CliRunner().invoke(
            app,
            ["leaderboard", "odometry", "--suite", str(tmp_path / "tiny.toml"), "--by", by,
             "--jobs", "1", "--seeds", "1", "--out", str(tmp_path / "out"), "--entry", GOOD],
            env={"COLUMNS": "80"},
        )  # fmt: skip
        assert said.exit_code == 0, said.output
        for each in (words, "fail", "t_rel", "still", "Good on", "oracle"):
            assert each in said.output
        lines = [line for line in said.stdout.splitlines() if not line.startswith("written")]
        assert max(map(len, lines)) <= 80
