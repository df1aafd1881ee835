"""HOTA: detection and association weighed alike, over all degrees of closeness."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

ALPHAS = np.arange(0.05, 0.99, 0.05)
EPSILON = float(np.finfo(float).eps)
"""Alphas are sums of rounded steps: a similarity equal to one must reach it."""


@dataclass(frozen=True, slots=True, eq=False)
class Hota(Record):
    """HOTA and its parts (Luiten et al. 2021) as curves, (19,) each, over `ALPHAS`.

    A pair is a hit where its similarity reaches alpha. What is kept are sums, so that the
    figures of several sequences together are those of `one + other`.

    hits, misses, false_alarms: object frames and track frames.
    closeness: sum of similarities of the hits.
    shared, shared_recall, shared_precision: sums over hits of how far their object and their
        track are one: eq. 3 of the paper and its parts.
    """

    hits: np.ndarray
    misses: np.ndarray
    false_alarms: np.ndarray
    closeness: np.ndarray
    shared: np.ndarray
    shared_recall: np.ndarray
    shared_precision: np.ndarray

    def __add__(self, other: Hota) -> Hota:
        return Hota(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def hota(self) -> np.ndarray:
        """Geometric mean of `det_a` and `ass_a`, eq. 5."""
        curve: np.ndarray = np.sqrt(self.det_a * self.ass_a)
        return curve

    @property
    def det_a(self) -> np.ndarray:
        """Detection accuracy: hits over hits, misses and false alarms."""
        return _share(self.hits, self.hits + self.misses + self.false_alarms)

    @property
    def det_re(self) -> np.ndarray:
        """Detection recall."""
        return _share(self.hits, self.hits + self.misses)

    @property
    def det_pr(self) -> np.ndarray:
        """Detection precision."""
        return _share(self.hits, self.hits + self.false_alarms)

    @property
    def ass_a(self) -> np.ndarray:
        """Association accuracy, eq. 4."""
        return _share(self.shared, self.hits)

    @property
    def ass_re(self) -> np.ndarray:
        """Association recall: how much of its object's life the track of a hit covers."""
        return _share(self.shared_recall, self.hits)

    @property
    def ass_pr(self) -> np.ndarray:
        """Association precision: how much of its track's life the object of a hit covers."""
        return _share(self.shared_precision, self.hits)

    @property
    def loc_a(self) -> np.ndarray:
        """Localisation accuracy: mean similarity of hits; 1 where there are none."""
        least = 1e-10
        curve: np.ndarray = np.maximum(least, self.closeness) / np.maximum(least, self.hits)
        return curve


def hota(sequence: TrackedSequence) -> Hota:
    """Return HOTA of a sequence (Luiten et al. 2021): curves over `ALPHAS`, 0 to 1.

    One assignment a frame serves all alphas: it weighs similarity with how well object and track
    fit over the whole sequence.
    """
    pairs = _assigned(sequence)
    similarity = sequence.similarities[pairs]
    reached = np.searchsorted(ALPHAS - EPSILON, similarity, side="right")
    pairs, similarity, reached = pairs[reached > 0], similarity[reached > 0], reached[reached > 0]
    hits = _at_least(reached)
    shared, recall, precision = _association(sequence, pairs, reached)
    return Hota(
        hits=hits,
        misses=len(sequence.truths) - hits,
        false_alarms=len(sequence.tracks) - hits,
        closeness=_at_least(reached, similarity),
        shared=shared,
        shared_recall=recall,
        shared_precision=precision,
    )


def _assigned(sequence: TrackedSequence) -> np.ndarray:
    """Return the best pairs of all frames; kernel and solver take turns.

    Pairs that are worth nothing may or may not be among them.
    """
    from scipy.optimize import linear_sum_assignment

    from roadscope.benchmarks.metrics.tracking.hota_kernels import NOBODY, assign_on

    places, worth = (
        (sequence.truths, sequence.tracks),
        (_alignment(sequence), sequence.similarities),
    )
    match = np.full(len(sequence.truths), NOBODY)
    costs = np.empty((sequence.truth_counts * sequence.track_counts).max(initial=0))
    rows, columns, pairs = (starts.tolist() for starts in sequence.starts)
    t = -1
    while (t := assign_on(t + 1, sequence.starts, places, worth, (match, costs))) < len(sequence):
        height, width = rows[t + 1] - rows[t], columns[t + 1] - columns[t]
        row, column = linear_sum_assignment(costs[: height * width].reshape(height, width))
        match[rows[t] : rows[t + 1]] = NOBODY
        match[rows[t] + row] = pairs[t] + row * width + column
    pairs_found: np.ndarray = match[match != NOBODY]
    return pairs_found


def _alignment(sequence: TrackedSequence) -> np.ndarray:
    """How well each object fits each track over the whole sequence, (objects, tracks), 0 to 1."""
    from roadscope.benchmarks.metrics.tracking.hota_kernels import add_potential

    matrices = sequence.matrices(sequence.similarities)
    # NumPy sums in an order of its own, to which ties between assignments are sensitive.
    sums = tuple(np.concatenate([np.empty(0), *(m.sum(axis) for m in matrices)]) for axis in (1, 0))
    potential = np.zeros((sequence.objects, sequence.followers))
    places = sequence.truths, sequence.tracks
    add_potential(sequence.starts, places, (sums[0], sums[1]), sequence.similarities, potential)
    of_truths, of_tracks = _lives(sequence)
    aligned: np.ndarray = potential / (of_truths[:, None] + of_tracks[None] - potential)
    return aligned


def _association(
    sequence: TrackedSequence, pairs: np.ndarray, reached: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum over hits how much of both lives, of the object's and of the track's is shared."""
    _, rows, columns = sequence.places(pairs)
    objects, tracks = sequence.truths[rows], sequence.tracks[columns]
    codes = objects * max(sequence.followers, 1) + tracks
    used = np.bincount(codes) > 0
    keys, which = np.flatnonzero(used), used.cumsum()[codes] - 1
    counts = np.bincount(which * (len(ALPHAS) + 1) + reached, minlength=len(keys) * 20)
    together = counts.reshape(-1, len(ALPHAS) + 1)[:, :0:-1].cumsum(axis=1)[:, ::-1]
    of_truths, of_tracks = _lives(sequence)
    lived = of_truths[keys // max(sequence.followers, 1)][:, None]
    followed = of_tracks[keys % max(sequence.followers, 1)][:, None]
    squares = together * together
    return (
        (squares / np.maximum(lived + followed - together, 1)).sum(axis=0),
        (squares / lived).sum(axis=0),
        (squares / followed).sum(axis=0),
    )


def _lives(sequence: TrackedSequence) -> tuple[np.ndarray, np.ndarray]:
    """Return in how many frames each object and each track is there."""
    return (
        np.bincount(sequence.truths, minlength=sequence.objects),
        np.bincount(sequence.tracks, minlength=sequence.followers),
    )


def _at_least(reached: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Sum over all that reached each alpha or more; reached: number of alphas, from 1."""
    sums = np.bincount(reached, weights, minlength=len(ALPHAS) + 1)
    curve: np.ndarray = sums[:0:-1].cumsum()[::-1]
    return curve


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    share: np.ndarray = part / np.maximum(whole, 1)
    return share
