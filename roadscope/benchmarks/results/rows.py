"""The scores of jobs, and rows: the metrics of entries, pooled over the scores of their jobs."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, Self

from roadscope.benchmarks.boards import Board
from roadscope.benchmarks.metrics.breakdown import part_name, split_name
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.results.statistics import (
    Interval,
    merged,
    paired_interval,
    pooled_interval,
)

Block = tuple[str, int]
"""Scenario and seed: jobs of a block are on the same traffic."""


class JobName(NamedTuple):
    """What identifies a job beside its entry; jobs of two runs with equal names are compared.

    condition: weather, light and faults in words. inputs: the detector whose detections it gets.
    """

    board: str
    scenario: str
    seed: int
    condition: str
    inputs: str


@dataclass(frozen=True, slots=True)
class JobScores:
    """The scores of one entry on one episode.

    condition: weather, light and faults in words.
    inputs: the detector whose detections the entry gets; empty if it gets none.
    scores: by metric; empty if it failed.
    reason: why it failed, or None. log: the end of what the failed plug-in printed.
    not_installed: whether it failed because something that it needs is not installed.
    mark: which mark of the board the entry is, or None.
    conditions: the value of each condition of the board, such as `weather` or `sequence`.
    """

    board: str
    entry: str
    scenario: str
    seed: int
    condition: str
    inputs: str
    scores: Mapping[str, Score]
    reason: str | None = None
    mark: str | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)
    log: str = ""
    not_installed: bool = False

    @property
    def name(self) -> JobName:
        """The name by which it is compared with the same job of another run."""
        return JobName(self.board, self.scenario, self.seed, self.condition, self.inputs)

    def to_json(self) -> dict[str, Any]:
        """Return the job as a JSON object, without its log."""
        named = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "log"}
        scores = {name: score.to_json() for name, score in self.scores.items()}
        return {**named, "scores": scores, "conditions": dict(self.conditions)}

    @classmethod
    def from_json(cls, item: Mapping[str, Any]) -> Self:
        """Read what `to_json` returned; marks and conditions may be missing."""
        texts = {name: str(item[name]) for name in ("board", "entry", "scenario")}
        texts |= {name: str(item.get(name) or "") for name in ("condition", "inputs")}
        reason, mark = item.get("reason"), item.get("mark")
        return cls(
            **texts,
            seed=int(item["seed"]),
            scores={name: Score.from_json(score) for name, score in item["scores"].items()},
            reason=None if reason is None else str(reason),
            mark=None if mark is None else str(mark),
            conditions={str(k): str(v) for k, v in item.get("conditions", {}).items()},
            not_installed=bool(item.get("not_installed")),
        )


@dataclass(frozen=True, slots=True)
class Row:
    """One metric of one entry.

    value: pooled over episodes. low, high: its 95 % interval over seeds. None if not measured.
    n: number of episodes.
    by, band: the breakdown (`range`) and its part (`0-20`); empty for whole episodes.
    samples: number of objects, detections, frames or the like.
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
    by: str = ""
    band: str = ""
    samples: int = 0


@dataclass(frozen=True, slots=True)
class EntryResult:
    """The scores of all jobs of an entry.

    mark: which mark it is, or None if it is ranked.
    sound: the jobs that did not fail.
    episodes: number of all jobs.
    reason: why all failed, or None if any did not.
    """

    board: Board
    entry: str
    mark: str | None
    sound: tuple[JobScores, ...]
    episodes: int
    reason: str | None = None

    @property
    def failed(self) -> int:
        """Number of episodes in which it failed."""
        return self.episodes - len(self.sound)


def whole_rows(result: EntryResult) -> list[Row]:
    """Return the rows of an entry over whole episodes, and the number of failures."""
    names = [
        name for name in _names(result) if not split_name(name)[1] and not _is_silent(result, name)
    ]
    rows = [_row(result, name, samples_of(result, name)) for name in names]
    rows += [_median_row(result, name) for name in result.board.medians if name in names]
    board, entry, failed = result.board.name, result.entry, result.failed
    count = Row(board, entry, "failed_episodes", failed, None, None, result.episodes, "1", "lower")
    return [*rows, count]


