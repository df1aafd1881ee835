"""How well the ranks of two boards agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

LEAST = 3
"""Two entries always agree or disagree in full."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of two boards.

    rho: Spearman's rank correlation, -1 to 1.
    entries: those on both boards, in the order of the first.
    """

    rho: float
    entries: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BoardAgreement:
    """Agreement of a board with the tracking board of a suite.

    board: of recorded data.
    suite: of simulated traffic, with its version.
    rho, entries: as in `Agreement`.
    """

    board: str
    suite: str
    rho: float
    entries: tuple[str, ...]


def agreement(ones: Mapping[str, float], others: Mapping[str, float]) -> Agreement | None:
    """Compare figures of entries by rank; None with fewer than three on both boards.

    Entries without a figure, NaN, are left out; so is a comparison in which all are alike.
    """
    both = [e for e in ones if e in others and np.isfinite([ones[e], others[e]]).all()]
    if len(both) < LEAST:
        return None
    rho = spearman([ones[e] for e in both], [others[e] for e in both])
    return Agreement(rho, tuple(both)) if np.isfinite(rho) else None


def spearman(ones: Sequence[float], others: Sequence[float]) -> float:
    """Return Spearman's rank correlation; equal values share the mean of their ranks.

    NaN where one side does not tell its values apart.
    """
    if len(ones) != len(others):
        raise ValueError(f"as many values on both sides expected, got {len(ones)}, {len(others)}")
    x, y = (_ranks(np.asarray(values, np.float64)) for values in (ones, others))
    x, y = x - x.mean(), y - y.mean()
    spread = float(np.sqrt((x * x).sum() * (y * y).sum()))
    return float((x * y).sum() / spread) if spread else float("nan")


def _ranks(values: np.ndarray) -> np.ndarray:
    """Return (N,) ranks from 1, means of ranks where values are equal."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    ranks: np.ndarray = (ends - (counts - 1) / 2)[which]
    return ranks
