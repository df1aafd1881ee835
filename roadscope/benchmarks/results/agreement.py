"""The agreement of ranks on two boards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

LEAST_ENTRIES = 3
"""Least number of entries that are compared: two can only agree or disagree completely."""
NORMAL_95 = 1.959964
"""The 97.5 % quantile of the standard normal distribution."""


@dataclass(frozen=True, slots=True)
class BoardAgreement:
    """Agreement of the ranks on a board with those on a suite.

    board: of recorded data.
    suite: of simulated traffic, with its version.
    rho: Spearman's rank correlation, -1 to 1.
    entries: those on both boards, in the order of the suite.
    """

    board: str
    suite: str
    rho: float
    entries: tuple[str, ...]

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of rho over entries (Bonett and Wright 2000).

        None with three entries, or if all ranks agree or all are reversed: nothing varies then.
        """
        count = len(self.entries)
        if count <= LEAST_ENTRIES or abs(self.rho) > 1 - 1e-9:
            return None
        spread = NORMAL_95 * np.sqrt((1 + self.rho**2 / 2) / (count - 3))
        low, high = np.tanh(np.arctanh(self.rho) + np.array([-spread, spread]))
        return float(low), float(high)

    @staticmethod
    def of(
        board: str, suite: str, recorded: Mapping[str, float], simulated: Mapping[str, float]
    ) -> BoardAgreement | None:
        """Return the rank correlation of entries; None with fewer than three on both boards.

        Entries without a figure (NaN) are left out. None also if all figures of a board are equal.
        """
        both = [
            entry
            for entry, figure in simulated.items()
            if np.isfinite([figure, recorded.get(entry, np.nan)]).all()
        ]
        if len(both) < LEAST_ENTRIES:
            return None
        rho = spearman([simulated[entry] for entry in both], [recorded[entry] for entry in both])
        return BoardAgreement(board, suite, rho, tuple(both)) if np.isfinite(rho) else None


def spearman(ones: Sequence[float], others: Sequence[float]) -> float:
    """Return Spearman's rank correlation; NaN if all values of one side are equal."""
    from scipy.stats import spearmanr

    if min(len(set(ones)), len(set(others))) < 2:
        return float("nan")
    return float(spearmanr(ones, others).statistic)
