"""Ranks of entries with confidence intervals over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.results.rows import Block, EntryResult, headline_scores
from roadscope.benchmarks.results.statistics import Interval, paired_interval, pooled_interval

LEVEL = 0.95


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


def standings(results: Sequence[EntryResult]) -> list[Standing]:
    """Return the entries of one board in rank order, then its marks.

    Entries with failures come after all others; those that failed in every episode come last and
    have no rank. The interval of a rank follows from the numbers of entries that are significantly
    better and worse, by paired intervals at a level for all comparisons of the entry together
    (Bonferroni; Mogstad et al. 2024).
    """
    ranked = sorted((r for r in results if r.mark is None), key=_order)
    marks = sorted((r for r in results if r.mark is not None), key=_order_of_marks)
    scores = [headline_scores(result) for result in ranked]
    sound = [i for i, result in enumerate(ranked) if not result.failed and scores[i]]
    places = []
    for i, result in enumerate(ranked):
        best, worst = _place(i, scores, sound) if i in sound else (None, None)
        behind = _compared(scores[sound[0]], scores[i], LEVEL) if sound and scores[i] else None
        gap = (None, None, None) if behind is None else _finite(behind)
        board, rank = result.board.name, i + 1 if result.sound else None
        place = Standing(board, result.entry, None, rank, best, worst, *gap, result.reason)
        places.append(place)
    return places + [Standing(r.board.name, r.entry, r.mark, reason=r.reason) for r in marks]


def _order_of_marks(result: EntryResult) -> tuple[bool, int, float, str]:
    return result.mark != "upper mark", *_order(result)


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
    common = [block for block in ones if block in others]
    if any(ones[block].better == "lower" for block in common):
        ones, others = others, ones
    return paired_interval(
        [ones[block] for block in common],
        [others[block] for block in common],
        [scenario for scenario, _ in common],
        level=level,
    )


def _finite(interval: Interval) -> tuple[float | None, float | None, float | None]:
    ends = interval.mean, interval.low, interval.high
    mean, low, high = (end if math.isfinite(end) else None for end in ends)
    return mean, low, high