def part_rows(result: EntryResult) -> list[Row]:
    """Return the rows of an entry broken down; bands without samples are left out."""
    names = _names(result)
    rows = [_row(result, n, samples_of(result, n)) for n in names if split_name(n)[1]]
    metrics = [name for name in result.board.by_condition if not _is_silent(result, name)]
    for by, values in conditions_of(result).items():
        for band in dict.fromkeys(values):
            in_band = [s for s, v in zip(result.sound, values, strict=True) if v == band]
            part = replace(result, sound=tuple(in_band))
            rows += [
                _row(result, part_name(metric, by, band), samples)
                for metric in metrics
                if (samples := samples_of(part, metric))
            ]
    return [row for row in rows if row.samples]


def conditions_of(result: EntryResult) -> dict[str, list[str]]:
    """Return the value of each condition in each sound episode, by its name."""
    board = result.board
    values = {by: [each.conditions.get(by, "") for each in result.sound] for by in board.conditions}
    if board.inputs_name:
        values[board.inputs_name] = [each.inputs for each in result.sound]
    return values


Samples = Sequence[tuple[Block, Score]]


def blocks(samples: Samples) -> dict[Block, Score]:
    """Pool the scores of each block: seeds are the sample, not weathers or detectors."""
    groups: dict[Block, list[Score]] = {}
    for block, score in samples:
        groups.setdefault(block, []).append(score)
    return {block: merged(scores) for block, scores in groups.items()}


def paired(
    ones: Mapping[Block, Score], others: Mapping[Block, Score], *, level: float = 0.95
) -> Interval:
    """Return by how much one metric exceeds another on the blocks that both have."""
    common = [block for block in ones if block in others]
    return paired_interval(
        [ones[block] for block in common],
        [others[block] for block in common],
        [scenario for scenario, _ in common],
        level=level,
    )


def headline_scores(result: EntryResult) -> dict[Block, Score]:
    """Return the metric that an entry is ranked by, for each block."""
    return blocks(samples_of(result, result.board.headline))


def samples_of(result: EntryResult, name: str) -> Samples:
    """Return a metric in each sound episode that has it, in the form that is pooled."""
    having = [each for each in result.sound if name in each.scores]
    pooled = result.board.pooled(name, [each.scores for each in having])
    return [((each.scenario, each.seed), score) for each, score in zip(having, pooled, strict=True)]


def _names(result: EntryResult) -> list[str]:
    return list(dict.fromkeys(name for each in result.sound for name in each.scores))


def _is_silent(result: EntryResult, name: str) -> bool:
    return result.board.is_silent(name, [each.scores for each in result.sound])


def _row(result: EntryResult, name: str, samples: Samples) -> Row:
    first, joined = samples[0][1], blocks(samples)
    interval = pooled_interval(list(joined.values()), [scenario for scenario, _ in joined])
    interval = interval.clipped(first.least, first.most)
    metric, by, band = split_name(name)
    measured = [score for _, score in samples if math.isfinite(score.value)]
    # A count of a whole board is the sum over its episodes, as papers print it.
    times = len(measured) if metric in result.board.summed and not by else 1
    ends = (interval.mean, interval.low, interval.high)
    value, low, high = (times * end if math.isfinite(end) else None for end in ends)
    board, count, n = result.board.name, len(measured), sum(score.n for score in measured)
    unit, better = first.unit, first.better
    return Row(board, result.entry, metric, value, low, high, count, unit, better, by, band, n)


def _median_row(result: EntryResult, name: str) -> Row:
    """Return the median over episodes, which is robust against one hard scenario."""
    scores = [score for _, score in samples_of(result, name)]
    values = [score.value for score in scores if math.isfinite(score.value)]
    median = statistics.median(values) if values else None
    board, metric, count = result.board.name, f"{name}_median", len(values)
    unit, better = scores[0].unit, scores[0].better
    return Row(board, result.entry, metric, median, None, None, count, unit, better)
