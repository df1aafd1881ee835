"""How far detections lie from where they are expected, counted while tracking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.trackers.existence_targets import Targets

# Round figures set by hand, but for the last: one right pair in 400 lies further off.
WEIGHT = 50.0
"""Cases that what was learned counts for."""
FOLLOWED = 5
"""Detections from which on a target's motion is known."""
FURTHEST = 12.0
"""Squared Mahalanobis distance beyond which a detection may well be another's."""


@dataclass(slots=True)
class Noise:
    """By how much squared errors of places are greater than what was learned of them.

    Of a filter whose noise is right, squared Mahalanobis distances of two dimensions are 2 in the
    mean; noise is taken to be most of them.
    """

    total: float = WEIGHT
    cases: float = WEIGHT

    @property
    def factor(self) -> float:
        """Of variances."""
        return self.total / self.cases

    def count(self, targets: Targets, distances: np.ndarray) -> None:
        """Take (N,) squared Mahalanobis distances of detections in targets, seen or missed so far.

        Only those surely there and long followed count.
        """
        sure = (targets.hits >= FOLLOWED) & (targets.misses <= 1) & (targets.existence > 0)
        told = np.minimum(distances[sure], FURTHEST)
        self.total += self.factor * float(told.sum()) / 2
        self.cases += len(told)
