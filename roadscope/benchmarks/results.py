"""Rows of a leaderboard, from the scores of its jobs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from roadscope.benchmarks.job import Job
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.statistics import pooled_interval
from roadscope.benchmarks.store import Outcome

FIRST_METRIC = {"detection": "f1", "tracking": "hota"}
"""By which each board is ranked."""


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of one entry.

    value: pooled over episodes; low and high: its 95 % interval over seeds; all three None
        where there is none.
    n: number of episodes behind it.
    """

    board: str
    entry: str
    metric: str
    value: float | None
    low: float | None
    high: float | None
    n: int
    unit: str
    better: str


@dataclass(frozen=True, slots=True)
class Failure:
    """An entry that did not come through an episode, and why."""

    board: str
    entry: str
    scenario: str
    seed: int
    reason: str


@dataclass(frozen=True, slots=True)
class Results:
    """What a run found: conditions, rows in rank order, failures."""

    manifest: Mapping[str, Any]
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]

    def boards(self) -> list[str]:
        """Return the boards that have rows."""
        return list(dict.fromkeys(row.board for row in self.rows))

    def entries(self, board: str) -> list[str]:
        """Return the entries of a board, best first."""
        return list(dict.fromkeys(row.entry for row in self.rows if row.board == board))

    def row(self, board: str, entry: str, metric: str) -> Row | None:
        """Return one figure, or None where it was not measured."""
        for row in self.rows:
            if (row.board, row.entry, row.metric) == (board, entry, metric):
                return row
        return None

    def board_of(self, entry: str) -> str:
        """Return the board that an entry is on."""
        return next(row.board for row in self.rows if row.entry == entry)

    def nothing_eligible(self, board: str) -> bool:
        """Say whether a board lacks every value of what is a share of the objects to be found."""
        share = {"detection": "detection_rate", "tracking": "mota"}[board]
        values = [row.value for row in self.rows if (row.board, row.metric) == (board, share)]
        return bool(values) and all(value is None for value in values)

    def reasons(self) -> list[tuple[str, int, str]]:
        """Return entry, number of episodes and reason of all failures, each reason once."""
        counts: dict[tuple[str, str], int] = {}
        for failure in self.failures:
            key = failure.entry, failure.reason
            counts[key] = counts.get(key, 0) + 1
        return [(entry, count, reason) for (entry, reason), count in counts.items()]

    def barren(self) -> bool:
        """Say whether no entry came through a single episode."""
        return all(row.metric == "failed_episodes" for row in self.rows)

    def to_json(self) -> str:
        """Return manifest, rows and failures as JSON text."""
        content = {
            "manifest": dict(self.manifest),
            "rows": [asdict(row) for row in self.rows],
            "failures": [asdict(failure) for failure in self.failures],
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def gather(
    jobs: Sequence[Job], outcomes: Mapping[str, Outcome], manifest: Mapping[str, Any]
) -> Results:
    """Join the outcomes of jobs into ranked rows."""
    grouped: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        grouped.setdefault((job.board, job.entry), []).append(job)
    entries = [_rows(board, entry, group, outcomes) for (board, entry), group in grouped.items()]
    ranked = sorted(entries, key=_rank)
    failures = [
        Failure(job.board, job.entry, job.episode.scenario, job.episode.seed, reason)
        for job in jobs
        if (reason := outcomes[job.key].reason) is not None
    ]
    return Results(manifest, tuple(row for rows in ranked for row in rows), tuple(failures))


def _rows(
    board: str, entry: str, jobs: Sequence[Job], outcomes: Mapping[str, Outcome]
) -> list[Row]:
    done = [(job.episode.scenario, outcomes[job.key]) for job in jobs]
    sound = [(scenario, o.scores) for scenario, o in done if o.reason is None]
    names = list(dict.fromkeys(name for _, scores in sound for name in scores))
    rows = []
    for name in names:
        samples = [(scenario, scores[name]) for scenario, scores in sound]
        rows.append(_row(board, entry, name, samples))
    failed = len(done) - len(sound)
    count = Row(board, entry, "failed_episodes", failed, None, None, len(done), "1", "lower")
    return [*rows, count]


def _row(board: str, entry: str, metric: str, samples: Sequence[tuple[str, Score]]) -> Row:
    first = samples[0][1]
    interval = pooled_interval(
        [score for _, score in samples], [scenario for scenario, _ in samples]
    ).clipped(first.least, first.most)
    value, low, high = (
        v if math.isfinite(v) else None for v in (interval.mean, interval.low, interval.high)
    )
    return Row(board, entry, metric, value, low, high, interval.n, first.unit, first.better)


def _rank(rows: Sequence[Row]) -> tuple[str, float, float, str]:
    """Order by board, then entries without failures, then the board's first metric."""
    named = {row.metric: row.value for row in rows}
    board, failed = rows[0].board, named.get("failed_episodes") or 0.0
    first = named.get(FIRST_METRIC[board])
    return board, float(failed > 0), math.inf if first is None else -first, rows[0].entry
