"""The board of odometries, on a suite of seconds."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from node_answers import poses_of
from rich.console import Console

from roadscope import ODOMETRIES, Episode, Results, Spec, leaderboard, load_suite
from roadscope.benchmarks import (
    SuiteError,
    drive,
    imu_mounting,
    moving_in,
    parse_suite,
    plan,
    sensing_of,
    timeline_of,
)
from roadscope.benchmarks.boards import episodes
from roadscope.benchmarks.report import board_table, breakdown_tables
from roadscope.core import SpecError

PLUGINS = Path(__file__).parent / "sensor_plugins.py"
GOOD = f"{PLUGINS}:Steady"
TINY = """
name = "tiny"
version = 1
rig = "vlp16-imu"
duration_s = 2.5
scenarios = ["cold-start", "standing-in-traffic"]
faults = ["clear", "dropped-scans:2"]
split = "validation"
seeds = [10001]
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
    return leaderboard(suite, boards=["odometry"], out_dir=out)


def test_marks_are_odometries_without_scans_and_without_moving_returns(results) -> None:
    assert {s.entry: s.mark for s in results.standings} == {
        "scan-to-scan": None,
        "scan-to-scan on oracle": "upper mark",
        "dead-reckoning": "lower mark",
        "still": "lower mark",
    }


def test_an_odometry_that_stands_still_is_off_by_the_whole_distance(results) -> None:
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
        tables = list(breakdown_tables(results, "odometry", by, 80, metrics=("t_rel", "end")))
        assert tables
        assert all(Console(width=80).measure(table).minimum <= 80 for table in tables)


def test_tables_fit_a_terminal(results) -> None:
    assert Console(width=80).measure(board_table(results, "odometry", 80)).minimum <= 80


def test_every_kind_of_file_is_written(results, out) -> None:
    written = json.loads((out / "leaderboard.json").read_text())
    assert {row["board"] for row in written["rows"]} == {"odometry"}
    assert "t_rel" in (out / "leaderboard.csv").read_text()
    assert r"### t\_rel (%) by distance, m" in (out / "leaderboard.md").read_text()
    assert r"\begin{tabular}" in (out / "leaderboard.tex").read_text()


def test_a_second_run_does_nothing_again(suite, out, results) -> None:
    stages = []
    again = leaderboard(
        suite,
        boards=["odometry"],
        out_dir=out,
        progress=lambda stage, done, total: stages.append(stage),
    )
    assert set(stages) <= {"worst moments"}, "these come from kept answers"
    assert again.rows == results.rows


def test_the_median_stands_beside_the_mean(results) -> None:
    middle = results.row("odometry", "still", "t_rel_median")
    assert middle.n == results.row("odometry", "still", "t_rel").n
    assert middle.value == pytest.approx(100, abs=15)


def test_an_oracle_leaves_out_all_returns_of_moving_objects() -> None:
    with_all_returns, static_only = (
        poses_of(spec, STANDING) for spec in ("still", "oracle?odometry=still")
    )
    moving = [each.sum() for each in with_all_returns.moving]
    assert min(moving) > 0
    for all_of_it, static, moving_count in zip(
        with_all_returns.moving, static_only.moving, moving, strict=True
    ):
        assert not static.any()
        assert len(static) == len(all_of_it) - moving_count
        assert moving_count < len(all_of_it) / 2


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


def planned(suite, entries, **options):
    jobs = plan(suite, entries, boards=["odometry"], **options).jobs
    return {job.entry: (str(job.answers.source), job.mark) for job in jobs}


def test_each_ranked_odometry_of_a_suite_has_its_oracle(suite) -> None:
    marks = {"still": "lower mark", "dead-reckoning": "lower mark"}
    ranked = ("scan-to-scan", GOOD, "voxel-map?match_m=2&insert_m=1.5")
    assert planned(suite, [GOOD, ranked[2]]) == {
        **{spec: (spec, None) for spec in ranked},
        **{f"{spec} on oracle": (f"oracle?odometry={spec}", "upper mark") for spec in ranked},
        **{spec: (spec, mark) for spec, mark in marks.items()},
    }
    assert planned(suite, [GOOD], only=True) == {GOOD: (GOOD, None)}
    assert planned(suite, ["oracle?odometry=still"], only=True) == {
        "still on oracle": ("oracle?odometry=still", "upper mark")
    }


def test_the_suite_of_the_package_has_the_hard_scenarios_and_what_is_registered() -> None:
    loaded = load_suite("odometry")
    assert len(loaded.seeds) >= 5
    assert (
        {"lidar-inertial", "zhang2022", "kiss-icp", "still"}
        <= {Spec.parse(spec).name for spec in loaded.boards["odometry"].entries}
        <= set(ODOMETRIES.names())
    )
    assert len(episodes(loaded)) == len(loaded.scenarios) * len(loaded.seeds)


def test_what_is_no_odometry_is_named_before_anything_runs(suite) -> None:
    for spec, words in (
        ("nobody", "no odometry 'nobody'"),
        ("nearest", "is a tracker; the boards of this run are for an odometry"),
        ("voxel-map?match_m=0", "match_m must be positive"),
    ):
        with pytest.raises(SpecError, match=words):
            plan(suite, [spec], boards=["odometry"])
    with pytest.raises(SuiteError, match=r"odometry\.lengths_m"):
        parse_suite(TINY.replace("[10, 20]", "[0]"), "tiny")
