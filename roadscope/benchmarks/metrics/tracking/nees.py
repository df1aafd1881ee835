"""NEES: whether tracks err as much as their covariances say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.states import StateErrors
from roadscope.core.record import Record

LEVEL = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Nees(Record):
    """Normalised estimation error squared (Bar-Shalom, Li and Kirubarajan 2001, ch. 5.4).

    values: (K,) squared Mahalanobis lengths of errors; of a consistent filter they have a
        chi-square distribution of `freedom` degrees of freedom.
    freedom: 2 for the position, 4 for position and velocity.
    """

    values: np.ndarray
    freedom: int

    def __len__(self) -> int:
        return len(self.values)

    @property
    def mean(self) -> float:
        """Mean, to be compared with `freedom`: above, tracks are too sure; nan without any."""
        return float(self.values.mean()) if len(self) else float("nan")

    @property
    def inside(self) -> float:
        """Share of values below the 95 % quantile: 0.95 when consistent; nan without any."""
        bound = chi_square(LEVEL, self.freedom)
        return float((self.values <= bound).mean()) if len(self) else float("nan")

    def band(self, level: float = LEVEL, independent: int | None = None) -> tuple[float, float]:
        """Return between what the mean of as many independent values lies so often.

        independent: how many of the values are; None: all of them. Errors of one track in
            successive frames are not: with the number of tracks the band is the widest possible.
        """
        return mean_band(len(self) if independent is None else independent, self.freedom, level)

    def in_band(self, tracks: int) -> bool:
        """Say whether the mean lies in its 95 % band, each of so many tracks taken for one value.

        False without any values.
        """
        low, high = self.band(independent=tracks)
        return low <= self.mean <= high


def nees(errors: StateErrors, *, velocity: bool = False) -> Nees:
    """Return NEES of positions or, with `velocity`, of positions and velocities.

    Pairs whose covariance is no covariance (singular, say, of a tracker that has none) have no
    NEES and are left out.
    """
    size = 4 if velocity else 2
    both = np.concatenate([errors.positions, errors.velocities], axis=1)[:, :size]
    covariances = errors.covariances[:, :size, :size]
    usable = (np.linalg.eigvalsh(covariances) > 0).all(axis=1)
    both, covariances = both[usable], covariances[usable]
    values = np.einsum("ki,ki->k", both, np.linalg.solve(covariances, both[..., None])[..., 0])
    return Nees(values, size)


def mean_band(independent: int, freedom: int, level: float = LEVEL) -> tuple[float, float]:
    """Return between what the mean NEES of so many independent errors lies so often."""
    n, tail = max(independent, 1), (1 - level) / 2
    whole = freedom * independent
    return chi_square(tail, whole) / n, chi_square(1 - tail, whole) / n


def chi_square(probability: float, freedom: int) -> float:
    """Return the quantile of the chi-square distribution; 0 without degrees of freedom."""
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(freedom / 2, probability)) if freedom else 0.0
