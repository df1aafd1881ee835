"""Scores of a sensor fusion on an episode: detection, false alarms, distances and families."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.breakdown import BANDS, part_name, precision_by_score
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.ranked_precision import (
    FALSE_ALARM,
    IGNORED,
    area_under,
    match_greedily,
)
from roadscope.benchmarks.metrics.score import Score, averaged, mean, ratio
from roadscope.core.category import families_of
from roadscope.core.checks import settle_arrays
from roadscope.core.fused import FusedDetections
from roadscope.core.record import Record
from roadscope.fusion.evidence import FAMILIES
from roadscope.fusion.overlap import ious

LEAST_IOU = 0.5
GATE_M = 2.0
DISTANCE_SHARE, DISTANCE_M = 0.1, 1.0
"""A distance is right within 10 % or 1 m, whichever is more."""
FARTHEST_M = 60.0
"""Farther fused detections do not count."""
SCORE_THRESHOLD = 0.5
"""Fused detections with at least this score count for rates and false alarms."""
HIDDEN = 1 / 3
"""A target is hidden if more than this share of it is."""
CROWD_M = 1.5
"""A pedestrian is in a crowd if another one is this near."""
PEDESTRIAN = 2
"""Column of pedestrians in `FAMILIES`."""


@dataclass(frozen=True, slots=True, eq=False)
class FusionTargets(Record):
    """The N objects that a fusion can detect at the time of one scan, ego frame of the scan.

    families: (N,) int64, columns of `FAMILIES`. centres: (N, 3) metres.
    image_boxes: (N, 4) pixels, without area where not in the image.
    eligible: (N,) bool; a detection that is matched with a target that is not eligible does not
        count.
    hidden: (N,) share of the outline in the image that something else covers.
    """

    families: np.ndarray
    centres: np.ndarray
    image_boxes: np.ndarray
    eligible: np.ndarray
    hidden: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            families=(np.int64, ("N",)),
            centres=(np.float64, ("N", 3)),
            image_boxes=(np.float64, ("N", 4)),
            eligible=(np.bool_, ("N",)),
            hidden=(np.float64, ("N",)),
        )

    def __len__(self) -> int:
        return len(self.families)

    @property
    def distances_m(self) -> np.ndarray:
        """(N,) from the ego over ground."""
        return np.asarray(np.hypot(self.centres[:, 0], self.centres[:, 1]))


# --------------------------------------------------------------------------------------------------
# Matching.


@dataclass(frozen=True, slots=True, eq=False)
class MatchedTargets(Record):
    """The K fused detections of all scans, what each is matched with, and the E eligible targets.

    scores: (K,). targets: (K,) int64, the number of the matched eligible target, counted over all
        scans, or `FALSE_ALARM` or `IGNORED`.
    distance_right, family_right: (K,) bool, of those that are matched with an eligible target.
    families: (E,) of the targets. hidden: (E,). scans: number of scans.
    """

    scores: np.ndarray
    targets: np.ndarray
    distance_right: np.ndarray
    family_right: np.ndarray
    families: np.ndarray
    hidden: np.ndarray
    scans: int


def match_targets(
    fused: Sequence[FusedDetections], targets: Sequence[FusionTargets]
) -> MatchedTargets:
    """Match from the highest score down, one to one, eligible targets first.

    What the camera detected is matched in the image, by an IoU of 0.5; the rest in space, within
    2 m, seen from above. A detection that has no box in the image or is farther than `FARTHEST_M`
    is not counted.
    """
    empty, no = np.empty(0), np.empty(0, bool)
    numbers, distance_right, family_right, start = [np.empty(0, int)], [no], [no], 0
    for detections, truth in zip(fused, targets, strict=True):
        columns = _matched_columns(detections, truth)
        rows = np.flatnonzero(columns >= 0)
        matched = columns[rows]
        columns[rows] = (np.cumsum(truth.eligible) - 1 + start)[matched]
        numbers.append(columns)
        distance_right.append(np.zeros(len(columns), bool))
        distance_right[-1][rows] = _distances_right(detections, truth, rows, matched)
        family_right.append(np.zeros(len(columns), bool))
        families = families_of(detections.categories[rows])
        family_right[-1][rows] = families == truth.families[matched]
        start += int(truth.eligible.sum())
    return MatchedTargets(
        scores=np.concatenate([empty, *(f.scores for f in fused)]),
        targets=np.concatenate(numbers),
        distance_right=np.concatenate(distance_right),
        family_right=np.concatenate(family_right),
        families=np.concatenate([np.empty(0, int), *(t.families[t.eligible] for t in targets)]),
        hidden=np.concatenate([empty, *(t.hidden[t.eligible] for t in targets)]),
        scans=len(targets),
    )


def _distances_right(
    fused: FusedDetections, truth: FusionTargets, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Return (R,) bool, whether the distances of pairs are known and within 10 % or 1 m."""
    distances_m, true_m = fused.distances_m[rows], truth.distances_m[columns]
    allowed_m = np.maximum(DISTANCE_SHARE * true_m, DISTANCE_M)
    right: np.ndarray = (distances_m >= 0) & (np.abs(distances_m - true_m) <= allowed_m)
    return right


