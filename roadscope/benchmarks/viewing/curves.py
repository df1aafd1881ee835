"""Scores over time: of the frames up to each of some moments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.metrics.detection import score_detections
from roadscope.benchmarks.metrics.tracking import score_tracks
from roadscope.benchmarks.metrics.trajectory_errors import absolute_errors
from roadscope.benchmarks.records import EpisodeDetections, EpisodePoses
from roadscope.core import Tracks

MOMENTS = 50
"""Most moments at which scores are computed: their time grows with it. Chosen by hand."""
METRICS = {
    "detection": ("detection_rate", "precision"),
    "tracking": ("hota", "mota", "idf1", "id_switches"),
}
"""The metrics of each board that are shown over time."""


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
        curves.append(Curve("odometry", "position_error", "m", poses.stamps_s, errors_m))
    return curves


def _of_boxes(
    rule: Eligibility, detections: EpisodeDetections, tracks: Sequence[Tracks]
) -> Iterator[Curve]:
    truths, boxes, parked = detections.truths, detections.detections, detections.parked
    count = min(MOMENTS, len(truths))
    ends = np.unique(np.linspace(1, len(truths), count).round().astype(int))
    samples: dict[tuple[str, str, str], list[tuple[float, float]]] = {}
    for end in ends.tolist():
        truths_so_far = truths[:end]
        pairings = rule.pairings(boxes[:end], truths_so_far, parked)
        scores = {"detection": score_detections(boxes[:end], truths_so_far, pairings).named()}
        if tracks:
            pairings = rule.pairings(tracks[:end], truths_so_far, parked)
            scores["tracking"] = score_tracks(tracks[:end], truths_so_far, pairings).named()
        for board, named in scores.items():
            for metric in METRICS[board]:
                if np.isfinite(named[metric].value):
                    sample = truths_so_far[-1].stamp_s, named[metric].value
                    samples.setdefault((board, metric, named[metric].unit), []).append(sample)
    for (board, metric, unit), pairs in samples.items():
        yield Curve(board, metric, unit, *np.array(pairs).T)
