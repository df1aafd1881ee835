"""Matching of tracks with objects, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

EPSILON = float(np.finfo(float).eps)
"""A similarity reaches a threshold that is above it by no more than a rounding error."""
CONTINUED = 1000.0
"""Added to the similarity of a pair that continues; more than all similarities of a frame."""
NO_TRACK = -1


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPairs(Record):
    """The K matched pairs of a sequence, in order of frames.

    pairs: (K,) int64, rows among all pairs of the sequence.
    frames: (K,) int64.
    truth_rows, track_rows: (K,) int64, rows among all objects and all tracks of the sequence.
    objects, tracks: (K,) int64, their numbers (`truths` and `tracks` of the sequence).
    """

    pairs: np.ndarray
    frames: np.ndarray
    truth_rows: np.ndarray
    track_rows: np.ndarray
    objects: np.ndarray
    tracks: np.ndarray


def match_tracks(
    sequence: TrackedSequence, threshold: float = 0.5, alive: np.ndarray | None = None
) -> MatchedPairs:
    """Return the pairs that CLEAR MOT matches (Bernardin and Stiefelhagen 2008, section 2.1).

    A pair of the previous frame continues while its similarity reaches the threshold; the rest is
    assigned for the greatest total similarity. Frames without an object or without a track are
    skipped: the previous frame is the one before them.

    threshold: above 0, up to 1.
    alive: (distinct tracks,) bool, tracks that take part; None: all.
    """
    if not 0 < threshold <= 1:
        raise ValueError(f"threshold: expected above 0 and up to 1, got {threshold:g}")
    takes_part = np.ones(len(sequence.tracks), bool) if alive is None else alive[sequence.tracks]
    possible = np.flatnonzero(sequence.similarities >= threshold - EPSILON)
    _, _, columns = sequence.places(possible)
    settled, contested = split_contested(sequence, possible[takes_part[columns]])
    _, rows, columns = sequence.places(settled)
    track_rows = np.full(len(sequence.truths), NO_TRACK)
    track_rows[rows] = columns
    previous_frames = _previous_frames(frames_with_both(sequence, takes_part))
    matrices, chosen = sequence.matrices(sequence.similarities), [settled]
    for frame in contested:
        first, last = sequence.truth_starts[frame : frame + 2]
        start, end = sequence.track_starts[frame : frame + 2]
        columns = np.flatnonzero(takes_part[start:end])
        previous = _tracks_of_objects(sequence, track_rows, previous_frames[frame])
        continued = previous[sequence.truths[first:last], None] == sequence.tracks[start + columns]
        row, column = _assign(matrices[frame][:, columns], continued, threshold - EPSILON)
        track_rows[first + row] = start + columns[column]
        chosen.append(pairs_of_frame(sequence, frame, row, columns[column]))
    pairs = np.sort(np.concatenate(chosen))
    frames, rows, columns = sequence.places(pairs)
    return MatchedPairs(
        pairs, frames, rows, columns, sequence.truths[rows], sequence.tracks[columns]
    )


def _tracks_of_objects(sequence: TrackedSequence, track_rows: np.ndarray, frame: int) -> np.ndarray:
    """Return (distinct objects,) the track that each object is matched with in a frame.

    `NO_TRACK` where there is none. track_rows: (P,) of each object row. frame: -1 for no frame.
    """
    tracks = np.full(sequence.distinct_objects, NO_TRACK)
    if frame >= 0:
        rows = np.arange(*sequence.truth_starts[frame : frame + 2])
        rows = rows[track_rows[rows] != NO_TRACK]
        tracks[sequence.truths[rows]] = sequence.tracks[track_rows[rows]]
    return tracks


def _assign(
    similarities: np.ndarray, continued: np.ndarray, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the assignment of greatest total similarity.

    similarities: (M, N); only those of at least `least` are possible.
    continued: (M, N) bool, pairs that were matched in the previous frame; they come first.
    """
    from scipy.optimize import linear_sum_assignment

    cost = np.where(
        similarities < least, 0.0, -(np.where(continued, CONTINUED, 0.0) + similarities)
    )
    row, column = linear_sum_assignment(cost)
    possible = cost[row, column] < -EPSILON
    return row[possible], column[possible]


def split_contested(
    sequence: TrackedSequence, candidates: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """Return the candidates of frames without a contest, and the frames with one.

    In a contest an object or a track has two candidates or more, so an assignment must be
    computed. Without one, it is all candidates of the frame.

    candidates: (C,) int64, pairs of the sequence that may be matched.
    """
    frames, rows, columns = sequence.places(candidates)
    shared = (np.bincount(rows)[rows] > 1) | (np.bincount(columns)[columns] > 1)
    contested = np.zeros(len(sequence), bool)
    contested[frames[shared]] = True
    return candidates[~contested[frames]], np.flatnonzero(contested).tolist()


def pairs_of_frame(
    sequence: TrackedSequence, frame: int, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Return the pairs of a frame's (K,) rows of objects and columns of tracks."""
    pairs: np.ndarray = sequence.pair_starts[frame] + rows * sequence.track_counts[frame] + columns
    return pairs


def frames_with_both(sequence: TrackedSequence, takes_part: np.ndarray) -> np.ndarray:
    """Return (T,) bool, frames with an object and a track that takes part, (Q,) bool."""
    sums = np.concatenate([[0], np.cumsum(takes_part)])
    tracks = sums[sequence.track_starts[1:]] - sums[sequence.track_starts[:-1]]
    both: np.ndarray = (sequence.truth_counts > 0) & (tracks > 0)
    return both


def _previous_frames(both: np.ndarray) -> list[int]:
    """Return for each of T frames the last one before it that is True in (T,) bool, or -1."""
    latest = np.maximum.accumulate(np.where(both, np.arange(len(both)), -1))
    previous: list[int] = np.concatenate([[-1], latest])[: len(both)].tolist()
    return previous
