"""HOTA: detection and association weighed alike, over all degrees of closeness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracked import TrackedFrame

ALPHAS = np.arange(0.05, 0.99, 0.05)


@dataclass(frozen=True, slots=True)
class Hota:
    """HOTA with its parts (Luiten et al. 2021), each the mean over all alphas.

    det_a, ass_a, loc_a: accuracy of detection, association and localisation.
    """

    hota: Score
    det_a: Score
    ass_a: Score
    loc_a: Score


def hota(frames: Sequence[TrackedFrame], gate_m: float) -> Hota:
    """Return HOTA; similarity falls from 1 at no distance to 0.5 at the gate and 0 at twice."""
    similarities = [np.maximum(0.0, 1 - f.distances / (2 * gate_m)) for f in frames]
    tracks, truths = _rows(frames)
    alignment = _alignment(similarities, tracks, truths)
    hits = np.zeros(len(ALPHAS))
    closeness = np.zeros(len(ALPHAS))
    shared = np.zeros((len(ALPHAS), *alignment.shape))
    for similarity, rows, columns in zip(similarities, tracks, truths, strict=True):
        r, c = _assign(similarity * alignment[np.ix_(rows, columns)])
        # Alphas are sums of rounded steps: a similarity equal to one must reach it.
        reached = similarity[r, c] >= ALPHAS[:, None] - np.finfo(float).eps
        hits += reached.sum(axis=1)
        closeness += (similarity[r, c] * reached).sum(axis=1)
        shared[:, rows[r], columns[c]] += reached
    return _score(hits, closeness, shared, tracks, truths)


def _score(
    hits: np.ndarray, closeness: np.ndarray, shared: np.ndarray,
    tracks: list[np.ndarray], truths: list[np.ndarray],
) -> Hota:  # fmt: skip
    """Turn counts into scores, eq. 2 to 5 of the paper."""
    of_tracks = np.bincount(np.concatenate(tracks), minlength=shared.shape[1])
    of_truths = np.bincount(np.concatenate(truths), minlength=shared.shape[2])
    objects = int(of_truths.sum())
    united = of_tracks[:, None] + of_truths[None] - shared
    accuracy = (shared * shared / np.maximum(united, 1)).sum(axis=(1, 2)) / np.maximum(hits, 1)
    found = hits / np.maximum(objects + of_tracks.sum() - hits, 1)
    placed = np.where(hits > 0, closeness / np.maximum(hits, 1), 1.0)

    def score(values: np.ndarray) -> Score:
        value = float(values.mean()) if objects else np.nan
        return Score(value, "1", "higher", objects, 0.0, 1.0, weight=objects)

    return Hota(score(np.sqrt(found * accuracy)), score(found), score(accuracy), score(placed))


def _rows(frames: Sequence[TrackedFrame]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return numbers from 0 for the tracks and the objects of the episode, frame by frame."""
    track_ids = np.unique(np.concatenate([f.track_ids for f in frames]))
    truth_ids = np.unique(np.concatenate([f.truth_ids for f in frames]))
    return (
        [np.searchsorted(track_ids, f.track_ids) for f in frames],
        [np.searchsorted(truth_ids, f.truth_ids) for f in frames],
    )


def _alignment(
    similarities: list[np.ndarray], tracks: list[np.ndarray], truths: list[np.ndarray]
) -> np.ndarray:
    """How well each track fits each object over the whole episode, (tracks, objects) in 0 to 1."""
    n = 1 + max((int(r.max()) for r in tracks if len(r)), default=-1)
    m = 1 + max((int(c.max()) for c in truths if len(c)), default=-1)
    potential = np.zeros((n, m))
    for similarity, rows, columns in zip(similarities, tracks, truths, strict=True):
        either = similarity.sum(axis=0)[None] + similarity.sum(axis=1)[:, None] - similarity
        potential[np.ix_(rows, columns)] += np.divide(
            similarity, either, out=np.zeros_like(similarity), where=either > np.finfo(float).eps
        )
    of_tracks = np.bincount(np.concatenate(tracks), minlength=n)
    of_truths = np.bincount(np.concatenate(truths), minlength=m)
    united = of_tracks[:, None] + of_truths[None] - potential
    aligned: np.ndarray = potential / np.maximum(united, np.finfo(float).eps)
    return aligned


def _assign(score: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(score, maximize=True)
    return rows, columns
