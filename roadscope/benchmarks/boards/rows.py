"""Figures of entries, pooled from the scores of their jobs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from roadscope.benchmarks.boards.statistics import merged, pooled_interval
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.metrics.breakdown import BANDS, EXCESS, part_name, split_name
from roadscope.benchmarks.metrics.calibration import pooled_calibration
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.recorded.combined import COMBINED, NEES_BAND
from roadscope.benchmarks.recorded.recording import (
    KITTI_BOARDS,
    MOT_BOARDS,
    RECORDED_BOARDS,
    Recording,
)

FIRST_METRIC: Mapping[str, str] = {
    "detection": "f1",
    "tracking": "hota",
    "camera": "ap50",
    "fusion": "ap",
    "odometry": "t_rel",
    **dict.fromkeys(RECORDED_BOARDS, "hota"),
}
"""By which each board is ranked."""

CONDITIONS: Mapping[str, Callable[[Any], str]] = {
    "weather": lambda episode: episode.weather,
    "scenario": lambda episode: episode.scenario,
    "condition": lambda episode: episode.condition,
}
"""What whole episodes of simulated traffic are broken down by; the condition is weather, light
and faults together."""
DETECTOR, INPUTS = "detector", "inputs"
"""Whose detections a tracker was given, and a fusion."""
GIVEN = {"tracking": DETECTOR, "fusion": INPUTS}
RECORDED_CONDITIONS: Mapping[str, Callable[[Any], str]] = {
    "sequence": lambda recording: recording.sequence,
}
"""What recordings are broken down by."""
CONDITIONS_OF: Mapping[str, Mapping[str, Callable[[Any], str]]] = {
    "detection": CONDITIONS,
    "tracking": CONDITIONS,
    "camera": CONDITIONS,
    "fusion": CONDITIONS,
    "odometry": CONDITIONS,
    **dict.fromkeys(RECORDED_BOARDS, RECORDED_CONDITIONS),
}

BROKEN_DOWN: Mapping[str, Sequence[str]] = {
    "detection": (
        "f1", "detection_rate", "precision", "false_alarms_per_frame", "ap", "position_rmse_m",
        "heading_rmse_deg", "size_rmse_m", "objects_per_frame", "unseen_per_frame",
    ),
    "tracking": ("hota", "mota", "idf1"),
    "camera": ("ap50", "detection_rate", "false_alarms", "objects_per_image"),
    "fusion": ("ap", "f1", "detection_rate", "false_alarms", "distance_right", "family_right"),
    "odometry": (
        "failed", "t_rel", "below_1", "r_rel", "end", "false_motion", "dynamic_precision",
        "dynamic_recall", "degraded",
    ),
    **dict.fromkeys(
        KITTI_BOARDS,
        ("hota", "mota", "idf1", "hota_3d", "false_alarms", "nees_position", *NEES_BAND),
    ),
    **dict.fromkeys(MOT_BOARDS, ("hota", "mota", "idf1", "false_alarms")),
}  # fmt: skip
"""Metrics of whole episodes that are broken down by their conditions."""


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of one entry.

    value: pooled over episodes; low and high: its 95 % interval over seeds; all three None
        where there is none.
    n: number of episodes behind it.
    by, band: what it is broken down by (`range`) and which part it is of (`0-20`); empty where
        it is of the whole.
    samples: number of objects, detections, frames or the like behind it.
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
class Record:
    """What became of all jobs of an entry.

    mark: which mark it is, or None when it is ranked.
    sound: the episodes that it came through, with its scores.
    episodes: number of all.
    detectors: whose detections it was given in each of the sound ones; empty where it makes its
        own or they are recorded.
    reason: why it came through none, or None if it came through any.
    """

    board: str
    entry: str
    mark: str | None
    sound: tuple[tuple[Episode | Recording, Mapping[str, Score]], ...]
    episodes: int
    detectors: tuple[str, ...] = ()
    reason: str | None = None

    @property
    def failed(self) -> int:
        """Number of episodes that it did not come through."""
        return self.episodes - len(self.sound)


def whole_rows(record: Record) -> list[Row]:
    """Return an entry's figures over all episodes, and how often it failed."""
    names = [name for name in _names(record) if _whole(name) and not _silent(record, name)]
    rows = [_row(record, name, _samples(record, name)) for name in names]
    failed = Row(
        record.board, record.entry, "failed_episodes", record.failed, None, None, record.episodes,
        "1", "lower",
    )  # fmt: skip
    return [*rows, failed]


