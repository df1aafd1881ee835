"""OSPA and GOSPA: how far the set of tracks is from the set of objects, in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class Ospa(Record):
    """Optimal sub-pattern assignment distance (Schuhmacher, Vo and Vo 2008).

    distances: (T,) metres, 0 to the cut-off, per object; 0 where there is nothing at all.
    localisation, cardinality: (T,) its parts, eq. 4: what distances and what a wrong number
        give, each to the power of the order; both to the power of 1/order make no sum.
    """

    distances: np.ndarray
    localisation: np.ndarray
    cardinality: np.ndarray

    @property
    def mean(self) -> float:
        """Mean over frames, metres; nan without any."""
        return _mean(self.distances)


@dataclass(frozen=True, slots=True, eq=False)
class Gospa(Record):
    """Generalised OSPA with alpha = 2 (Rahmathullah et al. 2017).

    distances: (T,) metres, not divided by the number of objects.
    localisation, missed, false: (T,) its parts, prop. 1: distances to the power of the order
        sum to them.
    """

    distances: np.ndarray
    localisation: np.ndarray
    missed: np.ndarray
    false: np.ndarray

    @property
    def mean(self) -> float:
        """Mean over frames, metres; nan without any."""
        return _mean(self.distances)


def ospa(
    sequence: TrackedSequence,
    cutoff_m: float = 2.0,
    order: float = 1.0,
    *,
    pairing_order: float | None = None,
) -> Ospa:
    """Return OSPA of each frame in metres (Schuhmacher, Vo and Vo 2008).

    The sequence must have distances.

    cutoff_m: no distance counts for more, and so much an object or track too many.
    pairing_order: of the distances that decide who is paired; None: `order`, as defined.
        Some implementations always take 1.
    """
    _check(cutoff_m, order)
    most = np.maximum(sequence.truth_counts, sequence.track_counts)
    least = np.minimum(sequence.truth_counts, sequence.track_counts)
    distances = sequence.distances("OSPA")
    pairs = _pairs(sequence, distances, cutoff_m, order if pairing_order is None else pairing_order)
    apart, paired = _sums(sequence, pairs, distances[pairs] ** order)
    shares, penalty = np.maximum(most, 1), cutoff_m**order
    localisation = (apart + penalty * (least - paired)) / shares
    cardinality = penalty * (most - least) / shares
    return Ospa((localisation + cardinality) ** (1 / order), localisation, cardinality)


def gospa(sequence: TrackedSequence, cutoff_m: float = 2.0, order: float = 1.0) -> Gospa:
    """Return GOSPA of each frame in metres (Rahmathullah et al. 2017).

    The sequence must have distances.

    cutoff_m: pairs at least so far apart are a miss and a false track, each of which costs half
        of cutoff_m ** order.
    """
    _check(cutoff_m, order)
    distances = sequence.distances("GOSPA")
    pairs = _pairs(sequence, distances, cutoff_m, order)
    localisation, paired = _sums(sequence, pairs, distances[pairs] ** order)
    missed = cutoff_m**order / 2 * (sequence.truth_counts - paired)
    false = cutoff_m**order / 2 * (sequence.track_counts - paired)
    return Gospa((localisation + missed + false) ** (1 / order), localisation, missed, false)


def _pairs(
    sequence: TrackedSequence, distances: np.ndarray, cutoff_m: float, order: float
) -> np.ndarray:
    """Return the pairs of the cheapest assignment of every frame that are closer than the cut-off.

    Where no object and no track has two pairs that close, these are all of them; in other frames
    an assignment has to be sought.
    """
    from scipy.optimize import linear_sum_assignment

    close = np.flatnonzero(distances < cutoff_m)
    frames, rows, columns = sequence.places(close)
    contested = (np.bincount(rows)[rows] > 1) | (np.bincount(columns)[columns] > 1)
    doubtful = np.zeros(len(sequence), bool)
    doubtful[frames[contested]] = True
    chosen = [close[~doubtful[frames]]]
    matrices = sequence.matrices(distances)
    for t in np.flatnonzero(doubtful).tolist():
        row, column = linear_sum_assignment(np.minimum(matrices[t], cutoff_m) ** order)
        real = matrices[t][row, column] < cutoff_m
        chosen.append(sequence.pair_starts[t] + row[real] * matrices[t].shape[1] + column[real])
    return np.concatenate(chosen)


def _sums(
    sequence: TrackedSequence, pairs: np.ndarray, costs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (T,) costs of the pairs and their number."""
    frames, _, _ = sequence.places(pairs)
    return (
        np.bincount(frames, costs, minlength=len(sequence)),
        np.bincount(frames, minlength=len(sequence)),
    )


def _check(cutoff_m: float, order: float) -> None:
    if not 0 < cutoff_m < np.inf:
        raise ValueError(f"cutoff_m: expected metres above 0, got {cutoff_m:g}")
    if not 1 <= order < np.inf:
        raise ValueError(f"order: expected 1 or more, finite, got {order:g}")


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")
