"""Scores of a LiDAR detector on an episode, of all objects and by bands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.breakdown import BANDS, part_name, precision_by_score
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.matching import Match, Pairing, centre_distances, match_all
from roadscope.benchmarks.metrics.ranked_precision import (
    RankedDetections,
    average_precision,
    overlap_precision,
    precision_by_group,
    rank_by_distance,
)
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms
from roadscope.core import Detections, Truth, wrap_angle

GATE_M = 2.0
"""A detection is right up to this distance of centres, seen from above."""
AP_GATES_M = (0.5, 1.0, 2.0, 4.0)
"""Those of nuScenes (Caesar et al. 2020)."""
AP_IOUS = (0.5, 0.7)
"""Thresholds of KITTI (Geiger et al. 2012): 0.7 for cars, 0.5 for others."""


@dataclass(frozen=True, slots=True)
class DetectionScores(ScoreFamily):
    """Scores of a detector on one episode; nan where there is nothing to divide by.

    With TP matched pairs, FP false alarms, FN misses, of eligible objects, up to `GATE_M`:

    detection_rate: TP / (TP + FN), recall, 0 to 1.
    precision: TP / (TP + FP), 0 to 1.
    f1: TP / (TP + (FN + FP) / 2), harmonic mean of both, 0 to 1.
    false_alarms_per_frame: FP per frame, within the range band.
    ap_05 to ap_40: average precision (`average_precision`) at centre distances of 0.5, 1, 2 and
        4 m, 0 to 1; ap: their mean (Caesar et al. 2020, nuScenes).
    ap_iou_50, ap_iou_70: average precision at an IoU of 0.5 and 0.7 of boxes seen from above.
    position_rmse_m: root mean square error of matched centres, seen from above, metres.
    longitudinal_rmse_m, lateral_rmse_m: its parts along the object's length and width.
    heading_rmse_deg: of the length axis, 0 to 90 degrees: front and rear are the same.
    heading_flips: share of matches with such an error above 45 degrees: length and width are
        exchanged.
    size_rmse_m: of length and width together.
    category_accuracy: share of matches with the right category.
    calibration_error: expected calibration error of the scores, ten bins.
    objects_per_frame: eligible objects, the same for every detector.
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
    """Return the scores of an episode.

    Matching is one to one and optimal (most pairs within the gate, then least distance); only for
    average precision it is greedy by score, as AP is defined.

    detections, truths: of each frame, in the world frame. pairings: of each frame.
    """
    matches = match_all(pairings, gate_m)
    return DetectionScores(
        **count_scores(matches),
        calibration_error=calibration_error(excess(*scores_and_hits(detections, matches))),
        **_average_precisions(detections, truths, pairings, gate_m=gate_m),
        **_error_scores(box_errors(detections, truths, matches)),
    )


def count_scores(matches: Sequence[Match]) -> dict[str, Score]:
    """Return the scores of an episode that count pairs only."""
    hits = sum(len(m.detected) for m in matches)
    false_alarms = sum(len(m.false_alarms) for m in matches)
    misses = sum(len(m.misses) for m in matches)
    objects = hits + misses
    return {
        "detection_rate": ratio(hits, objects),
        "precision": ratio(hits, hits + false_alarms),
        "f1": ratio(hits, hits + (misses + false_alarms) / 2),
        "false_alarms_per_frame": mean(false_alarms, len(matches), "1/frame"),
        "objects_per_frame": mean(objects, len(matches), "1/frame", "higher"),
    }


