"""Recovery after occlusion: whether an object keeps its track while it is hidden."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.tracking.matching import TrackPairs
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

NEVER = -1
NO_TRACK = -1


@dataclass(frozen=True, slots=True, eq=False)
class Recovery(Record):
    """What followed on G gaps: times in which an object that had a track was hidden.

    hidden_frames: (G,) int64, length of the gap.
    same_track: (G,) bool, the first track that is matched with the object again is the last one
        from before the gap.
    delays: (G,) int64, frames from the object's return until it is matched with any track: 0 at
        once, `NEVER` if it is not before it is hidden again.
    """

    hidden_frames: np.ndarray
    same_track: np.ndarray
    delays: np.ndarray

    def __len__(self) -> int:
        return len(self.hidden_frames)

    @property
    def reassociated(self) -> np.ndarray:
        """(G,) bool, gaps after which the object was matched again."""
        reassociated: np.ndarray = self.delays != NEVER
        return reassociated


def recovery(sequence: TrackedSequence, matched: TrackPairs) -> Recovery:
    """Return all gaps of all objects that were matched before.

    The sequence holds the visible objects: one that leaves it and comes back was hidden, or out
    of range.
    """
    frames = np.repeat(np.arange(len(sequence)), sequence.truth_counts)
    tracks = np.full(len(frames), NO_TRACK)
    tracks[matched.truth_rows] = matched.tracks
    by_object = np.argsort(sequence.truths, kind="stable")
    lives = np.split(by_object, np.flatnonzero(np.diff(sequence.truths[by_object])) + 1)
    gaps = [gap for rows in lives if len(rows) for gap in _gaps(frames[rows], tracks[rows])]
    return Recovery(
        np.array([gap.hidden_frames for gap in gaps], np.int64),
        np.array([gap.same_track for gap in gaps], bool),
        np.array([gap.delay for gap in gaps], np.int64),
    )


class _Gap(NamedTuple):
    hidden_frames: int
    same_track: bool
    delay: int


def _gaps(frames: np.ndarray, tracks: np.ndarray) -> list[_Gap]:
    """Return the gaps of one object; (F,) its frames and its track in each, or `NO_TRACK`."""
    gaps = []
    returns = [*(np.flatnonzero(np.diff(frames) > 1) + 1).tolist(), len(frames)]
    for start, end in pairwise(returns):
        before = tracks[:start][tracks[:start] != NO_TRACK]
        if not len(before):
            continue
        hidden_frames = int(frames[start] - frames[start - 1]) - 1
        after = np.flatnonzero(tracks[start:end] != NO_TRACK)
        if not len(after):
            gaps.append(_Gap(hidden_frames, False, NEVER))
            continue
        row = start + after[0]
        delay = int(frames[row] - frames[start])
        gaps.append(_Gap(hidden_frames, bool(tracks[row] == before[-1]), delay))
    return gaps
