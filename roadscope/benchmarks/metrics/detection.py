"""How well detections cover the objects that could be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.average_precision import average_precision, overlap_precision
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.errors import BoxErrors, box_errors
from roadscope.benchmarks.metrics.matching import Match, Pairing, match_all
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms
from roadscope.core import Detections, Truth

GATE_M = 2.0
AP_GATES_M = (0.5, 1.0, 2.0, 4.0)
AP_OVERLAPS = (0.5, 0.7)


@dataclass(frozen=True, slots=True)
class DetectionScores(ScoreFamily):
    """Scores of a detector on one episode.

    detection_rate: matched eligible objects over eligible objects (recall).
    precision: matched over matched and false alarms.
    f1: harmonic mean of both.
    false_alarms_per_frame: detections that belong to no object, within the range band.
    ap_05 to ap_40: average precision at centre distances of 0.5, 1, 2 and 4 m; ap their mean.
    ap_iou_50, ap_iou_70: average precision at intersections over union of 0.5 and 0.7, of boxes
        seen from above.
    position_rmse_m: bird's-eye centre error of matched pairs.
    longitudinal_rmse_m, lateral_rmse_m: its parts along the true length and width.
    heading_rmse_deg: error of the length axis, 0 to 90: front and rear are not told apart.
    heading_flips: share of matches with that error above 45 degrees, length taken for width.
    size_rmse_m: error of length and width together.
    category_accuracy: share of matches with the right category.
    calibration_error: expected calibration error of the scores, ten bins.
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
    ap_iou_50: Score
    ap_iou_70: Score
    position_rmse_m: Score
    longitudinal_rmse_m: Score
    lateral_rmse_m: Score
    heading_rmse_deg: Score
    heading_flips: Score
    size_rmse_m: Score
    category_accuracy: Score
    calibration_error: Score
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
    objects = hits + misses
    counts = {
        "detection_rate": ratio(hits, objects),
        "precision": ratio(hits, hits + false_alarms),
        "f1": ratio(hits, hits + (misses + false_alarms) / 2),
        "false_alarms_per_frame": mean(false_alarms, len(matches), "1/frame"),
        "objects_per_frame": mean(objects, len(matches), "1/frame", "higher"),
    }
    ranked = _ranked(detections, truths, pairings, gate_m)
    errors = _errors(box_errors(detections, truths, matches))
    return DetectionScores(
        **counts,
        **ranked,
        **errors,
        calibration_error=calibration_error(excess(*judged(detections, matches))),
    )


def judged(
    detections: Sequence[Detections], matches: Sequence[Match]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the scores of all that is right or a false alarm, and (K,) bool which is right."""
    scores = [d.scores[m.detected] for d, m in zip(detections, matches, strict=True)]
    wrong = [d.scores[m.false_alarms] for d, m in zip(detections, matches, strict=True)]
    right = np.repeat([True, False], [sum(map(len, scores)), sum(map(len, wrong))])
    return np.concatenate([np.empty(0), *scores, *wrong]), right


def _ranked(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    gate_m: float,
) -> dict[str, Score]:
    """Return all average precisions."""
    from roadscope.benchmarks.metrics.overlap import overlaps

    scores = [d.scores for d in detections]
    shares = [overlaps(d, t) for d, t in zip(detections, truths, strict=True)]
    by_distance = [average_precision(pairings, scores, gate) for gate in AP_GATES_M]
    total = by_distance[0].n
    return {
        "ap": ratio(sum(a.value for a in by_distance) / len(by_distance) * total, total),
        **{f"ap_{10 * g:02.0f}": a for g, a in zip(AP_GATES_M, by_distance, strict=True)},
        **{
            f"ap_iou_{100 * least:.0f}": overlap_precision(pairings, shares, scores, least, gate_m)
            for least in AP_OVERLAPS
        },
    }


def _errors(errors: BoxErrors) -> dict[str, Score]:
    along, across = (float((e**2).sum()) for e in (errors.along, errors.across))
    hits = len(errors.along)
    return {
        "position_rmse_m": rms(along + across, hits, "m"),
        "longitudinal_rmse_m": rms(along, hits, "m"),
        "lateral_rmse_m": rms(across, hits, "m"),
        "heading_rmse_deg": rms(float((errors.heading_deg**2).sum()), hits, "deg"),
        "heading_flips": ratio(int((np.abs(errors.heading_deg) > 45).sum()), hits, "lower"),
        "size_rmse_m": rms(float((errors.size**2).sum()), 2 * hits, "m"),
        "category_accuracy": ratio(int(errors.right_category.sum()), hits),
    }
