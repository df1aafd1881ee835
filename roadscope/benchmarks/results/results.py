"""The results of a run: rows, standings and failures of its boards."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import msgspec

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import CONDITIONS
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.results.agreement import BoardAgreement
from roadscope.benchmarks.results.job_scores import JobScores
from roadscope.benchmarks.results.rows import EntryResult, Row, part_rows, whole_rows
from roadscope.benchmarks.results.standing import Standing, standings
from roadscope.benchmarks.store import Outcome
from roadscope.core.names import unknown


class BreakdownError(ValueError):
    """Unknown breakdown."""


@dataclass(frozen=True, slots=True)
class Failure:
    """An entry that failed in an episode, and why.

    condition: weather, light and faults in words. log: the end of what the plug-in printed.
    not_installed: whether it failed because something that it needs is not installed.
    log_file: file with the output, also of other episodes; empty if there is none.
    """

    board: str
    entry: str
    scenario: str
    seed: int
    condition: str
    reason: str
    log: str = ""
    not_installed: bool = False
    log_file: str = ""


@dataclass(frozen=True, slots=True)
class Results:
    """The results of a run.

    manifest: its versions, suite and machine.
    rows: figures over all episodes, entries in rank order, marks last.
    parts: figures broken down.
    standings: the order of the entries, and how certain it is.
    agreements: on recorded data, how its ranks agree with those on simulated traffic.
    jobs: the scores of every job, from which all other fields are computed.
    """

    manifest: Mapping[str, Any]
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]
    parts: tuple[Row, ...] = ()
    standings: tuple[Standing, ...] = ()
    agreements: tuple[BoardAgreement, ...] = ()
    jobs: tuple[JobScores, ...] = ()

    def boards(self) -> list[str]:
        """Return the names of the boards that have rows."""
        return list(dict.fromkeys(row.board for row in self.rows))

    def entries(self, board: str) -> list[str]:
        """Return the entries of a board, best first, then its marks."""
        return list(dict.fromkeys(row.entry for row in self.rows if row.board == board))

    def row(self, board: str, entry: str, metric: str) -> Row | None:
        """Return the row of a metric, or None if it was not measured."""
        named = (r for r in self.rows if (r.board, r.entry, r.metric) == (board, entry, metric))
        return next(named, None)

    def breakdown(self, by: str, board: str = "detection") -> list[Row]:
        """Return the rows of a breakdown of a board; `BreakdownError` if it has none such."""
        check_breakdown(by, [board_named(board)])
        return [row for row in self.parts if (row.board, row.by) == (board, by)]

    def standing(self, board: str, entry: str) -> Standing:
        """Return the standing of an entry; that of an unknown one is empty."""
        places = (s for s in self.standings if (s.board, s.entry) == (board, entry))
        return next(places, Standing(board, entry, None))

    def nothing_eligible(self, board: str) -> bool:
        """Return whether no object of any episode was eligible on a board."""
        metric = board_named(board).object_metric
        values = [row.value for row in self.rows if (row.board, row.metric) == (board, metric)]
        return bool(values) and all(value is None for value in values)

    def not_installed(self, entry: str) -> bool:
        """Return whether an entry failed only because something that it needs is not installed."""
        failures = [failure for failure in self.failures if failure.entry == entry]
        return bool(failures) and all(failure.not_installed for failure in failures)

    @property
    def failed_entries(self) -> list[str]:
        """The entries that failed in any episode, without those that are not installed."""
        names = dict.fromkeys(failure.entry for failure in self.failures)
        return [name for name in names if not self.not_installed(name)]

    def to_json(self) -> str:
        """Return everything as JSON text."""
        content = {
            "manifest": dict(self.manifest),
            "standings": msgspec.to_builtins(self.standings),
            "rows": msgspec.to_builtins(self.rows),
            "parts": msgspec.to_builtins(self.parts),
            "failures": msgspec.to_builtins(self.failures),
            "agreements": msgspec.to_builtins(self.agreements),
            "scores": [job.to_json() for job in self.jobs],
        }
        # The standard library refuses NaN, but with an indent it is slow.
        return msgspec.json.format(json.dumps(content, allow_nan=False), indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Read what `to_json` returned; anything else raises `ValueError`.

        The end of what failed plug-ins printed is in the failures, not in the jobs.
        """
        content = msgspec.json.decode(text)
        if not isinstance(content, dict) or not isinstance(content.get("manifest"), dict):
            raise ValueError("no results of roadscope leaderboard: there is no manifest")
        types: dict[str, Any] = {
            "rows": tuple[Row, ...],
            "failures": tuple[Failure, ...],
            "parts": tuple[Row, ...],
            "standings": tuple[Standing, ...],
            "agreements": tuple[BoardAgreement, ...],
        }
        read = {name: msgspec.convert(content.get(name, ()), kind) for name, kind in types.items()}
        try:
            jobs = tuple(JobScores.from_json(item) for item in content.get("scores", ()))
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"scores are not as expected: {error!r}") from error
        return cls(content["manifest"], jobs=jobs, **read)


