"""CLEAR MOT: accuracy and precision of matches that continue from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from roadscope.benchmarks.metrics.tracking.matching import (
    TrackPairs,
    frames_with_both,
    match_tracks,
)
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence

MOSTLY_TRACKED = 0.8
MOSTLY_LOST = 0.2
"""Shares of an object's frames (Li, Huang and Nevatia 2009)."""


@dataclass(frozen=True, slots=True)
class Clear:
    """Counts of CLEAR MOT (Bernardin and Stiefelhagen 2008); those of several sequences add up.

    matches, misses: TP and FN, object frames. false_alarms: FP, track frames.
    closeness: sum of similarities of the matches.
    id_switches: an object is matched with another track than when it was last matched.
    wrong_associations: a track is matched with another object than when it was last matched.
    fragmentations: an object is matched again after at least one frame in which it was not,
        whether it was missed or absent.
    objects: number of all, of which mostly_tracked are matched in over 80 % of their frames,
        mostly_lost in under 20 %, partially_tracked in between.
    """

    matches: int
    misses: int
    false_alarms: int
    closeness: float
    id_switches: int
    wrong_associations: int
    fragmentations: int
    objects: int
    mostly_tracked: int
    partially_tracked: int
    mostly_lost: int

    def __add__(self, other: Clear) -> Clear:
        return Clear(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def present(self) -> int:
        """Object frames, TP + FN."""
        return self.matches + self.misses

    @property
    def mota(self) -> float:
        """1 - (FN + FP + ID switches) / object frames; at most 1, may be negative.

        0 without objects.
        """
        right = self.matches - self.false_alarms - self.id_switches
        return right / self.present if self.present else 0.0

    @property
    def motp(self) -> float:
        """Mean similarity of matches, 0 to 1; 0 without a match."""
        return self.closeness / max(self.matches, 1)

    @property
    def recall(self) -> float:
        """TP / (TP + FN), 0 to 1; 0 without objects."""
        return self.matches / max(self.present, 1)

    @property
    def precision(self) -> float:
        """TP / (TP + FP), 0 to 1; 0 without tracks."""
        return self.matches / max(self.matches + self.false_alarms, 1)


def clear(sequence: TrackedSequence, threshold: float = 0.5) -> Clear:
    """Return the counts of CLEAR MOT of a sequence (Bernardin and Stiefelhagen 2008).

    threshold: similarity, 0 to 1, from which on a pair can be matched.
    """
    return count_matches(sequence, match_tracks(sequence, threshold))


def count_matches(
    sequence: TrackedSequence, matched: TrackPairs, alive: np.ndarray | None = None
) -> Clear:
    """Return the counts of matched pairs.

    alive: (distinct tracks,) bool, tracks that take part; None: all.
    """
    takes_part = np.ones(len(sequence.tracks), bool) if alive is None else alive[sequence.tracks]
    matches = len(matched.pairs)
    frames = np.bincount(sequence.truths, minlength=sequence.distinct_objects)
    share = np.bincount(matched.objects, minlength=sequence.distinct_objects) / frames
    mostly_tracked = int((share > MOSTLY_TRACKED).sum())
    mostly_lost = int((share < MOSTLY_LOST).sum())
    return Clear(
        matches=matches,
        misses=len(sequence.truths) - matches,
        false_alarms=int(takes_part.sum()) - matches,
        closeness=float(sequence.similarities[matched.pairs].sum()),
        id_switches=int(switched(matched.objects, matched.tracks).sum()),
        wrong_associations=int(switched(matched.tracks, matched.objects).sum()),
        fragmentations=_fragmentations(matched, frames_with_both(sequence, takes_part)),
        objects=sequence.distinct_objects,
        mostly_tracked=mostly_tracked,
        partially_tracked=sequence.distinct_objects - mostly_tracked - mostly_lost,
        mostly_lost=mostly_lost,
    )


def switched(ids: np.ndarray, partners: np.ndarray) -> np.ndarray:
    """Return (K,) bool, pairs whose id had another partner in its last pair.

    ids, partners: (K,) int of pairs in order of frames.
    """
    order = np.argsort(ids, kind="stable")
    ids, partners = ids[order], partners[order]
    switches = np.zeros(len(order), bool)
    switches[order[1:]] = (ids[1:] == ids[:-1]) & (partners[1:] != partners[:-1])
    return switches


def _fragmentations(matched: TrackPairs, both: np.ndarray) -> int:
    """Count interruptions of matches; both: (T,) bool, frames that have objects and tracks."""
    order = np.argsort(matched.objects, kind="stable")
    objects, frames = matched.objects[order], np.cumsum(both)[matched.frames[order]]
    return int(((objects[1:] == objects[:-1]) & (np.diff(frames) > 1)).sum())
