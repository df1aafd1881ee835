"""Average precision: how well scores order right before wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score

RECALL_LEVELS = np.linspace(0.0, 1.0, 101)


def average_precision(
    pairings: Sequence[Pairing], scores: Sequence[np.ndarray], gate_m: float
) -> Score:
    """Return average precision where a hit is a centre within the gate.

    That is the mean of interpolated precision at 101 recall levels. Detections are matched
    greedily from the highest score down, each to the nearest object that is still free within
    the gate (Caesar et al. 2020, nuScenes, without its cut of low recall and precision).
    Detections of equal score count as one step of the curve, so their order does not matter.
    """
    costs = [np.where(p.distances <= gate_m, p.distances, np.inf) for p in pairings]
    return _precision_of(pairings, costs, scores)


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
    return _precision_of(pairings, costs, scores)


def _precision_of(
    pairings: Sequence[Pairing], costs: Sequence[np.ndarray], scores: Sequence[np.ndarray]
) -> Score:
    """Match greedily by cost, infinite where no match is possible, and measure the curve."""
    from roadscope.benchmarks.metrics.greedy import HIT, IGNORED, outcomes

    total = sum(int(p.eligible.sum()) for p in pairings)
    hits, ranked = [np.empty(0, bool)], [np.empty(0)]
    for pairing, cost, frame_scores in zip(pairings, costs, scores, strict=True):
        order = np.lexsort((cost.min(axis=1, initial=np.inf), -frame_scores))
        fates = outcomes(np.array(cost), order, pairing.eligible, pairing.counted)
        hits.append(fates[fates != IGNORED] == HIT)
        ranked.append(frame_scores[fates != IGNORED])
    value = area_under(np.concatenate(hits), np.concatenate(ranked), total) if total else np.nan
    return Score(value, "1", "higher", total, 0.0, 1.0, weight=total)


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
