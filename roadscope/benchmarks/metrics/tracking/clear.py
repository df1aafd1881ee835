"""CLEAR MOT: matches carried on from frame to frame, and what breaks them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from roadscope.benchmarks.metrics.tracking.following import Following, follow, frames_with_both
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence

MOSTLY_TRACKED = 0.8
MOSTLY_LOST = 0.2


@dataclass(frozen=True, slots=True)
class Clear:
    """What CLEAR MOT counts; the counts of several sequences add up.

    matches, misses, false_alarms: object frames and track frames.
    closeness: sum of similarities of the matches.
    id_switches: an object is followed by another track than when last matched.
    wrong_associations: a track follows another object than when last matched.
    fragmentations: an object is followed again after at least one frame in which it was not,
        be it missed or not there.
    objects: all of them, of which mostly_tracked are followed in over 80 % of their frames,
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
        """Object frames."""
        return self.matches + self.misses

    @property
    def mota(self) -> float:
        """1 less misses, false alarms and ID switches over object frames; may be negative.

        0 without objects.
        """
        right = self.matches - self.false_alarms - self.id_switches
        return right / self.present if self.present else 0.0

    @property
    def motp(self) -> float:
        """Mean similarity of matches."""
        return self.closeness / max(self.matches, 1)

    @property
    def recall(self) -> float:
        """Matches over object frames."""
        return self.matches / max(self.present, 1)

    @property
    def precision(self) -> float:
        """Matches over track frames."""
        return self.matches / max(self.matches + self.false_alarms, 1)


def clear(sequence: TrackedSequence, threshold: float = 0.5) -> Clear:
    """Return CLEAR MOT's counts of a sequence (Bernardin and Stiefelhagen 2008).

    threshold: similarity, 0 to 1, from which on a pair can be matched.
    """
    return count(sequence, follow(sequence, threshold))


def count(
    sequence: TrackedSequence, following: Following, alive: np.ndarray | None = None
) -> Clear:
    """Count what is matched; alive: (tracks,) bool, those that are there at all."""
    there = np.ones(len(sequence.tracks), bool) if alive is None else alive[sequence.tracks]
    matches = len(following.pairs)
    lived = np.bincount(sequence.truths, minlength=sequence.objects)
    share = np.bincount(following.objects, minlength=sequence.objects) / lived
    mostly, barely = int((share > MOSTLY_TRACKED).sum()), int((share < MOSTLY_LOST).sum())
    return Clear(
        matches=matches,
        misses=len(sequence.truths) - matches,
        false_alarms=int(there.sum()) - matches,
        closeness=float(sequence.similarities[following.pairs].sum()),
        id_switches=int(changed(following.objects, following.tracks).sum()),
        wrong_associations=int(changed(following.tracks, following.objects).sum()),
        fragmentations=_interruptions(following, frames_with_both(sequence, there)),
        objects=sequence.objects,
        mostly_tracked=mostly,
        partially_tracked=sequence.objects - mostly - barely,
        mostly_lost=barely,
    )


def changed(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (K,) bool, pairs in order of time in which one has gone over to another other."""
    order = np.argsort(ones, kind="stable")
    ones, others = ones[order], others[order]
    over = np.zeros(len(order), bool)
    over[order[1:]] = (ones[1:] == ones[:-1]) & (others[1:] != others[:-1])
    return over


def _interruptions(following: Following, both: np.ndarray) -> int:
    order = np.argsort(following.objects, kind="stable")
    objects, frames = following.objects[order], np.cumsum(both)[following.frames[order]]
    return int(((objects[1:] == objects[:-1]) & (np.diff(frames) > 1)).sum())
