"""Whether those who are missed come back, counted while tracking."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadscope.trackers.existence_targets import Targets

# Round figures set by hand; the share that they begin with is learned.
WEIGHT = 10.0
"""Cases that what was learned counts for."""


SOON_S = 0.3
"""Within which a newcomer is to be seen again."""


@dataclass(slots=True)
class Shares:
    """How many of those believed in were seen again, and how many never.

    Detectors miss for many reasons and see many things that are none; how often is told best by
    how many of those missed, and of those seen once, are seen again.
    """

    seen_again: int = 0
    lost: int = 0

    def count(self, seen_again: np.ndarray, lost: np.ndarray) -> None:
        """Count (N,) and (M,) bool."""
        self.seen_again += int(seen_again.sum())
        self.lost += int(lost.sum())

    def lead(self, usual: np.ndarray) -> np.ndarray:
        """Return by how much likelier to be seen again they are than usual, log odds; (7,)."""
        again = self.seen_again + WEIGHT * usual
        lost = self.lost + WEIGHT * (1 - usual)
        lead: np.ndarray = np.log(again / lost) - np.log(usual / (1 - usual))
        return lead


@dataclass(slots=True)
class Returns:
    """`Shares` of runs of misses, and of those seen but once, who are to be seen again soon.

    Where there is much clutter, each of it meets some other sooner or later.
    """

    missed: Shares = field(default_factory=Shares)
    born: Shares = field(default_factory=Shares)

    def count(self, before: Targets, after: Targets, gone: np.ndarray) -> None:
        """Take the same targets a tick ago and now, and which of them are given up, (N,) bool."""
        seen = after.misses == 0
        missed, born = _missed(before), _born(before)
        self.missed.count(missed & seen, _missed(after) & gone)
        late = gone | (after.idle_s > SOON_S)
        self.born.count(born & seen, born & ~seen & late)


def _missed(targets: Targets) -> np.ndarray:
    told: np.ndarray = (targets.misses > 0) & (targets.assured > 0)
    return told


def _born(targets: Targets) -> np.ndarray:
    soon = targets.idle_s <= SOON_S
    told: np.ndarray = (targets.hits == 1) & (targets.claims > 0) & soon
    return told


def both(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return log odds that two independent things hold, each with (N,) log odds.

    p q / (1 - p q), both divided by p q: 1 / ((1 + 1/odds) (1 + 1/other odds) - 1).
    """
    a, b = np.exp(-one), np.exp(-other)
    found: np.ndarray = -np.log(a + b + a * b)
    return found