def _matched_columns(fused: FusedDetections, truth: FusionTargets) -> np.ndarray:
    """Return (K,) int64, the eligible target of each detection, or `FALSE_ALARM` or `IGNORED`."""
    similarity = _similarity(fused, truth)
    in_image = fused.by_camera | fused.has_image_box
    # A second detection of an ineligible target, a parked car say, is no false alarm either.
    on_ineligible = (similarity[:, ~truth.eligible] > 0).any(axis=1)
    return match_greedily(
        np.where(similarity > 0, -similarity, np.inf),
        np.argsort(-fused.scores, kind="stable"),
        eligible=truth.eligible,
        counted=in_image & (fused.distances_m <= FARTHEST_M) & ~on_ineligible,
    )


def _similarity(fused: FusedDetections, truth: FusionTargets) -> np.ndarray:
    """Return (K, N), above 0 where a match is possible, more for a nearer target."""
    overlap = ious(fused.image_boxes, truth.image_boxes)
    offsets = fused.centres[:, None, :2] - truth.centres[None, :, :2]
    distance = np.linalg.norm(offsets, axis=-1)
    in_image = np.where(overlap >= LEAST_IOU, overlap, 0.0)
    in_space = np.where(distance <= GATE_M, 1.0 - distance / (2 * GATE_M), 0.0)
    similarity: np.ndarray = np.where(fused.by_camera[:, None], in_image, in_space)
    return similarity


# --------------------------------------------------------------------------------------------------
# Rates at a threshold of the score, as Li 2021 reports them.


@dataclass(frozen=True, slots=True)
class FusionRates:
    """Rates of detections above one score; shares are 0 to 1, nan without a target.

    detection_rate: share of eligible targets that are detected, of all, and by family.
    false_alarms_per_scan: number per scan.
    distance_right: share of detected targets whose distance is right (within 10 % or 1 m).
    hidden_distance_right: the same of targets that are more than a third hidden.
    family_right: share of detected targets whose family is right.
    target_counts: number of eligible targets by family.
    """

    detection_rate: float
    family_detection_rates: tuple[float, ...]
    false_alarms_per_scan: float
    distance_right: float
    hidden_distance_right: float
    family_right: float
    target_counts: tuple[int, ...]


class FusionBandRates(NamedTuple):
    """Detection rates by family, 0 to 1 and nan without a target, and numbers of targets."""

    detection_rates: tuple[float, ...]
    target_counts: tuple[int, ...]


def fusion_rates(matched: MatchedTargets, least_score: float = 0.0) -> FusionRates:
    """Return the rates of detections that have at least this score."""
    above = matched.scores >= least_score
    hit = above & (matched.targets >= 0)
    numbers = matched.targets[hit]
    totals = [int((matched.families == k).sum()) for k in range(len(FAMILIES))]
    counts = [int((matched.families[numbers] == k).sum()) for k in range(len(FAMILIES))]
    alarms = int((above & (matched.targets == FALSE_ALARM)).sum())
    right, hidden = matched.distance_right[hit], matched.hidden[numbers] > HIDDEN
    return FusionRates(
        detection_rate=_share(sum(counts), sum(totals)),
        family_detection_rates=tuple(_share(a, b) for a, b in zip(counts, totals, strict=True)),
        false_alarms_per_scan=_share(alarms, matched.scans),
        distance_right=_share(int(right.sum()), len(numbers)),
        hidden_distance_right=_share(int(right[hidden].sum()), int(hidden.sum())),
        family_right=_share(int(matched.family_right[hit].sum()), len(numbers)),
        target_counts=tuple(totals),
    )


HIDDEN_BANDS = {"not hidden": (0.0, 0.05), "up to a third": (0.05, HIDDEN), "more": (HIDDEN, 1.0)}
"""Shares of a target's outline in the image that something else covers, from and up to; in the
first band are a lamp post's width of a car, and rounding."""


def rates_by_hidden(matched: MatchedTargets) -> dict[str, FusionBandRates]:
    """Return by band of `HIDDEN_BANDS` the detection rates by family of targets in it."""
    detected = np.isin(np.arange(len(matched.families)), matched.targets)
    bands = {}
    for name, (least, most) in HIDDEN_BANDS.items():
        inside = (matched.hidden <= most) & ((matched.hidden > least) | (least == 0.0))
        of_family = [inside & (matched.families == k) for k in range(len(FAMILIES))]
        bands[name] = FusionBandRates(
            tuple(
                _share(int((detected & chosen).sum()), int(chosen.sum())) for chosen in of_family
            ),
            tuple(int(chosen.sum()) for chosen in of_family),
        )
    return bands


def threshold_at(matched: MatchedTargets, false_alarms_per_scan: float) -> float:
    """Return the least score from which on there are no more false alarms than this."""
    false = np.sort(matched.scores[matched.targets == FALSE_ALARM])[::-1]
    allowed = int(np.floor(false_alarms_per_scan * matched.scans + 1e-9))
    return float(np.nextafter(false[allowed], 2.0)) if allowed < len(false) else 0.0


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


