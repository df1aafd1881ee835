"""How well detections cover the objects that could be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.average_precision import average_precision
from roadscope.benchmarks.metrics.matching import Match, Pairing, match_all
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms
from roadscope.core import Detections, Truth, wrap_angle

GATE_M = 2.0
AP_GATES_M = (0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class DetectionScores(ScoreFamily):
    """Scores of a detector on one episode.

    detection_rate: matched eligible objects over eligible objects (recall).
    precision: matched over matched and false alarms.
    f1: harmonic mean of both.
    false_alarms_per_frame: detections that belong to no object, within the range band.
    ap_05 to ap_40: average precision at centre distances of 0.5, 1, 2 and 4 m; ap their mean.
    position_rmse_m: bird's-eye centre error of matched pairs.
    heading_rmse_deg: error of the length axis, 0 to 90: front and rear are not told apart.
    size_rmse_m: error of length and width together.
    objects_per_frame: eligible objects, the same for every entry.
    """

    detection_rate: Score
    precision: Score
    f1: Score
    false_alarms_per_frame: Score
    ap: Score
    ap_05: Score
    ap_10: Score
    ap_20: Score
    ap_40: Score
    position_rmse_m: Score
    heading_rmse_deg: Score
    size_rmse_m: Score
    objects_per_frame: Score


def score_detections(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    *,
    gate_m: float = GATE_M,
) -> DetectionScores:
    """Score an episode, frame by frame; detections in the world frame, like truth.

    Matching is one to one and optimal (most pairs within the gate, then least distance); only
    average precision matches greedily by score, as is usual for it.
    """
    matches = match_all(pairings, gate_m)
    hits = sum(len(m.detected) for m in matches)
    false_alarms = sum(len(m.false_alarms) for m in matches)
    misses = sum(len(m.misses) for m in matches)
    aps = [average_precision(pairings, [d.scores for d in detections], g) for g in AP_GATES_M]
    position, heading, size = _errors(detections, truths, matches)
    objects = hits + misses
    return DetectionScores(
        detection_rate=ratio(hits, objects),
        precision=ratio(hits, hits + false_alarms),
        f1=ratio(hits, hits + (misses + false_alarms) / 2),
        false_alarms_per_frame=mean(false_alarms, len(matches), "1/frame"),
        ap=ratio(sum(a.value for a in aps) / len(aps) * objects, objects),
        ap_05=aps[0],
        ap_10=aps[1],
        ap_20=aps[2],
        ap_40=aps[3],
        position_rmse_m=rms(float((position**2).sum()), hits, "m"),
        heading_rmse_deg=rms(float((heading**2).sum()), hits, "deg"),
        size_rmse_m=rms(float((size**2).sum()), 2 * hits, "m"),
        objects_per_frame=mean(objects, len(matches), "1/frame", "higher"),
    )


def axis_error_deg(yaws: np.ndarray, truth_yaws: np.ndarray) -> np.ndarray:
    """Return the angle between length axes in degrees, -90 to 90, front and rear alike."""
    error: np.ndarray = np.degrees(wrap_angle(2 * (yaws - truth_yaws)) / 2)
    return error


def _errors(
    detections: Sequence[Detections], truths: Sequence[Truth], matches: Sequence[Match]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position (K,) m, heading (K,) deg and size (K, 2) m errors of all matched pairs."""
    position, heading, size = [np.empty(0)], [np.empty(0)], [np.empty((0, 2))]
    for d, t, m in zip(detections, truths, matches, strict=True):
        apart = d.centres[m.detected, :2] - t.centres[m.truth, :2]
        position.append(np.hypot(apart[:, 0], apart[:, 1]))
        heading.append(axis_error_deg(d.yaws[m.detected], t.yaws[m.truth]))
        size.append(d.sizes[m.detected, :2] - t.sizes[m.truth, :2])
    return np.concatenate(position), np.concatenate(heading), np.concatenate(size)