def check_breakdown(by: str, boards: Sequence[Board]) -> None:
    """Raise `BreakdownError` if none of the boards has this breakdown."""
    possible = list(dict.fromkeys(each.by for board in boards for each in board.breakdowns))
    if by not in possible:
        board = f"{boards[0].name} " if len(boards) == 1 else ""
        raise BreakdownError(unknown(f"{board}breakdown", by, possible))


def gather(
    jobs: Sequence[Job], outcomes: Mapping[str, Outcome], manifest: Mapping[str, Any]
) -> Results:
    """Return the results of jobs with these outcomes."""
    return results_of([_job_scores(job, outcomes[job.key]) for job in jobs], manifest)


def results_of(scores: Sequence[JobScores], manifest: Mapping[str, Any]) -> Results:
    """Return the results of jobs, of a run or of a file."""
    order: list[Standing] = []
    results: list[EntryResult] = []
    for board in sorted({job.board for job in scores}):
        entries = {each.entry: each for each in entry_results(scores, board)}
        places = standings(list(entries.values()))
        order += places
        results += [entries[place.entry] for place in places]
    return Results(
        manifest,
        rows=tuple(row for result in results for row in whole_rows(result)),
        failures=tuple(
            Failure(
                j.board,
                j.entry,
                j.scenario,
                j.seed,
                j.condition,
                j.reason,
                j.log,
                j.not_installed,
            )
            for j in scores
            if j.reason is not None
        ),
        parts=tuple(row for result in results for row in part_rows(result)),
        standings=tuple(order),
        jobs=tuple(scores),
    )


def entry_results(scores: Sequence[JobScores], board: str) -> list[EntryResult]:
    """Return the scores of each entry of a board."""
    grouped: dict[str, list[JobScores]] = {}
    for job in scores:
        if job.board == board:
            grouped.setdefault(job.entry, []).append(job)
    return [_entry_result(jobs) for jobs in grouped.values()]


def condition_of(job: Job) -> str:
    """Return weather, light and faults of a job's episode in words."""
    return CONDITIONS["condition"](job.episode)


def _job_scores(job: Job, outcome: Outcome) -> JobScores:
    episode = job.episode
    conditions = board_named(job.board.name).conditions
    return JobScores(
        job.board.name,
        job.entry,
        episode.scenario,
        episode.seed,
        condition_of(job),
        job.inputs,
        outcome.scores,
        outcome.reason,
        job.mark,
        {by: condition(episode) for by, condition in conditions.items()},
        outcome.log,
        bool(job.missing),
    )


def _entry_result(jobs: Sequence[JobScores]) -> EntryResult:
    board, entry, mark = board_named(jobs[0].board), jobs[0].entry, jobs[0].mark
    sound = tuple(job for job in jobs if job.reason is None)
    return EntryResult(board, entry, mark, sound, len(jobs), None if sound else jobs[0].reason)
