"""Which track follows which object, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.jit import compiled
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Who follows whom, frame after frame, compiled.

CONTINUED = 1000.0
"""Outweighs all similarities of a frame, so that what was matched stays so."""
NOBODY = -1

Two = tuple[np.ndarray, np.ndarray]
Three = tuple[np.ndarray, np.ndarray, np.ndarray]
Close = tuple[np.ndarray, np.ndarray, float]
Five = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@compiled()
def follow_on(frame: int, starts: Three, places: Two, close: Close, memory: Five) -> int:
    """Match frame after frame; return the first in which an assignment has to be sought, or T.

    close: similarities of all pairs; (Q,) bool, tracks that count; the least similarity.
    memory: (objects,) the track of each in the frame before; (tracks,) room for columns, -1;
        (T,) bool, frames with objects and tracks that count; (P,) pair of each matched object,
        written, otherwise -1; the costs of the assignment that has to be sought, written, row by
        row, of tracks that count.
    """
    previous, _, counted, match, costs = memory
    if frame > 0 and counted[frame - 1]:
        _remember(frame - 1, starts, places, previous, match)
    for t in range(frame, len(counted)):
        if counted[t]:
            if not _match_frame(t, starts, places, close, memory):
                _write_costs(t, starts, places, close, (previous, costs))
                return t
            _remember(t, starts, places, previous, match)
    return len(counted)


@compiled()
def _match_frame(t: int, starts: Three, places: Two, close: Close, memory: Five) -> bool:
    """Match what is without doubt; return whether that is all.

    Pairs of the frame before stay. Of the rest there is no doubt while no object and no track
    has two pairs that could be matched.
    """
    similarities, there, least = close
    previous, column_of, _, match, _ = memory
    first, columns = starts[1][t], starts[1][t + 1] - starts[1][t]
    taken = np.zeros(columns, np.bool_)
    for j in range(columns):
        taken[j] = not there[first + j]
        column_of[places[1][first + j]] = NOBODY if taken[j] else j
    for i in range(starts[0][t], starts[0][t + 1]):
        match[i] = NOBODY
        offset = starts[2][t] + (i - starts[0][t]) * columns
        before = previous[places[0][i]]
        j = column_of[before] if before != NOBODY else NOBODY
        if j != NOBODY and similarities[offset + j] >= least:
            match[i] = offset + j
            taken[j] = True
    for j in range(columns):
        column_of[places[1][first + j]] = NOBODY
    kept = taken.copy()
    for i in range(starts[0][t], starts[0][t + 1]):
        offset = starts[2][t] + (i - starts[0][t]) * columns
        if match[i] != NOBODY:
            continue
        for j in range(columns):
            if similarities[offset + j] >= least and not kept[j]:
                if match[i] != NOBODY or taken[j]:
                    return False
                match[i] = offset + j
                taken[j] = True
    return True


@compiled()
def _remember(t: int, starts: Three, places: Two, previous: np.ndarray, match: np.ndarray) -> None:
    columns = max(starts[1][t + 1] - starts[1][t], 1)
    previous[:] = NOBODY
    for i in range(starts[0][t], starts[0][t + 1]):
        if match[i] != NOBODY:
            column = (match[i] - starts[2][t]) % columns
            previous[places[0][i]] = places[1][starts[1][t] + column]


@compiled()
def _write_costs(t: int, starts: Three, places: Two, close: Close, memory: Two) -> None:
    similarities, there, least = close
    previous, costs = memory
    n, pair = 0, starts[2][t]
    for i in range(starts[0][t], starts[0][t + 1]):
        before = previous[places[0][i]]
        for j in range(starts[1][t], starts[1][t + 1]):
            if there[j]:
                bonus = CONTINUED if places[1][j] == before else 0.0
                far = similarities[pair] < least
                costs[n] = 0.0 if far else -(bonus + similarities[pair])
                n += 1
            pair += 1


@compiled()
def count_covered(
    starts: Three, places: Two, similarities: np.ndarray, threshold: float, together: np.ndarray
) -> None:
    """Add to (objects, tracks) the number of frames in which they reach the threshold."""
    for t in range(len(starts[0]) - 1):
        pair = starts[2][t]
        for i in range(starts[0][t], starts[0][t + 1]):
            for j in range(starts[1][t], starts[1][t + 1]):
                together[places[0][i], places[1][j]] += similarities[pair] >= threshold
                pair += 1


# --------------------------------------------------------------------------------------------------
# Which track follows which object, frame after frame.

EPSILON = float(np.finfo(float).eps)


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

    from roadscope.benchmarks.metrics.tracking.following import follow_on

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
