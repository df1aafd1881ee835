"""Scores of fused targets on one episode, whole and broken down, by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.average_precision import area_under
from roadscope.benchmarks.metrics.breakdown import BANDS, part_name
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.fusion import FALSE, IGNORED, Judged, Targets, judge
from roadscope.benchmarks.metrics.image_parts import scores_by_score
from roadscope.benchmarks.metrics.score import Score, mean, ratio
from roadscope.core.fused import FusedDetections
from roadscope.fusion.evidence import FAMILIES, families_of

TOLD = 0.5
"""Score from which on a target counts for rates and false alarms."""
CROWD_M = 1.5
"""People are in a crowd whose next one stands this near."""
HIDDEN = 1 / 3
PEDESTRIAN = 2


def fusion_scores(found: Sequence[FusedDetections], targets: Sequence[Targets]) -> dict[str, Score]:
    """Return all scores of some scans of an episode; parts are named by `part_name`.

    detection_rate, precision, f1, false_alarms (a scan): of targets with a score of at least 0.5.
    ap: over all scores, whatever the family. distance_right: share of those found whose distance
    is within 10 % or 1 m, hidden_distance_right of those more than a third hidden.
    family_right: whose family is. calibration_error: of all scores.
    """
    judged = judge(found, targets)
    said = np.concatenate([np.empty(0, np.int64), *(families_of(f.categories) for f in found)])
    told = judged.scores >= TOLD
    hit, false = told & (judged.target >= 0), told & (judged.target == FALSE)
    objects, scans = len(judged.families), judged.moments
    hits, alarms = int(hit.sum()), int(false.sum())
    covered = judged.hidden[judged.target[hit]] > HIDDEN
    right = judged.right_distance[hit]
    counted = judged.target != IGNORED
    values, true = judged.scores[counted], judged.target[counted] >= 0
    ap = area_under(true, values, objects) if objects else np.nan
    scores = {
        "ap": Score(ap, "1", "higher", objects, 0.0, 1.0, weight=objects),
        "f1": ratio(hits, hits + (objects - hits + alarms) / 2),
        "detection_rate": ratio(hits, objects),
        "precision": ratio(hits, hits + alarms),
        "false_alarms": mean(alarms, scans, "1/scan"),
        "distance_right": ratio(int(right.sum()), hits),
        "hidden_distance_right": ratio(int(right[covered].sum()), int(covered.sum())),
        "family_right": ratio(int(judged.right_family[hit].sum()), hits),
        "calibration_error": calibration_error(excess(values, true)),
        "objects_per_scan": mean(objects, scans, "1/scan", "higher"),
    }
    numbers = np.isin(np.arange(objects), judged.target[hit])
    return (
        scores
        | _by_family(judged, numbers, said[false])
        | _by_range(targets, numbers)
        | _by_crowd(judged, targets, numbers)
        | scores_by_score(values, true)
    )


def _by_family(judged: Judged, found: np.ndarray, false: np.ndarray) -> dict[str, Score]:
    """Return rates by true family, false alarms by the family that they are said to be."""
    scores = {}
    for number, family in enumerate(FAMILIES):
        mine = judged.families == number
        rate = ratio(int(found[mine].sum()), int(mine.sum()))
        alarms = mean(int((false == number).sum()), judged.moments, "1/scan")
        scores[part_name("detection_rate", "family", family.value)] = rate
        scores[part_name("false_alarms", "family", family.value)] = alarms
    return scores


def _by_range(targets: Sequence[Targets], found: np.ndarray) -> dict[str, Score]:
    away = np.concatenate([np.empty(0), *(t.distances_m[t.eligible] for t in targets)])
    bands, scores = BANDS["range"].of(away), {}
    for number, band in enumerate(BANDS["range"].labels):
        inside = found[bands == number]
        scores[part_name("detection_rate", "range", band)] = ratio(int(inside.sum()), len(inside))
    return scores


def _by_crowd(judged: Judged, targets: Sequence[Targets], found: np.ndarray) -> dict[str, Score]:
    """Return rates of pedestrians in crowds and of others."""
    crowded = np.concatenate([np.empty(0, bool), *(in_crowd(t)[t.eligible] for t in targets)])
    people, scores = judged.families == PEDESTRIAN, {}
    for band, there in (("in a crowd", crowded), ("by themselves", ~crowded)):
        inside = found[people & there]
        scores[part_name("detection_rate", "crowd", band)] = ratio(int(inside.sum()), len(inside))
    return scores


def in_crowd(targets: Targets) -> np.ndarray:
    """(N,) bool, who is a pedestrian with another one near."""
    people = targets.families == PEDESTRIAN
    apart = np.linalg.norm(targets.centres[:, None, :2] - targets.centres[None, :, :2], axis=-1)
    apart[:, ~people] = np.inf
    np.fill_diagonal(apart, np.inf)
    near: np.ndarray = people & (apart.min(axis=1, initial=np.inf) < CROWD_M)
    return near