def part_rows(record: Record) -> list[Row]:
    """Return an entry's figures broken down; bands in which nobody is to be found are left out."""
    names = _names(record)
    rows = [_row(record, name, _samples(record, name)) for name in names if not _whole(name)]
    for by, held in conditions_of(record).items():
        for band in dict.fromkeys(held):
            sound = [s for s, there in zip(record.sound, held, strict=True) if there == band]
            part = replace(record, sound=tuple(sound))
            named = [m for m in BROKEN_DOWN[record.board] if not _silent(record, m)]
            found = [(metric, _samples(part, metric)) for metric in named]
            rows += [
                _row(record, part_name(m, by, band), samples) for m, samples in found if samples
            ]
    return [row for row in rows if row.samples]


def conditions_of(record: Record) -> dict[str, list[str]]:
    """Return by name of a condition what held in each of the sound episodes."""
    known = CONDITIONS_OF[record.board]
    held = {by: [condition(e) for e, _ in record.sound] for by, condition in known.items()}
    if not record.detectors:
        return held
    return {**held, GIVEN[record.board]: list(record.detectors)}


def blocks(samples: Sequence[tuple[Episode | Recording, Score]]) -> dict[tuple[str, int], Score]:
    """Join what comes from the same traffic: seeds are the sample, not weathers or detectors."""
    groups: dict[tuple[str, int], list[Score]] = {}
    for episode, score in samples:
        groups.setdefault((episode.scenario, episode.seed), []).append(score)
    return {block: merged(scores) for block, scores in groups.items()}


def first_scores(record: Record) -> dict[tuple[str, int], Score]:
    """Return by scenario and seed what an entry is ranked by."""
    return blocks(_samples(record, FIRST_METRIC[record.board]))


def _names(record: Record) -> list[str]:
    return list(dict.fromkeys(name for _, scores in record.sound for name in scores))


def _whole(name: str) -> bool:
    return split_name(name)[1] == ""


def _silent(record: Record, name: str) -> bool:
    """Say whether a recall is of an odometry that never holds anything to be dynamic."""
    if name != "dynamic_recall":
        return False
    return not any(scores["dynamic_precision"].n for _, scores in record.sound if name in scores)


def _samples(record: Record, name: str) -> list[tuple[Episode | Recording, Score]]:
    samples = [(episode, scores) for episode, scores in record.sound if name in scores]
    if name == "calibration_error":
        bins = [part_name(EXCESS, "score", band) for band in BANDS["score"].labels]
        pooled = pooled_calibration([[scores[b] for b in bins] for _, scores in samples])
    elif record.board in RECORDED_BOARDS and name in COMBINED and samples:
        pooled = COMBINED[name]([scores for _, scores in samples], name)
    else:
        pooled = [scores[name] for _, scores in samples]
    return [(episode, score) for (episode, _), score in zip(samples, pooled, strict=True)]


def _row(record: Record, name: str, samples: Sequence[tuple[Episode | Recording, Score]]) -> Row:
    first, joined = samples[0][1], blocks(samples)
    interval = pooled_interval(list(joined.values()), [scenario for scenario, _ in joined])
    interval = interval.clipped(first.least, first.most)
    value, low, high = (
        v if math.isfinite(v) else None for v in (interval.mean, interval.low, interval.high)
    )
    metric, by, band = split_name(name)
    measured = [score for _, score in samples if math.isfinite(score.value)]
    return Row(
        record.board, record.entry, metric, value, low, high, len(measured), first.unit,
        first.better, by, band, sum(score.n for score in measured),
    )  # fmt: skip
