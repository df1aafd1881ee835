"""The results of a run: rows, standings and failures of its boards."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

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
    """Results are not broken down by that."""


@dataclass(frozen=True, slots=True)
class Failure:
    """An entry that failed in an episode, and why.

    condition: weather, light and faults in words. log: the end of what the plug-in printed.
    not_installed: whether it failed because something that it needs is not installed.
    log_file: where that was written, with what it printed in other episodes; empty if nowhere.
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

    manifest: its conditions.
    rows: figures over all episodes, entries in rank order, marks last.
    parts: the same broken down.
    standings: the order of the entries, and how certain it is.
    agreements: on recorded data, how its ranks agree with those on simulated traffic.
    jobs: the scores of every job, which all the rest is computed from.
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
        """Return one figure, or None where it was not measured."""
        named = (r for r in self.rows if (r.board, r.entry, r.metric) == (board, entry, metric))
        return next(named, None)

    def breakdown(self, by: str, board: str = "detection") -> list[Row]:
        """Return the rows of a board by one of its breakdowns; else `BreakdownError`."""
        check_breakdown(by, [board_named(board)])
        return [row for row in self.parts if (row.board, row.by) == (board, by)]

    def standing(self, board: str, entry: str) -> Standing:
        """Return the place of an entry; an unknown one has none."""
        places = (s for s in self.standings if (s.board, s.entry) == (board, entry))
        return next(places, Standing(board, entry, None))

    def nothing_eligible(self, board: str) -> bool:
        """Return whether a board had nothing that was to be found."""
        metric = board_named(board).object_metric
        values = [row.value for row in self.rows if (row.board, row.metric) == (board, metric)]
        return bool(values) and all(value is None for value in values)

    def not_installed(self, entry: str) -> bool:
        """Return whether an entry failed only because something that it needs is not installed."""
        failures = [failure for failure in self.failures if failure.entry == entry]
        return bool(failures) and all(failure.not_installed for failure in failures)

    @property
    def failed_entries(self) -> list[str]:
        """The entries that failed in any episode, but for those that are not installed."""
        names = dict.fromkeys(failure.entry for failure in self.failures)
        return [name for name in names if not self.not_installed(name)]

    def to_json(self) -> str:
        """Return everything as JSON text."""
        content = {
            "manifest": dict(self.manifest),
            "standings": [asdict(standing) for standing in self.standings],
            "rows": [asdict(row) for row in self.rows],
            "parts": [asdict(row) for row in self.parts],
            "failures": [asdict(failure) for failure in self.failures],
            "agreements": [asdict(agreement) for agreement in self.agreements],
            "scores": [job.to_json() for job in self.jobs],
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def check_breakdown(by: str, boards: Sequence[Board]) -> None:
    """Refuse what none of the boards is broken down by."""
    known = list(dict.fromkeys(each.by for board in boards for each in board.breakdowns))
    if by not in known:
        board = f"{boards[0].name} " if len(boards) == 1 else ""
        raise BreakdownError(unknown(f"{board}breakdown", by, known))


def gather(
    jobs: Sequence[Job], outcomes: Mapping[str, Outcome], manifest: Mapping[str, Any]
) -> Results:
    """Join the outcomes of jobs into rows, ranked."""
    return results_of([_job_scores(job, outcomes[job.key]) for job in jobs], manifest)


def results_of(scores: Sequence[JobScores], manifest: Mapping[str, Any]) -> Results:
    """Join the scores of jobs, of a run or of a file, into rows, ranked."""
    grouped: dict[str, dict[str, list[JobScores]]] = {}
    for job in scores:
        grouped.setdefault(job.board, {}).setdefault(job.entry, []).append(job)
    order: list[Standing] = []
    results: list[EntryResult] = []
    for board in sorted(grouped):
        entries = {entry: _entry_result(own) for entry, own in grouped[board].items()}
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
