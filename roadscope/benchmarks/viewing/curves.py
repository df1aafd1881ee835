"""Scores over time: of the frames up to each of some moments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.benchmarks.boards import BOARDS, Board
from roadscope.benchmarks.boards.odometry import OdometryBoard
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.kinds import DETECTOR, TRACKER
from roadscope.benchmarks.metrics.trajectory_errors import absolute_errors
from roadscope.benchmarks.records import EpisodeDetections, EpisodePoses
from roadscope.core import Tracks

MOMENTS = 50
"""Most moments at which scores are computed: their time grows with it. Chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A metric over time. stamps_s, values: (K,) float64, all finite."""

    board: str
    metric: str
    unit: str
    stamps_s: np.ndarray
    values: np.ndarray


def running_scores(
    rule: Eligibility,
    detections: EpisodeDetections | None,
    tracks: Sequence[Tracks],
    poses: EpisodePoses | None,
) -> list[Curve]:
    """Return the scores of the frames so far; the last values are those of the whole episode.

    tracks: of a tracker that got the detections; may be empty. poses: their curve is the error of
    the position, with first poses aligned.
    """
    curves = [] if detections is None else list(_of_boxes(rule, detections, tracks))
    if poses is not None:
        errors_m = absolute_errors(poses.trajectories, "origin").positions_m
        curves.append(Curve(OdometryBoard.name, "position_error", "m", poses.stamps_s, errors_m))
    return curves


def boards_over_time() -> list[Board]:
    """Return the boards whose metrics are shown over time."""
    return [board for board in BOARDS.values() if board.over_time]


def _of_boxes(
    rule: Eligibility, detections: EpisodeDetections, tracks: Sequence[Tracks]
) -> Iterator[Curve]:
    truths, boxes, parked = detections.truths, detections.detections, detections.parked
    count = min(MOMENTS, len(truths))
    ends = np.unique(np.linspace(1, len(truths), count).round().astype(int))
    of_kind: dict[str, Sequence[Any]] = {DETECTOR.name: boxes, TRACKER.name: tracks}
    samples: dict[tuple[str, str, str], list[tuple[float, float]]] = {}
    for end in ends.tolist():
        truths_so_far = truths[:end]
        for board in boards_over_time():
            so_far = of_kind.get(board.kind.name, ())[:end]
            if not so_far:
                continue
            pairings = rule.pairings(so_far, truths_so_far, parked)
            scores = board.box_scores(so_far, truths_so_far, pairings)
            for metric in board.over_time:
                if np.isfinite(scores[metric].value):
                    sample = truths_so_far[-1].stamp_s, scores[metric].value
                    samples.setdefault((board.name, metric, scores[metric].unit), []).append(sample)
    for (name, metric, unit), pairs in samples.items():
        yield Curve(name, metric, unit, *np.array(pairs).T)
