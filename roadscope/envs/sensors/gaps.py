"""Which measurements of a sensor are lost, in bursts, whatever order they are asked for in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

PAGE = 1024
"""Draws that are made at once."""
BEFORE = 1 << 12
"""Bursts may have begun before the first measurement; longer ones there are none."""


@dataclass(frozen=True, slots=True)
class Gaps:
    """Bursts that begin by chance at any measurement; more severe ones hold the milder ones.

    start: chance that a burst begins. length: measurements that it takes.
    seed: of the draws, which do not depend on the two.
    """

    start: float
    length: int
    seed: int

    @staticmethod
    def of(shares: Sequence[float], lengths: Sequence[int], seed: int) -> Gaps:
        """Make the last of a ladder of shares that are lost in bursts of some length.

        A burst covers a measurement with chance 1 - (1 - start)^length. That no step of the
        ladder undoes what an earlier one took, chances and lengths never fall along it.
        """
        starts = [1 - (1 - p) ** (1 / n) for p, n in zip(shares, lengths, strict=True)]
        return Gaps(max(starts), max(lengths), seed)

    def hit(self, index: int) -> int | None:
        """Return where the burst that covers a measurement began, the first if several do."""
        for begin in range(index - self.length + 1, index + 1):
            page, place = divmod(begin + BEFORE, PAGE)
            if page >= 0 and _draws(self.seed, page)[place] < self.start:
                return begin
        return None


@lru_cache(maxsize=64)
def _draws(seed: int, page: int) -> np.ndarray:
    return np.random.default_rng([seed, page]).random(PAGE)
