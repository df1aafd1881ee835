"""Recovery after occlusion: whether an object keeps its track while it cannot be seen."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.benchmarks.metrics.tracking.following import Following
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

NEVER = -1


@dataclass(frozen=True, slots=True, eq=False)
class Recovery(Record):
    """What became of G gaps, times in which an object that had a track was not to be followed.

    hidden: (G,) int64, how many frames the gap has.
    kept: (G,) bool, the first track that follows the object again is the one it had.
    delays: (G,) int64, frames from the object's return until a track follows it: 0 at once,
        `NEVER` when none does before it is hidden again.
    """

    hidden: np.ndarray
    kept: np.ndarray
    delays: np.ndarray

    def __len__(self) -> int:
        return len(self.hidden)

    @property
    def found(self) -> np.ndarray:
        """(G,) bool, gaps after which the object was followed again."""
        again: np.ndarray = self.delays != NEVER
        return again


def recovery(sequence: TrackedSequence, following: Following) -> Recovery:
    """Look at every gap in the life of every object that was followed before.

    The sequence holds the objects that could be seen: whoever leaves it and comes back was
    hidden, or out of range.
    """
    frames = np.repeat(np.arange(len(sequence)), sequence.truth_counts)
    track = np.full(len(frames), NEVER)
    track[following.rows] = following.tracks
    order = np.argsort(sequence.truths, kind="stable")
    lives = np.split(order, np.flatnonzero(np.diff(sequence.truths[order])) + 1)
    gaps = [gap for life in lives if len(life) for gap in _gaps(frames[life], track[life])]
    table = np.array(gaps, np.int64).reshape(-1, 3)
    return Recovery(table[:, 0], table[:, 1].astype(bool), table[:, 2])


def _gaps(frames: np.ndarray, tracks: np.ndarray) -> list[tuple[int, bool, int]]:
    """Return length, kept and delay of the gaps in one object's frames, if it had a track."""
    found = []
    returns = [*(np.flatnonzero(np.diff(frames) > 1) + 1).tolist(), len(frames)]
    for start, end in pairwise(returns):
        before = tracks[:start][tracks[:start] != NEVER]
        if not len(before):
            continue
        after = np.flatnonzero(tracks[start:end] != NEVER)
        hidden = int(frames[start] - frames[start - 1]) - 1
        if not len(after):
            found.append((hidden, False, NEVER))
            continue
        again = start + after[0]
        delay = int(frames[again] - frames[start])
        found.append((hidden, bool(tracks[again] == before[-1]), delay))
    return found
