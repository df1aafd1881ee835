"""OSPA and GOSPA: the distance of the set of tracks from the set of objects, in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.matching import TrackPairs, assign_frames
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class Ospa(Record):
    """Optimal sub-pattern assignment of T frames (Schuhmacher, Vo and Vo 2008).

    distances: (T,) metres per object, 0 to the cut-off, lower is better; 0 without objects and
        tracks.
    localisation, cardinality: (T,) its parts, eq. 4: by distances, and by a wrong number of
        tracks, each to the power of the order. distances = (their sum) ** (1 / order).
    """

    distances: np.ndarray
    localisation: np.ndarray
    cardinality: np.ndarray

    @property
    def mean(self) -> float:
        """Mean over frames, metres; nan without a frame."""
        return _mean(self.distances)


@dataclass(frozen=True, slots=True, eq=False)
class Gospa(Record):
    """Generalised OSPA of T frames, with alpha = 2 (Rahmathullah et al. 2017).

    distances: (T,) metres, 0 and more, lower is better; not divided by the number of objects.
    localisation, missed, false: (T,) its parts, prop. 1, each to the power of the order.
        distances = (their sum) ** (1 / order).
    """

    distances: np.ndarray
    localisation: np.ndarray
    missed: np.ndarray
    false: np.ndarray

    @property
    def mean(self) -> float:
        """Mean over frames, metres; nan without a frame."""
        return _mean(self.distances)


def ospa(
    sequence: TrackedSequence,
    cutoff_m: float = 2.0,
    order: float = 1.0,
    *,
    pairing_order: float | None = None,
) -> Ospa:
    """Return OSPA of each frame in metres (Schuhmacher, Vo and Vo 2008).

    With m <= n objects and tracks (or the reverse), cut-off c, order p and the best assignment pi:
    ((sum_i min(d(i, pi(i)), c)^p + c^p (n - m)) / n)^(1/p). The sequence must have distances.

    cutoff_m: the most that one distance, or one object or track too many, counts for.
    pairing_order: order of the costs by which pi is chosen; None: `order`, as OSPA is defined.
        Some implementations always take 1.
    """
    _check(cutoff_m, order)
    most = np.maximum(sequence.truth_counts, sequence.track_counts)
    least = np.minimum(sequence.truth_counts, sequence.track_counts)
    pairs = _close_pairs(
        sequence, "OSPA", cutoff_m, order if pairing_order is None else pairing_order
    )
    costs, paired = _sums(sequence, pairs, order)
    shares, penalty = np.maximum(most, 1), cutoff_m**order
    localisation = (costs + penalty * (least - paired)) / shares
    cardinality = penalty * (most - least) / shares
    return Ospa((localisation + cardinality) ** (1 / order), localisation, cardinality)


def gospa(sequence: TrackedSequence, cutoff_m: float = 2.0, order: float = 1.0) -> Gospa:
    """Return GOSPA of each frame in metres (Rahmathullah et al. 2017).

    With cut-off c, order p, and the best assignment, which leaves objects missed and tracks false:
    (sum d^p + c^p / 2 (missed + false))^(1/p). The sequence must have distances.

    cutoff_m: a pair at least this far apart is a missed object and a false track.
    """
    _check(cutoff_m, order)
    pairs = _close_pairs(sequence, "GOSPA", cutoff_m, order)
    localisation, paired = _sums(sequence, pairs, order)
    missed = cutoff_m**order / 2 * (sequence.truth_counts - paired)
    false = cutoff_m**order / 2 * (sequence.track_counts - paired)
    return Gospa((localisation + missed + false) ** (1 / order), localisation, missed, false)


def _close_pairs(
    sequence: TrackedSequence, metric: str, cutoff_m: float, order: float
) -> TrackPairs:
    """Return the pairs of each frame's cheapest assignment that are closer than the cut-off."""
    distances = sequence.distances(metric)
    candidates = TrackPairs.of(sequence, np.flatnonzero(distances < cutoff_m))
    costs = distances[candidates.pairs] ** order
    return assign_frames(sequence, candidates, costs, other=cutoff_m**order)


def _sums(
    sequence: TrackedSequence, pairs: TrackPairs, order: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (T,) sums of the pairs' distances to the power of the order, and their number."""
    assert sequence.distances_m is not None
    costs = sequence.distances_m[pairs.pairs] ** order
    return (
        np.bincount(pairs.frames, costs, minlength=len(sequence)),
        np.bincount(pairs.frames, minlength=len(sequence)),
    )


def _check(cutoff_m: float, order: float) -> None:
    if not 0 < cutoff_m < np.inf:
        raise ValueError(f"cutoff_m: expected metres above 0, got {cutoff_m:g}")
    if not 1 <= order < np.inf:
        raise ValueError(f"order: expected 1 or more, finite, got {order:g}")


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")
