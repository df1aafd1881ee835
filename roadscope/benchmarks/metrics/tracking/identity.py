"""IDF1: the share of frames in which an object has one and the same track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence


@dataclass(frozen=True, slots=True)
class Identity:
    """Counts of the identity measures (Ristani et al. 2016); those of several sequences add up.

    All figures are 0 to 1, without a unit, higher is better; 0 without objects and tracks.

    hits: IDTP, object frames that are covered by the one track that the object is paired with.
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
        """IDTP / ((object frames + track frames) / 2): harmonic mean of `idp` and `idr`."""
        return self.hits / max((self.present + self.tracked) / 2, 1.0)

    @property
    def idr(self) -> float:
        """Identity recall, IDTP / object frames."""
        return self.hits / max(self.present, 1)

    @property
    def idp(self) -> float:
        """Identity precision, IDTP / track frames."""
        return self.hits / max(self.tracked, 1)


def identity(sequence: TrackedSequence, threshold: float = 0.5) -> Identity:
    """Return IDF1 and its parts (Ristani et al. 2016).

    Objects and tracks are paired once for the whole sequence, so that as many object frames as
    possible are covered. A pair covers the frames in which its similarity reaches the threshold.
    """
    from scipy.optimize import linear_sum_assignment

    _, rows, columns = sequence.places(np.flatnonzero(sequence.similarities >= threshold))
    shape = sequence.distinct_objects, sequence.distinct_tracks
    codes = sequence.truths[rows] * shape[1] + sequence.tracks[columns]
    covered = np.bincount(codes, minlength=shape[0] * shape[1]).reshape(shape)
    hits = covered[linear_sum_assignment(covered, maximize=True)].sum()
    return Identity(int(hits), len(sequence.truths), len(sequence.tracks))
