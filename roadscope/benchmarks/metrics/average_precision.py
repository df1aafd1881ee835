"""Average precision: how well scores order right before wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score

RECALL_LEVELS = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, slots=True, eq=False)
class Ranked:
    """What the detections of an episode took; K of them, those that count either way.

    scores: (K,) float64.
    taken: (K,) int64, which of all eligible objects, frame after frame; -1 for none.
    rows: (K,) int64, which of all detections, frame after frame.
    objects: number of all eligible objects.
    """

    scores: np.ndarray
    taken: np.ndarray
    rows: np.ndarray
    objects: int


def average_precision(
    pairings: Sequence[Pairing], scores: Sequence[np.ndarray], gate_m: float
) -> Score:
    """Return average precision where a hit is a centre within the gate.

    That is the mean of interpolated precision at 101 recall levels. Detections are matched
    greedily from the highest score down, each to the nearest object that is still free within
    the gate (Caesar et al. 2020, nuScenes, without its cut of low recall and precision).
    Detections of equal score count as one step of the curve, so their order does not matter.
    """
    return _precision_of(ranked_by_distance(pairings, scores, gate_m))


def overlap_precision(
    pairings: Sequence[Pairing],
    shares: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    least: float,
    gate_m: float,
) -> Score:
    """Return average precision where a hit is an intersection over union of at least `least`.

    shares: for each frame (N, K), the overlap with the first K of the pairing's M objects; the
        others, of which only the centre is known, are not eligible.
    gate_m: a detection this close to an object that is not eligible is ignored, as in matching.
    """
    costs = []
    for pairing, share in zip(pairings, shares, strict=True):
        cost = np.where(pairing.distances <= gate_m, pairing.distances, np.inf)
        wanted = np.flatnonzero(pairing.eligible)
        cost[:, wanted] = np.where(share[:, wanted] >= least, 1 - share[:, wanted], np.inf)
        costs.append(cost)
    return _precision_of(_ranked(pairings, costs, scores))


def precision_by_group(
    ranked: Ranked, groups: np.ndarray, own: np.ndarray | None, count: int
) -> np.ndarray:
    """Return (count,) the average precision of each group of objects; nan where there are none.

    groups: (M,) int, of each eligible object; what takes an object of another group counts
        neither way.
    own: (N,) int, of each detection of the episode, where it is false; None where what is false
        belongs to no group, so it counts in each.
    """
    hit = ranked.taken >= 0
    of = np.full(len(hit), -1)
    of[hit] = groups[ranked.taken[hit]]
    if own is not None:
        of[~hit] = own[ranked.rows[~hit]]
    values = np.full(count, np.nan)
    for group, total in enumerate(np.bincount(groups, minlength=count).tolist()):
        inside = (of == group) | (~hit if own is None else False)
        if total:
            values[group] = area_under(hit[inside], ranked.scores[inside], total)
    return values


def ranked_by_distance(
    pairings: Sequence[Pairing], scores: Sequence[np.ndarray], gate_m: float
) -> Ranked:
    """Match greedily, from the highest score down, to the nearest free object in the gate."""
    costs = [np.where(p.distances <= gate_m, p.distances, np.inf) for p in pairings]
    return _ranked(pairings, costs, scores)


def _precision_of(ranked: Ranked) -> Score:
    total, value = ranked.objects, np.nan
    if total:
        value = area_under(ranked.taken >= 0, ranked.scores, total)
    return Score(value, "1", "higher", total, 0.0, 1.0, weight=total)


def _ranked(
    pairings: Sequence[Pairing], costs: Sequence[np.ndarray], scores: Sequence[np.ndarray]
) -> Ranked:
    """Match greedily by cost, infinite where no match is possible."""
    from roadscope.benchmarks.metrics.greedy import IGNORED, outcomes

    values, taken, rows = [np.empty(0)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    objects = detections = 0
    for pairing, cost, frame_scores in zip(pairings, costs, scores, strict=True):
        order = np.lexsort((cost.min(axis=1, initial=np.inf), -frame_scores))
        fates = outcomes(np.array(cost), order, pairing.eligible, pairing.counted)
        hit, counted = fates >= 0, np.flatnonzero(fates != IGNORED)
        fates[hit] = (np.cumsum(pairing.eligible) - 1 + objects)[fates[hit]]
        values.append(frame_scores[counted])
        taken.append(fates[counted])
        rows.append(detections + counted)
        objects += int(pairing.eligible.sum())
        detections += len(fates)
    columns = np.concatenate(values), np.concatenate(taken), np.concatenate(rows)
    return Ranked(*columns, objects)


def area_under(hits: np.ndarray, scores: np.ndarray, total: int) -> float:
    """Return average precision of (N,) detections, (N,) bool right, of a total to be found."""
    order = np.argsort(-scores, kind="stable")
    last_of_step = np.flatnonzero(np.diff(scores[order], append=-np.inf))
    found = np.cumsum(hits[order])[last_of_step]
    recall, precision = found / total, found / (last_of_step + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    step = np.searchsorted(recall, RECALL_LEVELS - 1e-12)
    reached = np.append(best_from_here, 0.0)[step]
    return float(reached.mean())
