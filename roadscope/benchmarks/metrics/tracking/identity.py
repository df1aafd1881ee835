"""IDF1: how much of every object's life one and the same track covers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence


@dataclass(frozen=True, slots=True)
class Identity:
    """What the identity measures count (Ristani et al. 2016); several sequences add up.

    hits: object frames covered by the one track that the object is paired with.
    present, tracked: object frames and track frames.
    """

    hits: int
    present: int
    tracked: int

    def __add__(self, other: Identity) -> Identity:
        return Identity(
            self.hits + other.hits, self.present + other.present, self.tracked + other.tracked
        )

    @property
    def idf1(self) -> float:
        """Harmonic mean of precision and recall."""
        return self.hits / max((self.present + self.tracked) / 2, 1.0)

    @property
    def idr(self) -> float:
        """Identity recall."""
        return self.hits / max(self.present, 1)

    @property
    def idp(self) -> float:
        """Identity precision."""
        return self.hits / max(self.tracked, 1)


def identity(sequence: TrackedSequence, threshold: float = 0.5) -> Identity:
    """Return IDF1 and its parts (Ristani et al. 2016).

    Objects and tracks are paired once for the whole sequence, so that most object frames are
    covered. A frame is covered where the similarity of the pair reaches the threshold.
    """
    from scipy.optimize import linear_sum_assignment

    from roadscope.benchmarks.metrics.tracking.following_kernels import count_covered

    together = np.zeros((sequence.objects, sequence.followers))
    places = sequence.truths, sequence.tracks
    count_covered(sequence.starts, places, sequence.similarities, threshold, together)
    hits = together[linear_sum_assignment(together, maximize=True)].sum()
    return Identity(int(hits), len(sequence.truths), len(sequence.tracks))
