"""Matching of tracks with objects, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record
from roadscope.core.tables import ArrayTable

EPSILON = float(np.finfo(float).eps)
"""Tolerance for rounding: a similarity this little below the threshold still reaches it."""
CONTINUED = 1000.0
"""Added to the similarity of a pair that continues; more than all similarities of a frame."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackPairs(ArrayTable, Record):
    """K pairs of an object and a track of a sequence, in order of frames.

    pairs: (K,) int64, rows among all pairs of the sequence, ascending.
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

    @staticmethod
    def of(sequence: TrackedSequence, pairs: np.ndarray) -> TrackPairs:
        """Return (K,) pairs of a sequence, ascending, with their objects and tracks."""
        frames, rows, columns = sequence.places(pairs)
        return TrackPairs(
            pairs, frames, rows, columns, sequence.truths[rows], sequence.tracks[columns]
        )


def match_tracks(
    sequence: TrackedSequence, threshold: float = 0.5, alive: np.ndarray | None = None
) -> TrackPairs:
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
    least = max(threshold - EPSILON, EPSILON)
    candidates = TrackPairs.of(sequence, np.flatnonzero(sequence.similarities >= least))
    if alive is not None:
        candidates = candidates.select(takes_part[candidates.track_rows])
    similarities = sequence.similarities[candidates.pairs]
    previous = _previous_candidates(sequence, candidates, takes_part)
    # One more, not matched: the place to which -1, for no previous candidate, leads.
    matched = np.append(~_in_contest(sequence, candidates), False)
    for contest in contests(sequence, candidates, takes_part):
        continues = matched[previous[contest.candidates]]
        bonus = np.where(continues, CONTINUED, 0.0)
        matched[contest.candidates] = contest.assigned(-(bonus + similarities[contest.candidates]))
    return candidates.select(matched[:-1])


def frames_with_both(sequence: TrackedSequence, takes_part: np.ndarray) -> np.ndarray:
    """Return (T,) bool, frames with an object and a track that takes part, (Q,) bool."""
    both: np.ndarray = (sequence.truth_counts > 0) & (_track_counts(sequence, takes_part) > 0)
    return both


def _track_counts(sequence: TrackedSequence, takes_part: np.ndarray) -> np.ndarray:
    """Return (T,) numbers of tracks that take part, (Q,) bool."""
    sums = np.concatenate([[0], np.cumsum(takes_part)])
    counts: np.ndarray = sums[sequence.track_starts[1:]] - sums[sequence.track_starts[:-1]]
    return counts


def _previous_candidates(
    sequence: TrackedSequence, candidates: TrackPairs, takes_part: np.ndarray
) -> np.ndarray:
    """Return for each candidate that of the same object and track in the previous frame, or -1."""
    number = np.cumsum(frames_with_both(sequence, takes_part))[candidates.frames]
    codes = candidates.objects * sequence.distinct_tracks + candidates.tracks
    order = np.argsort(codes, kind="stable")
    codes, number = codes[order], number[order]
    previous = np.full(len(order), -1)
    continues = (codes[1:] == codes[:-1]) & (number[1:] == number[:-1] + 1)
    previous[order[1:][continues]] = order[:-1][continues]
    return previous


# --------------------------------------------------------------------------------------------------
# Contests: frames in which an object or a track has two candidates or more.


class Contest(NamedTuple):
    """The C candidates of a frame in which an object or a track has two or more.

    candidates: which of all candidates. shape: numbers of objects and tracks of the frame.
    rows, columns: (C,) object and track of each candidate, within the frame.
    """

    candidates: slice
    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray

    def assigned(self, costs: np.ndarray, other: float = 0.0) -> np.ndarray:
        """Return (C,) bool, the candidates of the one-to-one assignment of least total cost.

        costs: (C,) of the candidates. other: cost of all other pairs.
        """
        from scipy.optimize import linear_sum_assignment

        matrix = np.full(self.shape, other)
        matrix[self.rows, self.columns] = costs
        rows, columns = linear_sum_assignment(matrix)
        column_of = np.full(self.shape[0], -1)
        column_of[rows] = columns
        assigned: np.ndarray = column_of[self.rows] == self.columns
        return assigned


def contests(
    sequence: TrackedSequence, candidates: TrackPairs, takes_part: np.ndarray | None = None
) -> Iterator[Contest]:
    """Return the contests of a sequence, in order of frames.

    candidates: pairs that may be matched. takes_part: (Q,) bool, tracks that are counted in the
        shape of a frame; None: all.
    """
    if takes_part is None:
        takes_part = np.ones(len(sequence.tracks), bool)
    frames = np.unique(candidates.frames[_in_contest(sequence, candidates)])
    first = np.searchsorted(candidates.frames, frames, side="left").tolist()
    last = np.searchsorted(candidates.frames, frames, side="right").tolist()
    rows = candidates.truth_rows - sequence.truth_starts[candidates.frames]
    sums = np.concatenate([[0], np.cumsum(takes_part)])
    columns = sums[candidates.track_rows] - sums[sequence.track_starts[candidates.frames]]
    heights = sequence.truth_counts[frames].tolist()
    widths = _track_counts(sequence, takes_part)[frames].tolist()
    for a, b, height, width in zip(first, last, heights, widths, strict=True):
        yield Contest(slice(a, b), (height, width), rows[a:b], columns[a:b])


def assign_frames(
    sequence: TrackedSequence, candidates: TrackPairs, costs: np.ndarray, other: float = 0.0
) -> TrackPairs:
    """Return the candidates of the one-to-one assignment of least total cost in each frame.

    In a frame without a contest these are all candidates.

    costs: (C,) of the candidates. other: cost of all other pairs, not less than that of a
        candidate.
    """
    assigned = ~_in_contest(sequence, candidates)
    for contest in contests(sequence, candidates):
        assigned[contest.candidates] = contest.assigned(costs[contest.candidates], other)
    return candidates.select(assigned)


def _in_contest(sequence: TrackedSequence, candidates: TrackPairs) -> np.ndarray:
    """Return (C,) bool, candidates of frames in which an object or a track has two or more."""
    shared = np.bincount(candidates.truth_rows)[candidates.truth_rows] > 1
    shared |= np.bincount(candidates.track_rows)[candidates.track_rows] > 1
    in_contest = np.zeros(len(sequence), bool)
    in_contest[candidates.frames[shared]] = True
    candidates_in_contest: np.ndarray = in_contest[candidates.frames]
    return candidates_in_contest
