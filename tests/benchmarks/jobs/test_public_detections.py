"""Trackers on the detections of several makers: one entry, and a rank on each."""

import io

import pytest
from rich.console import Console

from roadscope.benchmarks.boards.breakdown_tables import breakdown_tables, markdown_lines
from roadscope.benchmarks.boards.columns import shown_columns
from roadscope.benchmarks.boards.results import Results, gather
from roadscope.benchmarks.boards.tables import board_table, conditions, failure_lines
from roadscope.benchmarks.jobs.entries import kind_of
from roadscope.benchmarks.jobs.job import execute
from roadscope.benchmarks.jobs.plan import plan, tracking_jobs
from roadscope.benchmarks.jobs.stack import EntryError, guarded
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.suite import Suite, SuiteError, load_suite, parse_suite
from roadscope.core import NotInstalledError, Requirement, SpecError
from roadscope.envs.traffic.scenarios import SCENARIOS
from roadscope.trackers import TRACKERS

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


def scored(job) -> Outcome:
    """HOTA of 0.5 and 0.4 on `pag`, 0.6 and 0.9 elsewhere, 1 on the oracle; 10 objects each."""
    elsewhere = {"nearest": 0.6, "gnn": 0.9}[job.tracker]
    value = 1.0 if job.detector == ORACLE else HOTA.get((job.tracker, job.detector), elsewhere)
    return Outcome({"hota": Score(value, "1", "higher", 10, 0.0, 1.0, weight=10.0)})


@pytest.fixture(scope="module")
def results(suite) -> Results:
    jobs = tracking_jobs(suite, suite.trackers)
    return gather(jobs, {job.key: scored(job) for job in jobs}, {"jobs": 1})


def test_a_tracker_is_one_entry_and_on_the_oracle_another(suite) -> None:
    jobs = plan(suite, [], ("tracking",)).tracking
    assert {(job.entry, job.detector) for job in jobs} == {
        *((tracker, maker) for tracker in suite.trackers for maker in MAKERS),
        *((f"{tracker} on oracle", "oracle") for tracker in suite.trackers),
    }
    assert len({job.key for job in jobs}) == len(jobs)
    assert len({job.detections_path for job in jobs}) == 4 * len(MAKERS) + 4


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
    console = Console(file=io.StringIO(), width=80)
    for table in breakdown_tables(results, "tracking", "detector", 80):
        console.print(table)
    text = console.file.getvalue()
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert lines[0] == "HOTA by detector"
    assert "gnn 0.40 (2) 0.90 (1) 0.90 (1) -" in lines
    assert "nearest 0.50 (1) 0.60 (2) 0.60 (2) -" in lines
    assert "gnn on oracle - - - 1.00" in lines
    assert max(map(len, text.splitlines())) <= 80
    assert "continued" not in text
    assert "| gnn | 0.40 (2) | 0.90 (1) | 0.90 (1) | - |" in markdown_lines(results, "tracking")


def test_the_five_of_the_suite_fit_80_columns() -> None:
    suite = load_suite("tracking")
    jobs = tracking_jobs(suite, ["gnn", "nearest"])
    found = gather(jobs, {job.key: scored(job) for job in jobs}, {"jobs": 1})
    console = Console(file=io.StringIO(), width=80)
    for table in breakdown_tables(found, "tracking", "detector", 80):
        console.print(table)
    console.print(board_table(found, "tracking", 80))
    text = console.file.getvalue()
    assert "continued" not in text
    assert "distanc-" not in text
    assert "…" not in text


def test_conditions_name_all_makers(suite) -> None:
    told = conditions(suite)
    assert "the detections of pag, of noisy-misses, of noisy?clutter=3; figures are" in told
    assert "'on oracle' the true boxes." in told


def test_the_board_answers_lu_2018_in_80_columns() -> None:
    assert list(shown_columns("tracking", 80)) == [
        "hota", "mota", "idf1", "id_switches", "wrong_associations", "kept_through_occlusion",
        "call_p50_ms",
    ]  # fmt: skip


def test_noise_models_are_no_entries() -> None:
    with pytest.raises(SpecError, match="a suite gives it to trackers"):
        kind_of("noisy?miss=0.2")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("noisy?miss=2", r"suite tiny v1, tracking.detectors: 'noisy\?miss=2': miss must be 0 or"),
        ("noisy?mis=0.1", "tracking.detectors: .*its arguments: miss=0.1, miss_run"),
        ("noisi", "tracking.detectors: no detector 'noisi'"),
    ],
)
def test_impossible_makers_are_refused_before_anything_runs(spec, message) -> None:
    with pytest.raises(SuiteError, match=message):
        plan(parse_suite(TINY.replace('"noisy-misses"', f'"{spec}"'), "tiny"), [], ("tracking",))


def test_the_suite_has_lu_2018_and_eight_scenes_more() -> None:
    suite = load_suite("tracking")
    lu = [name for name in suite.scenarios if name.startswith("lu2018-")]
    assert set(lu) == {name for name in SCENARIOS if name.startswith("lu2018-")}
    assert len(suite.scenarios) - len(lu) >= 8
    assert len(suite.public_detectors) >= 5
    assert ORACLE not in suite.public_detectors


def test_a_tracker_that_is_not_installed_has_a_row_that_says_so(suite, monkeypatch) -> None:
    reason = Requirement("no-such-library", "pip install no-such-library").missing
    monkeypatch.setattr(TRACKERS, "missing", {"gnn": reason}.get)
    jobs = plan(suite, [], ("tracking",)).tracking
    done = {job.key: execute(job) if job.tracker == "gnn" else scored(job) for job in jobs}
    found = gather(jobs, done, {"jobs": 1})
    console = Console(file=io.StringIO(), width=80)
    console.print(board_table(found, "tracking", 80))
    lines = [" ".join(line.split()) for line in console.file.getvalue().splitlines()]
    assert any(line.startswith("1 nearest 0.57") for line in lines)
    assert any(line.startswith("gnn (not") for line in lines)
    assert not found.not_installed("nearest")
    assert found.standing("tracking", "gnn").rank is None
    assert failure_lines(found, "tracking") == [
        f"{entry} is left out: {reason}" for entry in ("gnn", "gnn on oracle")
    ]
    assert ("gnn", 12, f"gnn: {reason}") in found.reasons()


def test_what_is_not_installed_is_said_without_a_place() -> None:
    def make():
        raise NotInstalledError("norfair is not installed: pip install norfair")

    with pytest.raises(EntryError, match=r"^norfair: norfair is not installed: pip install norf"):
        guarded("norfair", make)


def test_marks_stand_on_no_board_alone(suite) -> None:
    both = plan(suite, [], ("detection", "tracking"))
    assert both.detection == ()
    assert both.tracking
