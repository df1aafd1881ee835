"""Which track follows which object, frame after frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

EPSILON = float(np.finfo(float).eps)
NOBODY = -1


@dataclass(frozen=True, slots=True, eq=False)
class Following(Record):
    """The K matched pairs of a sequence, in order of frames.

    pairs: (K,) int64, among the pairs of the sequence.
    frames: (K,) int64.
    rows, columns: (K,) int64, among all objects and all tracks of the sequence.
    objects, tracks: (K,) int64, their numbers.
    """

    pairs: np.ndarray
    frames: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    objects: np.ndarray
    tracks: np.ndarray


def follow(
    sequence: TrackedSequence, threshold: float = 0.5, alive: np.ndarray | None = None
) -> Following:
    """Match as CLEAR MOT does (Bernardin and Stiefelhagen 2008, section 2.1).

    A pair of the frame before stays while its similarity reaches the threshold; the rest is
    assigned for the greatest total similarity. Frames without any object or any track are passed
    over: what was matched before them counts as the frame before.

    alive: (tracks,) bool, those that are there at all.
    """
    if not 0 < threshold <= 1:
        raise ValueError(f"threshold: expected above 0 and up to 1, got {threshold:g}")
    there = np.ones(len(sequence.tracks), bool) if alive is None else alive[sequence.tracks]
    match = _matched(sequence, threshold - EPSILON, there)
    pairs = match[match != NOBODY]
    frames, rows, columns = sequence.places(pairs)
    return Following(pairs, frames, rows, columns, sequence.truths[rows], sequence.tracks[columns])


def frames_with_both(sequence: TrackedSequence, there: np.ndarray) -> np.ndarray:
    """Return (T,) bool, frames with an object and a track; there: (Q,) bool, tracks that count."""
    sums = np.concatenate([[0], np.cumsum(there)])
    tracks = sums[sequence.track_starts[1:]] - sums[sequence.track_starts[:-1]]
    both: np.ndarray = (sequence.truth_counts > 0) & (tracks > 0)
    return both


def _matched(sequence: TrackedSequence, least: float, there: np.ndarray) -> np.ndarray:
    """Return (P,) int64, the pair of each matched object; kernel and solver take turns."""
    from scipy.optimize import linear_sum_assignment

    from roadscope.benchmarks.metrics.tracking.following_kernels import follow_on

    places, close = (sequence.truths, sequence.tracks), (sequence.similarities, there, least)
    match = np.full(len(sequence.truths), NOBODY)
    costs = np.empty((sequence.truth_counts * sequence.track_counts).max(initial=0))
    previous, room = np.full(sequence.objects, NOBODY), np.full(sequence.followers, NOBODY)
    memory = previous, room, frames_with_both(sequence, there), match, costs
    rows, columns, pairs = (starts.tolist() for starts in sequence.starts)
    everybody, t = there.all(), -1
    while (t := follow_on(t + 1, sequence.starts, places, close, memory)) < len(sequence):
        height, width = rows[t + 1] - rows[t], columns[t + 1] - columns[t]
        kept = None if everybody else np.flatnonzero(there[columns[t] : columns[t + 1]])
        cost = costs[: height * (width if kept is None else len(kept))].reshape(height, -1)
        row, column = linear_sum_assignment(cost)
        real = cost[row, column] < -EPSILON
        row, column = row[real], column[real]
        match[rows[t] : rows[t + 1]] = NOBODY
        match[rows[t] + row] = pairs[t] + row * width + (column if kept is None else kept[column])
    return match