# --------------------------------------------------------------------------------------------------
# Scores of an episode by their names on the board.


def fusion_scores(
    fused: Sequence[FusedDetections], targets: Sequence[FusionTargets]
) -> dict[str, Score]:
    """Return all scores of an episode's scans; those of bands are named by `part_name`.

    With TP matched targets, FP false alarms, FN misses, from a score of 0.5; nan where there is
    nothing to divide by:

    ap: average precision (`area_under`) over all scores, whatever the family, 0 to 1.
    detection_rate: TP / (TP + FN). precision: TP / (TP + FP). f1: TP / (TP + (FN + FP) / 2).
    false_alarms: FP per scan.
    distance_right: share of matched targets whose distance is right, within 10 % or 1 m;
        hidden_distance_right: of those that are more than a third hidden.
    family_right: share of matched targets whose family is right.
    calibration_error: expected calibration error of all scores.
    objects_per_scan: eligible targets, the same for every fusion.
    """
    matched = match_targets(fused, targets)
    above = matched.scores >= SCORE_THRESHOLD
    hit, false = above & (matched.targets >= 0), above & (matched.targets == FALSE_ALARM)
    objects, scans = len(matched.families), matched.scans
    hits, alarms = int(hit.sum()), int(false.sum())
    hidden = matched.hidden[matched.targets[hit]] > HIDDEN
    right = matched.distance_right[hit]
    counted = matched.targets != IGNORED
    scores, is_right = matched.scores[counted], matched.targets[counted] >= 0
    ap = area_under(is_right, scores, objects) if objects else np.nan
    whole = {
        "ap": averaged(ap, objects),
        "f1": ratio(hits, hits + (objects - hits + alarms) / 2),
        "detection_rate": ratio(hits, objects),
        "precision": ratio(hits, hits + alarms),
        "false_alarms": mean(alarms, scans, "1/scan"),
        "distance_right": ratio(int(right.sum()), hits),
        "hidden_distance_right": ratio(int(right[hidden].sum()), int(hidden.sum())),
        "family_right": ratio(int(matched.family_right[hit].sum()), hits),
        "calibration_error": calibration_error(excess(scores, is_right)),
        "objects_per_scan": mean(objects, scans, "1/scan", "higher"),
    }
    detected = np.isin(np.arange(objects), matched.targets[hit])
    families = [families_of(f.categories) for f in fused]
    false_families = np.concatenate([np.empty(0, np.int64), *families])[false]
    return (
        whole
        | _by_family(matched, detected, false_families)
        | _by_range(targets, detected)
        | _by_crowd(matched, targets, detected)
        | precision_by_score(scores, is_right)
    )


def _by_family(
    matched: MatchedTargets, detected: np.ndarray, false_families: np.ndarray
) -> dict[str, Score]:
    """Return rates by the target's family, false alarms by the family that they claim."""
    scores = {}
    for number, family in enumerate(FAMILIES):
        inside = detected[matched.families == number]
        alarms = mean(int((false_families == number).sum()), matched.scans, "1/scan")
        scores[part_name("detection_rate", "family", family.value)] = _rate(inside)
        scores[part_name("false_alarms", "family", family.value)] = alarms
    return scores


def _by_range(targets: Sequence[FusionTargets], detected: np.ndarray) -> dict[str, Score]:
    ranges = np.concatenate([np.empty(0), *(t.distances_m[t.eligible] for t in targets)])
    bands, scores = BANDS["range"].of(ranges), {}
    for number, band in enumerate(BANDS["range"].labels):
        inside = detected[bands == number]
        scores[part_name("detection_rate", "range", band)] = _rate(inside)
    return scores


def _by_crowd(
    matched: MatchedTargets, targets: Sequence[FusionTargets], detected: np.ndarray
) -> dict[str, Score]:
    """Return rates of pedestrians in crowds and of the other pedestrians."""
    crowded = np.concatenate([np.empty(0, bool), *(in_crowd(t)[t.eligible] for t in targets)])
    pedestrians, scores = matched.families == PEDESTRIAN, {}
    for band, chosen in (("in a crowd", crowded), ("by themselves", ~crowded)):
        inside = detected[pedestrians & chosen]
        scores[part_name("detection_rate", "crowd", band)] = _rate(inside)
    return scores


def _rate(detected: np.ndarray) -> Score:
    return ratio(int(detected.sum()), len(detected))


def in_crowd(targets: FusionTargets) -> np.ndarray:
    """Return (N,) bool, the pedestrians that have another one within `CROWD_M`."""
    pedestrians = targets.families == PEDESTRIAN
    offsets = targets.centres[:, None, :2] - targets.centres[None, :, :2]
    distances = np.linalg.norm(offsets, axis=-1)
    distances[:, ~pedestrians] = np.inf
    np.fill_diagonal(distances, np.inf)
    crowded: np.ndarray = pedestrians & (distances.min(axis=1, initial=np.inf) < CROWD_M)
    return crowded
