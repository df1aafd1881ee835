"""Whether those who are missed come back, counted while tracking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.trackers.existence_targets import Targets
from roadscope.trackers.learned import Learned

WEIGHT = 10.0
"""Runs of misses that what was learned counts for."""


@dataclass(slots=True)
class Returns:
    """Runs of misses of believed targets that ended: by a detection, or never.

    Detectors miss for many reasons, and how often they do so for no good one is told best by how
    many of those missed are seen again.
    """

    seen_again: int = 0
    lost: int = 0

    def came(self, targets: Targets) -> None:
        """Count those who are seen again, as they were before."""
        self.seen_again += int(((targets.misses > 0) & (targets.assured > 0)).sum())

    def gone(self, targets: Targets) -> None:
        """Count those who are given up."""
        self.lost += int(((targets.misses > 0) & (targets.assured > 0)).sum())

    def lead(self, traits: Learned) -> np.ndarray:
        """Return (7,) by how much likelier than in training a return is, log odds."""
        usual = traits.returned
        again = self.seen_again + WEIGHT * usual
        lost = self.lost + WEIGHT * (1 - usual)
        lead: np.ndarray = np.log(again / lost) - np.log(usual / (1 - usual))
        return lead


def both(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return log odds that two independent things hold, each with (N,) log odds.

    p q / (1 - p q), both divided by p q: 1 / ((1 + 1/odds) (1 + 1/other odds) - 1).
    """
    a, b = np.exp(-one), np.exp(-other)
    found: np.ndarray = -np.log(a + b + a * b)
    return found