def scores_and_hits(
    detections: Sequence[Detections], matches: Sequence[Match]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (K,) scores of all hits and all false alarms, and (K,) bool, which are hits."""
    hits = [d.scores[m.detected] for d, m in zip(detections, matches, strict=True)]
    alarms = [d.scores[m.false_alarms] for d, m in zip(detections, matches, strict=True)]
    right = np.repeat([True, False], [sum(map(len, hits)), sum(map(len, alarms))])
    return np.concatenate([np.empty(0), *hits, *alarms]), right


def _average_precisions(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    *,
    gate_m: float,
) -> dict[str, Score]:
    scores = [d.scores for d in detections]
    overlaps = [box_overlaps_from_above(d, t) for d, t in zip(detections, truths, strict=True)]
    by_gate = [average_precision(pairings, scores, gate_m=gate) for gate in AP_GATES_M]
    total = by_gate[0].n
    return {
        "ap": ratio(sum(a.value for a in by_gate) / len(by_gate) * total, total),
        **{f"ap_{10 * g:02.0f}": a for g, a in zip(AP_GATES_M, by_gate, strict=True)},
        **{
            f"ap_iou_{100 * iou:.0f}": overlap_precision(
                pairings, overlaps, scores, least_iou=iou, gate_m=gate_m
            )
            for iou in AP_IOUS
        },
    }


def box_overlaps_from_above(detections: Detections, truth: Truth) -> np.ndarray:
    """Return (N, M) intersection over union of the boxes of one frame, seen from above, 0 to 1."""
    from roadscope.core.box_overlap import box_overlaps

    rectangles = [
        np.column_stack([boxes.centres[:, :2], boxes.sizes[:, :2], boxes.yaws])
        for boxes in (detections, truth)
    ]
    return box_overlaps(*rectangles)


# --------------------------------------------------------------------------------------------------
# Errors of matched boxes.


@dataclass(frozen=True, slots=True, eq=False)
class BoxErrors:
    """Detection less object for all K matched pairs of an episode.

    longitudinal_m, lateral_m: (K,) of the centre, along the object's length and width.
    heading_deg: (K,) of the length axis, -90 to 90: front and rear are the same.
    size_m: (K, 2) of length and width.
    category_is_right: (K,) bool.
    """

    longitudinal_m: np.ndarray
    lateral_m: np.ndarray
    heading_deg: np.ndarray
    size_m: np.ndarray
    category_is_right: np.ndarray

    @staticmethod
    def joined(frames: Sequence[BoxErrors]) -> BoxErrors:
        """Return the errors of all frames together."""
        return BoxErrors(
            np.concatenate([np.empty(0), *(f.longitudinal_m for f in frames)]),
            np.concatenate([np.empty(0), *(f.lateral_m for f in frames)]),
            np.concatenate([np.empty(0), *(f.heading_deg for f in frames)]),
            np.concatenate([np.empty((0, 2)), *(f.size_m for f in frames)]),
            np.concatenate([np.empty(0, bool), *(f.category_is_right for f in frames)]),
        )


def box_errors(
    detections: Sequence[Detections], truths: Sequence[Truth], matches: Sequence[Match]
) -> BoxErrors:
    """Return the errors of the matched pairs of all frames."""
    frames = zip(detections, truths, matches, strict=True)
    return BoxErrors.joined([_frame_errors(*frame) for frame in frames])


def axis_error_deg(yaws: np.ndarray, truth_yaws: np.ndarray) -> np.ndarray:
    """Return the angles between length axes, -90 to 90 degrees; front and rear are the same."""
    error: np.ndarray = np.degrees(wrap_angle(2 * (yaws - truth_yaws)) / 2)
    return error


def _frame_errors(detections: Detections, truth: Truth, match: Match) -> BoxErrors:
    rows, columns = match.detected, match.truth
    offset = detections.centres[rows, :2] - truth.centres[columns, :2]
    cos, sin = np.cos(truth.yaws[columns]), np.sin(truth.yaws[columns])
    return BoxErrors(
        longitudinal_m=cos * offset[:, 0] + sin * offset[:, 1],
        lateral_m=cos * offset[:, 1] - sin * offset[:, 0],
        heading_deg=axis_error_deg(detections.yaws[rows], truth.yaws[columns]),
        size_m=detections.sizes[rows, :2] - truth.sizes[columns, :2],
        category_is_right=detections.categories[rows] == truth.categories[columns],
    )


def _error_scores(errors: BoxErrors) -> dict[str, Score]:
    longitudinal = float((errors.longitudinal_m**2).sum())
    lateral = float((errors.lateral_m**2).sum())
    pairs = len(errors.longitudinal_m)
    return {
        "position_rmse_m": rms(longitudinal + lateral, pairs, "m"),
        "longitudinal_rmse_m": rms(longitudinal, pairs, "m"),
        "lateral_rmse_m": rms(lateral, pairs, "m"),
        "heading_rmse_deg": rms(float((errors.heading_deg**2).sum()), pairs, "deg"),
        "heading_flips": ratio(int((np.abs(errors.heading_deg) > 45).sum()), pairs, "lower"),
        "size_rmse_m": rms(float((errors.size_m**2).sum()), 2 * pairs, "m"),
        "category_accuracy": ratio(int(errors.category_is_right.sum()), pairs),
    }


# --------------------------------------------------------------------------------------------------
# The same by bands.

OBJECT_QUANTITIES: Mapping[str, Callable[[Truth], np.ndarray]] = {
    "range": lambda truth: _ranges(truth.centres, truth),
    "category": lambda truth: truth.categories,
    "occlusion": lambda truth: 100 * truth.occluded_fraction,
    "points": lambda truth: truth.lidar_returns,
}
"""Quantities of (M,) objects that scores are broken down by, in the units of `BANDS`."""


def score_detections_by_band(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    *,
    gate_m: float = GATE_M,
) -> dict[str, Score]:
    """Return scores of an episode's bands by `part_name`; an empty band has n = 0.

    Detection rate, average precision and errors are of the objects in the band. Precision and
    false alarms are of the detections in the band, by their own range; by category, a detection
    that is matched counts as its object's category. F1 is of objects that are matched, objects
    that are missed and false alarms, each in its own band.

    A false alarm has no occlusion and no returns: there is no precision or F1 by these, and in
    average precision it counts in each band.

    detections, truths: of each frame, in the world frame. pairings: of each frame.
    """
    matches = match_all(pairings, gate_m)
    matched_objects = _matched_objects(pairings, matches)
    lengths = [len(d) for d in detections]
    hits = _numbered(lengths, [m.detected for m in matches])
    alarms = _numbered(lengths, [m.false_alarms for m in matches])
    squares = _squared_errors(box_errors(detections, truths, matches))
    ranked = [
        rank_by_distance(pairings, [d.scores for d in detections], gate_m=gate)
        for gate in AP_GATES_M
    ]
    detection_bands, scores = _detection_bands(detections, truths), {}
    for by, values in _object_values(truths, pairings).items():
        objects, count = BANDS[by].of(values), len(BANDS[by].labels)
        matched, own = objects[matched_objects], detection_bands.get(by)
        columns = {
            "detection_rate": _rates(objects, matched, count),
            "ap": _average_precision_by_group(ranked, objects, own, count),
            **{name: _rms_errors(each, matched, count) for name, each in squares.items()},
        }
        if own is not None:
            # A car that is detected as a van is matched; by its own category, it would be a right
            # van.
            right = own[hits] if by == "range" else matched
            columns["precision"] = _precisions(right, own[alarms], count)
            columns["false_alarms_per_frame"] = _alarms(own[alarms], count, len(matches))
            columns["f1"] = _f1(objects, matched, own[alarms], count)
        for metric, column in columns.items():
            for band, score in zip(BANDS[by].labels, column, strict=True):
                scores[part_name(metric, by, band)] = score
    return scores | precision_by_score(*scores_and_hits(detections, matches))


def _ranges(centres: np.ndarray, truth: Truth) -> np.ndarray:
    """Return (N,) distances of centres from the ego, seen from above, metres."""
    return centre_distances(centres, truth.world_from_ego.translation[None])[:, 0]


def _object_values(truths: Sequence[Truth], pairings: Sequence[Pairing]) -> dict[str, np.ndarray]:
    """Return each quantity of all eligible objects, frame after frame."""
    rows = [np.flatnonzero(p.eligible) for p in pairings]
    return {
        by: np.concatenate([np.empty(0), *(of(t)[r] for t, r in zip(truths, rows, strict=True))])
        for by, of in OBJECT_QUANTITIES.items()
    }


def _detection_bands(
    detections: Sequence[Detections], truths: Sequence[Truth]
) -> dict[str, np.ndarray]:
    """Return the bands of all detections, frame after frame, of the quantities that they have."""
    ranges = [_ranges(d.centres, t) for d, t in zip(detections, truths, strict=True)]
    values = {"range": ranges, "category": [d.categories for d in detections]}
    return {by: BANDS[by].of(np.concatenate([np.empty(0), *v])) for by, v in values.items()}


def _matched_objects(pairings: Sequence[Pairing], matches: Sequence[Match]) -> np.ndarray:
    """Return (K,) int64, the number of each pair's object among all eligible objects."""
    eligible = np.concatenate([np.empty(0, bool), *(p.eligible for p in pairings)])
    columns = _numbered([len(p.eligible) for p in pairings], [m.truth for m in matches])
    numbers: np.ndarray = np.cumsum(eligible)[columns] - 1
    return numbers


def _numbered(lengths: Sequence[int], indices: Sequence[np.ndarray]) -> np.ndarray:
    """Turn indices within each frame into indices over all frames, one after another."""
    starts = np.cumsum([0, *lengths])[:-1]
    shifted = (start + index for start, index in zip(starts, indices, strict=True))
    return np.concatenate([np.empty(0, np.int64), *shifted])


@dataclass(frozen=True, slots=True, eq=False)
class SquaredErrors:
    """Squared errors (K, D) of K pairs, of the unit squared."""

    values: np.ndarray
    unit: str


def _squared_errors(errors: BoxErrors) -> dict[str, SquaredErrors]:
    """Return squared errors of each pair by the name of their root mean square."""
    position = (errors.longitudinal_m**2 + errors.lateral_m**2)[:, None]
    return {
        "position_rmse_m": SquaredErrors(position, "m"),
        "heading_rmse_deg": SquaredErrors((errors.heading_deg**2)[:, None], "deg"),
        "size_rmse_m": SquaredErrors(errors.size_m**2, "m"),
    }


# Each function below returns one score a band. Its arrays hold the band, 0 to count - 1, of each
# object, matched object or detection.


def _counts(bands: np.ndarray, count: int) -> list[int]:
    numbers: list[int] = np.bincount(bands, minlength=count).tolist()
    return numbers


def _rates(objects: np.ndarray, matched: np.ndarray, count: int) -> list[Score]:
    pairs = zip(_counts(matched, count), _counts(objects, count), strict=True)
    return [ratio(hits, total) for hits, total in pairs]


def _precisions(hits: np.ndarray, alarms: np.ndarray, count: int) -> list[Score]:
    pairs = zip(_counts(hits, count), _counts(alarms, count), strict=True)
    return [ratio(right, right + wrong) for right, wrong in pairs]


def _alarms(alarms: np.ndarray, count: int, frames: int) -> list[Score]:
    return [mean(wrong, frames, "1/frame") for wrong in _counts(alarms, count)]


def _f1(objects: np.ndarray, matched: np.ndarray, alarms: np.ndarray, count: int) -> list[Score]:
    each = zip(*(_counts(bands, count) for bands in (objects, matched, alarms)), strict=True)
    return [ratio(hits, hits + (total - hits + wrong) / 2) for total, hits, wrong in each]


def _rms_errors(squares: SquaredErrors, matched: np.ndarray, count: int) -> list[Score]:
    totals = np.bincount(matched, squares.values.sum(axis=1), count).tolist()
    pairs = zip(totals, _counts(matched, count), strict=True)
    return [rms(total, n * squares.values.shape[1], squares.unit) for total, n in pairs]


def _average_precision_by_group(
    ranked: Sequence[RankedDetections],
    objects: np.ndarray,
    detections: np.ndarray | None,
    count: int,
) -> list[Score]:
    """Return the mean over `AP_GATES_M`."""
    by_gate = [precision_by_group(each, objects, detections, count=count) for each in ranked]
    pairs = zip(np.mean(by_gate, axis=0).tolist(), _counts(objects, count), strict=True)
    return [ratio(value * n if n else 0.0, n) for value, n in pairs]
