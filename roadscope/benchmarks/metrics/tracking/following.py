"""Which track follows which object, frame after frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

EPSILON = float(np.finfo(float).eps)
CONTINUED = 1000.0
"""Outweighs all similarities of a frame, so that what was matched stays so."""


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
    pairs = np.flatnonzero(sequence.similarities >= threshold - EPSILON)
    frames, rows, columns = sequence.places(pairs)
    objects, tracks = sequence.truths[rows], sequence.tracks[columns]
    if alive is not None:
        kept = alive[tracks]
        pairs, frames, rows = pairs[kept], frames[kept], rows[kept]
        columns, objects, tracks = columns[kept], objects[kept], tracks[kept]
    every = Following(pairs, frames, rows, columns, objects, tracks)
    there = np.ones(len(sequence.tracks), bool) if alive is None else alive[sequence.tracks]
    chosen = _matched(sequence, every, threshold, there)
    return Following(
        *(a[chosen] for a in (pairs, frames, rows, columns, objects, tracks)),
    )


def frames_with_both(sequence: TrackedSequence, there: np.ndarray) -> np.ndarray:
    """Return (T,) bool, frames with an object and a track; there: (Q,) bool, tracks that count."""
    sums = np.concatenate([[0], np.cumsum(there)])
    tracks = sums[sequence.track_starts[1:]] - sums[sequence.track_starts[:-1]]
    both: np.ndarray = (sequence.truth_counts > 0) & (tracks > 0)
    return both


def _matched(
    sequence: TrackedSequence, candidates: Following, threshold: float, there: np.ndarray
) -> np.ndarray:
    """Return which candidates are matched; kernel and solver take turns."""
    from roadscope.benchmarks.metrics.tracking.following_kernels import follow_on

    starts = np.searchsorted(candidates.frames, np.arange(len(sequence) + 1))
    previous = np.full(sequence.objects, -1)
    uses = np.zeros(sequence.objects + sequence.followers, np.uint8)
    memory = previous, uses, frames_with_both(sequence, there)
    matched = np.zeros(len(candidates.pairs), bool)
    places = candidates.objects, candidates.tracks
    matrices = sequence.matrices(sequence.similarities)
    frame = -1
    while (frame := follow_on(frame + 1, starts, places, memory, matched)) < len(sequence):
        part = slice(starts[frame], starts[frame + 1])
        objects = sequence.truths[sequence.truth_starts[frame] : sequence.truth_starts[frame + 1]]
        columns = slice(sequence.track_starts[frame], sequence.track_starts[frame + 1])
        continued = previous[objects][:, None] == sequence.tracks[columns]
        best = _best(matrices[frame], continued, threshold, there[columns])
        matched[part] = best[candidates.pairs[part] - sequence.pair_starts[frame]]
        previous[:] = -1
        chosen = np.flatnonzero(matched[part]) + starts[frame]
        previous[candidates.objects[chosen]] = candidates.tracks[chosen]
    return matched


def _best(
    similarity: np.ndarray, continued: np.ndarray, threshold: float, there: np.ndarray
) -> np.ndarray:
    """Return the best assignment of one frame, bool for each pair of its matrix, joined.

    continued: (M, N) bool, pairs of the frame before; there: (N,) bool, tracks that count.
    """
    from scipy.optimize import linear_sum_assignment

    value = CONTINUED * continued + similarity
    value[similarity < threshold - EPSILON] = 0
    best = np.zeros(similarity.shape, bool)
    columns = np.flatnonzero(there)
    row, column = linear_sum_assignment(-value[:, columns])
    best[row, columns[column]] = True
    return best.ravel()
