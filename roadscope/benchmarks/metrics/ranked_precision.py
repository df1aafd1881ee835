"""Average precision: whether scores rank right detections before false ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score, averaged

RECALL_LEVELS = np.linspace(0.0, 1.0, 101)
"""Recalls at which precision is averaged, as COCO and nuScenes do."""
FALSE_ALARM, IGNORED = -1, -2
"""Stand for the object of a detection that is matched with no eligible object."""


@dataclass(frozen=True, slots=True, eq=False)
class RankedDetections:
    """The K detections of an episode that count as right or as false.

    Detections and eligible objects are numbered over the episode, frame after frame.

    scores: (K,) float64.
    objects: (K,) int64, number of the matched eligible object, or `FALSE_ALARM`.
    detections: (K,) int64, number of the detection.
    object_count: number of all eligible objects.
    """

    scores: np.ndarray
    objects: np.ndarray
    detections: np.ndarray
    object_count: int

    @property
    def right(self) -> np.ndarray:
        """(K,) bool, detections that are matched with an eligible object."""
        right: np.ndarray = self.objects >= 0
        return right


def average_precision(
    pairings: Sequence[Pairing], scores: Sequence[np.ndarray], *, gate_m: float
) -> Score:
    """Return average precision with matches by centre distance, 0 to 1, higher is better.

    AP is the mean over 101 recalls r = 0, 0.01, ..., 1 of the interpolated precision, the largest
    precision at a recall of at least r (Caesar et al. 2020, nuScenes, without its cut of recalls
    and precisions below 0.1). nan without an eligible object.

    Matching is greedy: from the highest score down, each detection is matched with the nearest
    free object within the gate. Detections of equal score are one step of the curve, so that their
    order does not matter.

    scores: of each frame (N,), of the detections of its pairing.
    """
    return _score_of(rank_by_distance(pairings, scores, gate_m=gate_m))


def overlap_precision(
    pairings: Sequence[Pairing],
    overlaps: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    *,
    least_iou: float,
    gate_m: float,
) -> Score:
    """Return average precision with matches by intersection over union, 0 to 1, higher is better.

    Precision is averaged as in `average_precision`; each detection is matched with the free object
    that it overlaps most, with at least `least_iou`.

    overlaps: of each frame (N, K), IoU with the first K of the pairing's M objects. The others, of
        which only the centre is known, are not eligible.
    gate_m: a detection this near to an ineligible object is ignored, as in `matching.match`.
    """
    costs = []
    for pairing, overlap in zip(pairings, overlaps, strict=True):
        cost = np.where(pairing.distances <= gate_m, pairing.distances, np.inf)
        eligible = np.flatnonzero(pairing.eligible)
        iou = overlap[:, eligible]
        cost[:, eligible] = np.where(iou >= least_iou, 1 - iou, np.inf)
        costs.append(cost)
    return _score_of(_ranked(pairings, costs, scores))


def precision_by_group(
    ranked: RankedDetections,
    object_groups: np.ndarray,
    detection_groups: np.ndarray | None,
    *,
    count: int,
) -> np.ndarray:
    """Return (count,) average precisions, one for each group of objects; nan for an empty group.

    A detection that is matched with an object of another group does not count.

    object_groups: (M,) int, 0 to count - 1, of each eligible object of the episode.
    detection_groups: (N,) int, of each detection of the episode, used where it is false. None: a
        false detection belongs to no group, and counts in each.
    """
    right = ranked.right
    groups = np.full(len(right), -1)
    groups[right] = object_groups[ranked.objects[right]]
    if detection_groups is not None:
        groups[~right] = detection_groups[ranked.detections[~right]]
    values = np.full(count, np.nan)
    for group, total in enumerate(np.bincount(object_groups, minlength=count).tolist()):
        inside = (groups == group) | (~right if detection_groups is None else False)
        if total:
            values[group] = area_under(right[inside], ranked.scores[inside], total)
    return values


def rank_by_distance(
    pairings: Sequence[Pairing], scores: Sequence[np.ndarray], *, gate_m: float
) -> RankedDetections:
    """Match each detection, from the highest score down, with the nearest free object."""
    costs = [np.where(p.distances <= gate_m, p.distances, np.inf) for p in pairings]
    return _ranked(pairings, costs, scores)


def area_under(right: np.ndarray, scores: np.ndarray, total: int) -> float:
    """Return the mean interpolated precision over `RECALL_LEVELS`.

    right: (N,) bool, which detections are right. scores: (N,). total: number of objects, above 0.
    """
    order = np.argsort(-scores, kind="stable")
    last_of_step = np.flatnonzero(np.diff(scores[order], append=-np.inf))
    right_count = np.cumsum(right[order])[last_of_step]
    recall, precision = right_count / total, right_count / (last_of_step + 1)
    interpolated = np.maximum.accumulate(precision[::-1])[::-1]
    step = np.searchsorted(recall, RECALL_LEVELS - 1e-12)
    return float(np.append(interpolated, 0.0)[step].mean())


def _score_of(ranked: RankedDetections) -> Score:
    total = ranked.object_count
    return averaged(area_under(ranked.right, ranked.scores, total) if total else np.nan, total)


def _ranked(
    pairings: Sequence[Pairing], costs: Sequence[np.ndarray], scores: Sequence[np.ndarray]
) -> RankedDetections:
    """Match all frames greedily by (N, M) costs; inf where a match is not possible."""
    ranked_scores, objects, detections = [np.empty(0)], [np.empty(0, int)], [np.empty(0, int)]
    object_count = detection_count = 0
    for pairing, cost, frame_scores in zip(pairings, costs, scores, strict=True):
        order = np.lexsort((cost.min(axis=1, initial=np.inf), -frame_scores))
        matched = match_greedily(cost, order, eligible=pairing.eligible, counted=pairing.counted)
        right, used = matched >= 0, np.flatnonzero(matched != IGNORED)
        matched[right] = (np.cumsum(pairing.eligible) - 1 + object_count)[matched[right]]
        ranked_scores.append(frame_scores[used])
        objects.append(matched[used])
        detections.append(detection_count + used)
        object_count += int(pairing.eligible.sum())
        detection_count += len(matched)
    return RankedDetections(
        np.concatenate(ranked_scores),
        np.concatenate(objects),
        np.concatenate(detections),
        object_count,
    )


def match_greedily(
    costs: np.ndarray, order: np.ndarray, *, eligible: np.ndarray, counted: np.ndarray
) -> np.ndarray:
    """Return (N,) int64, the eligible object of each detection, or `FALSE_ALARM` or `IGNORED`.

    In their order, detections take the free eligible object of least cost; then those that are
    left take the free ineligible object of least cost, and are ignored. What is still left is a
    false alarm, or ignored if it is not counted.

    costs: (N, M), inf where a match is not possible. order: (N,) rows, the first one first.
    eligible: (M,) bool. counted: (N,) bool.
    """
    matched = np.where(counted, FALSE_ALARM, IGNORED)
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    rows, columns = np.nonzero(costs < np.inf)
    by_rank = np.lexsort((costs[rows, columns], rank[rows]))
    pairs = list(zip(rows[by_rank].tolist(), columns[by_rank].tolist(), strict=True))
    eligible_columns = set(np.flatnonzero(eligible).tolist())
    matched_rows, matched_columns = set(), set()
    for wants_eligible in (True, False):
        for row, column in pairs:
            is_free = row not in matched_rows and column not in matched_columns
            if is_free and (column in eligible_columns) == wants_eligible:
                matched_rows.add(row)
                matched_columns.add(column)
                matched[row] = column if wants_eligible else IGNORED
    return matched
