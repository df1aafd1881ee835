"""HOTA: detection and association with equal weight, over all thresholds of similarity."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from roadscope.benchmarks.metrics.tracking.matching import EPSILON, TrackPairs, assign_frames
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

ALPHAS = np.arange(0.05, 0.99, 0.05)
"""Thresholds of similarity; sums of rounded steps, so a similarity reaches one up to `EPSILON`."""


@dataclass(frozen=True, slots=True, eq=False)
class Hota(Record):
    """HOTA and its parts (Luiten et al. 2021) as curves, (19,) each, over `ALPHAS`.

    A pair is a hit (TP) at each alpha that its similarity reaches. The fields are sums, so
    `one + other` holds the figures of several sequences together. All figures are 0 to 1, without
    a unit, higher is better; their mean over alphas is what is reported. They are 0 where there is
    nothing to divide by, `loc_a` is 1 there.

    hits, misses, false_alarms: TP and FN in object frames, FP in track frames.
    closeness: sum of similarities of the hits.
    shared, shared_recall, shared_precision: sums over hits of A(c) (eq. 3 of the paper), and of
        its recall and precision.
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
        """sqrt(DetA AssA), eq. 5."""
        curve: np.ndarray = np.sqrt(self.det_a * self.ass_a)
        return curve

    @property
    def det_a(self) -> np.ndarray:
        """Detection accuracy, TP / (TP + FN + FP)."""
        return _share(self.hits, self.hits + self.misses + self.false_alarms)

    @property
    def det_re(self) -> np.ndarray:
        """Detection recall, TP / (TP + FN)."""
        return _share(self.hits, self.hits + self.misses)

    @property
    def det_pr(self) -> np.ndarray:
        """Detection precision, TP / (TP + FP)."""
        return _share(self.hits, self.hits + self.false_alarms)

    @property
    def ass_a(self) -> np.ndarray:
        """Association accuracy, the mean of A(c) over hits, eq. 4."""
        return _share(self.shared, self.hits)

    @property
    def ass_re(self) -> np.ndarray:
        """Association recall, the mean over hits of TPA / (TPA + FNA)."""
        return _share(self.shared_recall, self.hits)

    @property
    def ass_pr(self) -> np.ndarray:
        """Association precision, the mean over hits of TPA / (TPA + FPA)."""
        return _share(self.shared_precision, self.hits)

    @property
    def loc_a(self) -> np.ndarray:
        """Localisation accuracy, the mean similarity of hits; 1 without a hit."""
        least = 1e-10
        curve: np.ndarray = np.maximum(least, self.closeness) / np.maximum(least, self.hits)
        return curve


def hota(sequence: TrackedSequence) -> Hota:
    """Return HOTA of a sequence (Luiten et al. 2021): curves over `ALPHAS`, 0 to 1.

    As in TrackEval, one assignment of a frame serves all alphas: its weight is the similarity
    times the alignment of object and track over the whole sequence.
    """
    candidates = TrackPairs.of(sequence, np.flatnonzero(sequence.similarities > 0))
    weights = _alignments(sequence, candidates) * sequence.similarities[candidates.pairs]
    pairs = assign_frames(sequence, candidates, -weights)
    reached = np.searchsorted(ALPHAS - EPSILON, sequence.similarities[pairs.pairs], side="right")
    pairs, reached = pairs.select(reached > 0), reached[reached > 0]
    hits = _at_least(reached)
    shared, recall, precision = _association(sequence, pairs, reached)
    return Hota(
        hits=hits,
        misses=len(sequence.truths) - hits,
        false_alarms=len(sequence.tracks) - hits,
        closeness=_at_least(reached, sequence.similarities[pairs.pairs]),
        shared=shared,
        shared_recall=recall,
        shared_precision=precision,
    )


def _alignments(sequence: TrackedSequence, candidates: TrackPairs) -> np.ndarray:
    """Return (C,), how well object and track of each candidate fit over the sequence, 0 to 1.

    It is a soft Jaccard index (`global_alignment_score` of TrackEval): with s the sum over frames
    of similarity / (similarities of the object + of the track - similarity), the alignment is
    s / (frames of the object + of the track - s).

    candidates: all pairs with any similarity.
    """
    matrices = sequence.matrices(sequence.similarities)
    # NumPy's own order of summation, as in TrackEval: ties between assignments depend on it.
    of_objects = np.concatenate([np.empty(0), *(m.sum(axis=1) for m in matrices)])
    of_tracks = np.concatenate([np.empty(0), *(m.sum(axis=0) for m in matrices)])
    similarity = sequence.similarities[candidates.pairs]
    union = of_tracks[candidates.track_rows] + of_objects[candidates.truth_rows] - similarity
    codes = candidates.objects * sequence.distinct_tracks + candidates.tracks
    shares = np.where(union > EPSILON, similarity / np.maximum(union, EPSILON), 0.0)
    common = np.bincount(codes, shares)[codes]
    object_frames, track_frames = _lifetimes(sequence)
    frames = object_frames[candidates.objects] + track_frames[candidates.tracks]
    alignments: np.ndarray = common / (frames - common)
    return alignments


def _association(
    sequence: TrackedSequence, pairs: TrackPairs, reached: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (19,) sums over hits of A(c), of its recall and of its precision.

    A(c) = TPA / (TPA + FNA + FPA): TPA is the number of hits of the hit's object and track
    together, TPA + FNA the object's frames, TPA + FPA the track's.

    reached: (K,) number of alphas that each pair reaches, from 1.
    """
    track_count, levels = max(sequence.distinct_tracks, 1), len(ALPHAS) + 1
    codes = pairs.objects * track_count + pairs.tracks
    keys, key_of_pair = np.unique(codes, return_inverse=True)
    counts = np.bincount(key_of_pair * levels + reached, minlength=len(keys) * levels)
    together = counts.reshape(-1, levels)[:, :0:-1].cumsum(axis=1)[:, ::-1]
    object_frames, track_frames = _lifetimes(sequence)
    lifetime = object_frames[keys // track_count][:, None]
    track_lifetime = track_frames[keys % track_count][:, None]
    squares = together * together
    return (
        (squares / np.maximum(lifetime + track_lifetime - together, 1)).sum(axis=0),
        (squares / lifetime).sum(axis=0),
        (squares / track_lifetime).sum(axis=0),
    )


def _lifetimes(sequence: TrackedSequence) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of frames of each object and of each track."""
    return (
        np.bincount(sequence.truths, minlength=sequence.distinct_objects),
        np.bincount(sequence.tracks, minlength=sequence.distinct_tracks),
    )


def _at_least(reached: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Return (19,) sums of the weights of all pairs that reach each alpha; None: their number."""
    sums = np.bincount(reached, weights, minlength=len(ALPHAS) + 1)
    curve: np.ndarray = sums[:0:-1].cumsum()[::-1]
    return curve


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    share: np.ndarray = part / np.maximum(whole, 1)
    return share
