"""The results of a run: rows, standings (ranks with intervals) and failures of its boards."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import msgspec

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.results.agreement import BoardAgreement, predictions
from roadscope.benchmarks.results.rows import (
    Block,
    EntryResult,
    JobScores,
    Row,
    headline_scores,
    paired,
    part_rows,
    whole_rows,
)
from roadscope.benchmarks.results.statistics import Interval, pooled_interval
from roadscope.benchmarks.store import Outcome
from roadscope.core.names import unknown

LEVEL = 0.95
"""Of confidence intervals of ranks."""


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
class Standing:
    """The place of one entry on its board.

    mark: such as `upper mark`, or None if it is ranked.
    rank: from 1; None for marks and for entries that failed in every episode.
    rank_low, rank_high: 95 % confidence interval of its rank; None if there are too few seeds.
    behind: by how much the headline metric of the best entry is better, on the same episodes.
    behind_low, behind_high: its 95 % interval.
    reason: why it failed in every episode; None if it succeeded in any.
    """

    board: str
    entry: str
    mark: str | None
    rank: int | None = None
    rank_low: int | None = None
    rank_high: int | None = None
    behind: float | None = None
    behind_low: float | None = None
    behind_high: float | None = None
    reason: str | None = None

    @property
    def place(self) -> str:
        """The rank with its interval, or the mark, or `failed`, as text."""
        if self.rank is None:
            return self.mark or ("failed" if self.reason else "")
        if self.rank_low == self.rank_high:
            return str(self.rank)
        return f"{self.rank} [{self.rank_low}, {self.rank_high}]"


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
            "predictions": msgspec.to_builtins(
                [each for board in self.boards() for each in predictions(self.jobs, board)]
            ),
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
    places: list[Standing] = []
    results: list[EntryResult] = []
    for board in sorted({job.board for job in scores}):
        entries = {each.entry: each for each in entry_results(scores, board)}
        of_board = standings(list(entries.values()))
        places += of_board
        results += [entries[place.entry] for place in of_board]
    return Results(
        manifest,
        rows=tuple(row for result in results for row in whole_rows(result)),
        failures=tuple(
            msgspec.convert(job, Failure, from_attributes=True)
            for job in scores
            if job.reason is not None
        ),
        parts=tuple(row for result in results for row in part_rows(result)),
        standings=tuple(places),
        jobs=tuple(scores),
    )


def entry_results(scores: Sequence[JobScores], board: str) -> list[EntryResult]:
    """Return the scores of each entry of a board."""
    grouped: dict[str, list[JobScores]] = {}
    for job in scores:
        if job.board == board:
            grouped.setdefault(job.entry, []).append(job)
    results = []
    for entry, jobs in grouped.items():
        sound = tuple(job for job in jobs if job.reason is None)
        reason = None if sound else jobs[0].reason
        results.append(
            EntryResult(board_named(board), entry, jobs[0].mark, sound, len(jobs), reason)
        )
    return results


def _job_scores(job: Job, outcome: Outcome) -> JobScores:
    episode = job.episode
    conditions = board_named(job.board.name).conditions
    return JobScores(
        job.board.name,
        job.entry,
        episode.scenario,
        episode.seed,
        episode.condition,
        job.inputs,
        outcome.scores,
        outcome.reason,
        job.mark,
        conditions={by: condition(episode) for by, condition in conditions.items()},
        log=outcome.log,
        not_installed=bool(job.missing),
    )


def standings(results: Sequence[EntryResult]) -> list[Standing]:
    """Return the entries of one board in rank order, then its marks.

    Entries with failures come after all others; those that failed in every episode come last and
    have no rank. The interval of a rank follows from the numbers of entries that are significantly
    better and worse, by paired intervals at a level for all comparisons of the entry together
    (Bonferroni; Mogstad et al. 2024).
    """
    by_order = sorted(results, key=_order)
    ranked = [result for result in by_order if result.mark is None]
    marks = [result for result in by_order if result.mark is not None]
    marks.sort(key=lambda result: result.mark != "upper mark")
    scores = [headline_scores(result) for result in ranked]
    sound = [i for i, result in enumerate(ranked) if not result.failed and scores[i]]
    places = []
    for i, result in enumerate(ranked):
        best, worst = _place(i, scores, sound) if i in sound else (None, None)
        # Without a common block the difference is NaN.
        gap = _compared(scores[sound[0]] if sound else {}, scores[i], LEVEL)
        ends = (gap.mean, gap.low, gap.high)
        behind, low, high = (end if math.isfinite(end) else None for end in ends)
        name, rank = result.board.name, i + 1 if result.sound else None
        places.append(
            Standing(name, result.entry, None, rank, best, worst, behind, low, high, result.reason)
        )
    return places + [Standing(r.board.name, r.entry, r.mark, reason=r.reason) for r in marks]


def _order(result: EntryResult) -> tuple[int, float, str]:
    """Order by failures, in some episodes or in all, then by the board's first metric."""
    scores = list(headline_scores(result).values())
    value = pooled_interval(scores).mean
    sign = 1 if any(score.better == "lower" for score in scores) else -1
    failed = bool(result.failed) + (not result.sound)
    return failed, sign * value if math.isfinite(value) else math.inf, result.entry


def _place(
    own: int, scores: Sequence[Mapping[Block, Score]], rivals: Sequence[int]
) -> tuple[int | None, int | None]:
    """Return the lowest and highest rank that an entry may have among its rivals and itself."""
    others = [i for i in rivals if i != own]
    level = 1 - (1 - LEVEL) / max(len(others), 1)
    leads = [_compared(scores[i], scores[own], level) for i in others]
    if any(math.isnan(lead.low) for lead in leads):
        return None, None
    better = sum(lead.low > 0 for lead in leads)
    worse = sum(lead.high < 0 for lead in leads)
    return 1 + better, len(rivals) - worse


def _compared(ones: Mapping[Block, Score], others: Mapping[Block, Score], level: float) -> Interval:
    """Return by how much `ones` are better than `others`, with an interval."""
    if any(score.better == "lower" for score in ones.values()):
        ones, others = others, ones
    return paired(ones, others, level=level)
