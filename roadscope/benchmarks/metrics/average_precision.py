"""Average precision by centre distance: how well scores order right before wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score

RECALL_LEVELS = np.linspace(0.0, 1.0, 101)


def average_precision(
    pairings: Sequence[Pairing], scores: Sequence[np.ndarray], gate_m: float
) -> Score:
    """Return the mean of interpolated precision at 101 recall levels.

    Detections are matched greedily from the highest score down, each to the nearest object that
    is still free within the gate (Caesar et al. 2020, nuScenes, without its cut of low recall
    and precision). Detections of equal score count as one step of the curve, so their order does
    not matter.
    """
    total = sum(int(p.eligible.sum()) for p in pairings)
    outcomes = [_outcomes(p, s, gate_m) for p, s in zip(pairings, scores, strict=True)]
    hits = np.concatenate([o[0] for o in outcomes]) if outcomes else np.empty(0, bool)
    ranked = np.concatenate([o[1] for o in outcomes]) if outcomes else np.empty(0)
    value = _area(hits, ranked, total) if total else np.nan
    return Score(value, "1", "higher", total, 0.0, 1.0, weight=total)


def _outcomes(pairing: Pairing, scores: np.ndarray, gate_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return hit or false alarm and score of each detection of a frame that is not ignored."""
    distances = np.where(pairing.distances <= gate_m, pairing.distances, np.inf)
    nearest = distances.min(axis=1, initial=np.inf)
    hits, kept = [], []
    for row in np.lexsort((nearest, -scores)):
        hit, fair = _take(distances, row, pairing.eligible)
        if hit or (fair and pairing.counted[row]):
            hits.append(hit)
            kept.append(scores[row])
    return np.array(hits, bool), np.array(kept, np.float64)


def _take(distances: np.ndarray, row: int, eligible: np.ndarray) -> tuple[bool, bool]:
    """Occupy the nearest free object; say whether it is a hit and whether a miss-hit counts."""
    for group in (eligible, ~eligible):
        free = np.where(group, distances[row], np.inf)
        if free.size and np.isfinite(free.min()):
            distances[:, free.argmin()] = np.inf
            return bool(group is eligible), False
    return False, True


def _area(hits: np.ndarray, scores: np.ndarray, total: int) -> float:
    order = np.argsort(-scores, kind="stable")
    last_of_step = np.flatnonzero(np.diff(scores[order], append=-np.inf))
    found = np.cumsum(hits[order])[last_of_step]
    recall, precision = found / total, found / (last_of_step + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    step = np.searchsorted(recall, RECALL_LEVELS - 1e-12)
    reached = np.append(best_from_here, 0.0)[step]
    return float(reached.mean())
