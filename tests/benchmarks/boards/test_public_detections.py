"""Trackers on the detections of several makers: one entry, and a rank on each."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from roadscope import load_suite
from roadscope.benchmarks import Job, Outcome, Suite, SuiteError, parse_suite, plan, run_jobs
from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.report import (
    board_table,
    breakdown_tables,
    explanation,
    failure_lines,
    to_markdown,
)
from roadscope.benchmarks.results import Results, gather
from roadscope.core import ORACLE
from roadscope.envs.traffic import SCENARIOS

TINY = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-occlusion", "lu2018-three-vehicles"]
split = "validation"
seeds = 2
duration_s = 1.0
[tracking]
entries = ["nearest", "gnn"]
detectors = ["pag", "noisy-misses", "noisy?clutter=3", "oracle"]
"""
MAKERS = ("pag", "noisy-misses", "noisy?clutter=3")
HOTA = {("nearest", "pag"): 0.5, ("gnn", "pag"): 0.4}


@pytest.fixture(scope="module")
def suite() -> Suite:
    return parse_suite(TINY, "tiny")


def jobs_of(suite: Suite) -> tuple[Job, ...]:
    return plan(suite, [], boards=["tracking"]).jobs


def scored(job: Job) -> Outcome:
    """HOTA of 0.5 and 0.4 on `pag`, 0.6 and 0.9 elsewhere, 1 on the oracle; 10 objects each."""
    tracker = job.entry.partition(" on ")[0]
    elsewhere = {"nearest": 0.6, "gnn": 0.9}[tracker]
    value = 1.0 if job.inputs == ORACLE else HOTA.get((tracker, job.inputs), elsewhere)
    return Outcome({"hota": Score(value, "1", "higher", 10, 0.0, 1.0, weight=10.0)})


@pytest.fixture(scope="module")
def results(suite) -> Results:
    jobs = jobs_of(suite)
    return gather(jobs, {job.key: scored(job) for job in jobs}, {"jobs": 1})


def printed(tables, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    for table in tables:
        console.print(table)
    return console.file.getvalue()


def test_a_tracker_is_one_entry_and_on_the_oracle_another(suite) -> None:
    jobs = jobs_of(suite)
    assert {(job.entry, job.inputs) for job in jobs} == {
        *((tracker, maker) for tracker in suite.boards["tracking"].entries for maker in MAKERS),
        *((f"{tracker} on oracle", "oracle") for tracker in suite.boards["tracking"].entries),
    }
    assert len({job.key for job in jobs}) == len(jobs)
    detections = {source.key for job in jobs for source in job.answers.sources()}
    assert len(detections) == 4 * len(MAKERS) + 4


def test_figures_are_of_all_detections_together(results) -> None:
    assert results.entries("tracking") == ["gnn", "nearest", "gnn on oracle", "nearest on oracle"]
    whole = results.row("tracking", "gnn", "hota")
    assert whole.value == pytest.approx((0.4 + 0.9 + 0.9) / 3)
    assert whole.n == 4 * len(MAKERS)
    assert results.standing("tracking", "gnn").rank == 1
    assert results.standing("tracking", "gnn on oracle").mark == "upper mark"


def test_each_maker_has_figures_of_its_own(results) -> None:
    rows = {(r.entry, r.band): r.value for r in results.breakdown("detector", "tracking")}
    assert rows["nearest", "pag"] == pytest.approx(0.5)
    assert rows["gnn", "noisy?clutter=3"] == pytest.approx(0.9)
    assert rows["gnn on oracle", "oracle"] == pytest.approx(1.0)


def test_ranks_are_shown_on_each_makers_detections(results) -> None:
    text = printed(breakdown_tables(results, "tracking", "detector", 80))
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert lines[0] == "HOTA by detector"
    assert "gnn 0.40 (2) 0.90 (1) 0.90 (1) -" in lines
    assert "nearest 0.50 (1) 0.60 (2) 0.60 (2) -" in lines
    assert "gnn on oracle - - - 1.00" in lines
    assert max(map(len, text.splitlines())) <= 80
    assert "| gnn | 0.40 (2) | 0.90 (1) | 0.90 (1) | - |" in to_markdown(results)


def test_the_five_of_the_suite_are_shown_whole_in_80_columns() -> None:
    suite = load_suite("tracking").with_settings("tracking", entries=("gnn", "nearest"))
    jobs = jobs_of(suite)
    gathered = gather(jobs, {job.key: scored(job) for job in jobs}, {"jobs": 1})
    text = printed(
        [
            *breakdown_tables(gathered, "tracking", "detector", 80),
            board_table(gathered, "tracking", 80),
        ]
    )
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    assert {name for name in suite.boards["tracking"].detectors if "?" not in name} <= set(
        text.split()
    )


def test_all_makers_are_named(suite) -> None:
    text = explanation(suite, ["tracking"])
    assert all(maker in text for maker in (*MAKERS, "oracle"))
    other = suite.with_settings("tracking", detectors=("pag",))
    assert "oracle" not in explanation(other, ["tracking"])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("noisy?miss=2", r"suite tiny v1: tracking.detectors: 'noisy\?miss=2': miss must be 0 or"),
        ("noisy?mis=0.1", "tracking.detectors: .*its arguments: miss=0.1, miss_run"),
        ("noisi", "suite tiny v1: tracking.detectors: no detector 'noisi'"),
        ("noisy?miss", "suite tiny v1: tracking.detectors: 'noisy.miss'"),
        ("fused", "suite tiny v1: tracking.detectors: .*camera"),
    ],
)
def test_impossible_makers_are_refused_before_anything_runs(spec, message) -> None:
    with pytest.raises(SuiteError, match=message):
        jobs_of(parse_suite(TINY.replace('"noisy-misses"', f'"{spec}"'), "tiny"))


def test_the_suite_has_lu_2018_and_eight_scenes_more() -> None:
    suite = load_suite("tracking")
    lu = [name for name in suite.scenarios if name.startswith("lu2018-")]
    assert set(lu) == {name for name in SCENARIOS if name.startswith("lu2018-")}
    assert len(suite.scenarios) - len(lu) >= 8
    assert len(suite.boards["tracking"].detectors) >= 5
    assert ORACLE not in suite.boards["tracking"].detectors


def test_a_tracker_that_is_not_installed_has_a_row_that_says_so(suite) -> None:
    reason = "no-such-library is not installed: pip install no-such-library"
    jobs = [
        replace(job, missing=reason) if job.entry.startswith("gnn") else job
        for job in jobs_of(suite)
    ]
    done = {job.key: scored(job) for job in jobs if not job.missing}
    run_jobs([j for j in jobs if j.missing], lambda job, outcome: done.update({job.key: outcome}))
    gathered = gather(jobs, done, {"jobs": 1})
    text = printed([board_table(gathered, "tracking", 80)])
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert any(line.startswith("1 nearest") for line in lines)
    assert any(line.startswith("gnn") and "not" in line for line in lines)
    assert not gathered.not_installed("nearest")
    assert gathered.not_installed("gnn")
    assert gathered.failed_entries == []
    assert gathered.standing("tracking", "gnn").rank is None
    shown = failure_lines(gathered, "tracking")
    assert len(shown) == 2
    assert all(line.endswith(reason) for line in shown)


def test_marks_stand_on_no_board_alone(suite) -> None:
    assert {job.board.name for job in plan(suite, [], boards=["detection", "tracking"]).jobs} == {
        "tracking"
    }
