"""Results of a run: what is refused, and what JSON holds."""

import json
from dataclasses import replace

import pytest

from roadscope.benchmarks.boards import BOARDS
from roadscope.benchmarks.metrics import ratio
from roadscope.benchmarks.results import (
    BreakdownError,
    JobScores,
    Results,
    check_breakdown,
    results_of,
)


def job(entry: str, seed: int, *, reason: str | None = None, mark: str | None = None) -> JobScores:
    scores = {} if reason else {"f1": ratio(seed, 10), "detection_rate": ratio(seed, 10)}
    return JobScores(
        "detection",
        entry,
        "merge",
        seed,
        "clear",
        "",
        scores,
        reason,
        mark,
        {"weather": "clear", "scenario": "merge", "condition": "clear"},
        "the log",
    )


@pytest.fixture
def results() -> Results:
    jobs = [job("mine", seed) for seed in (1, 3, 5)]
    jobs += [job("oracle", seed, mark="upper mark") for seed in (1, 3, 5)]
    jobs += [job("late", 1), job("late", 3, reason="late: TimeoutError")]
    jobs += [replace(job("bare", s, reason="bare: x"), not_installed=True) for s in (1, 3)]
    return results_of(jobs, {"suite": "tiny"})


def test_failures_keep_their_reason_and_log_and_are_of_their_entry_alone(results) -> None:
    assert [(f.entry, f.seed) for f in results.failures] == [("late", 3), ("bare", 1), ("bare", 3)]
    assert results.failures[0].reason == "late: TimeoutError"
    assert results.failures[0].log == "the log"
    assert results.failed_entries == ["late"]
    assert results.not_installed("bare")
    assert not results.not_installed("late")
    assert results.row("detection", "mine", "failed_episodes").value == 0
    assert results.row("detection", "late", "failed_episodes").value == 1


def test_entries_come_in_rank_order_and_marks_last(results) -> None:
    assert results.entries("detection") == ["mine", "late", "bare", "oracle"]
    assert results.boards() == ["detection"]
    assert results.standing("detection", "nobody").rank is None
    assert results.row("detection", "mine", "no such metric") is None


def test_json_holds_the_scores_of_every_job_and_they_give_the_same_rows(results) -> None:
    content = json.loads(results.to_json())
    assert len(content["scores"]) == len(results.jobs) == 10
    again = results_of([JobScores.from_json(item) for item in content["scores"]], {})
    assert again.rows == results.rows
    assert again.parts == results.parts
    assert again.standings == results.standings


def test_unknown_breakdowns_are_refused_with_what_there_is(results) -> None:
    with pytest.raises(BreakdownError, match=r"'rnage'.*'range'"):
        results.breakdown("rnage")
    with pytest.raises(BreakdownError, match=r"tracking.*'range'.*scenario"):
        check_breakdown("range", [BOARDS["tracking"]])
    check_breakdown("range", [BOARDS["detection"], BOARDS["tracking"]])
