"""Errors of tracks in position, velocity and heading, and whether their covariances fit them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import Tracks, Truth, wrap_angle
from roadscope.core.record import Record

MOVING_M_S = 1.0
"""Speed from which on an object moves; chosen by hand, labels of standing cars jump less."""
LEVEL = 0.95


class FrameRows(NamedTuple):
    """Rows of tracks and rows of objects of one frame: pairs, or those that count."""

    tracks: np.ndarray
    objects: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class StateErrors(Record):
    """Track less object for K matched pairs.

    positions: (K, 2) metres, x and y of the centre.
    velocities: (K, 2) m/s.
    headings: (K,) radians, -pi to pi; of objects that stand, -pi/2 to pi/2: modulo half a turn,
        because a box shows no front.
    moving: (K,) bool, whether the object moves, which shows its front.
    covariances: (K, 4, 4) of x, y and their velocities, as the tracks have them.
    """

    positions: np.ndarray
    velocities: np.ndarray
    headings: np.ndarray
    moving: np.ndarray
    covariances: np.ndarray

    def __len__(self) -> int:
        return len(self.headings)

    @property
    def reversed(self) -> np.ndarray:
        """(K,) bool, whether the object moves and the heading is off by more than a right angle."""
        reversed_: np.ndarray = self.moving & (np.abs(self.headings) > np.pi / 2)
        return reversed_


def state_errors(
    tracks: Sequence[Tracks], truths: Sequence[Truth], pairs: Sequence[FrameRows]
) -> StateErrors:
    """Return the errors of the matched pairs of T frames."""
    frames = list(zip(tracks, truths, pairs, strict=True))
    positions = [t.centres[p.tracks, :2] - g.centres[p.objects, :2] for t, g, p in frames]
    velocities = [t.velocities[p.tracks] - g.velocities[p.objects] for t, g, p in frames]
    differences = [t.yaws[p.tracks] - g.yaws[p.objects] for t, g, p in frames]
    turns = np.concatenate([np.empty(0), *differences])
    speeds = [np.hypot(*g.velocities[p.objects].T) for _, g, p in frames]
    moving = np.concatenate([np.empty(0), *speeds]) >= MOVING_M_S
    covariances = [t.covariances[p.tracks] for t, _, p in frames]
    return StateErrors(
        np.concatenate([np.empty((0, 2)), *positions]),
        np.concatenate([np.empty((0, 2)), *velocities]),
        np.where(moving, wrap_angle(turns), wrap_angle(2 * turns) / 2),
        moving,
        np.concatenate([np.empty((0, 4, 4)), *covariances]),
    )


# --------------------------------------------------------------------------------------------------
# NEES.


@dataclass(frozen=True, slots=True, eq=False)
class Nees(Record):
    """Normalised estimation error squared (Bar-Shalom, Li and Kirubarajan 2001, ch. 5.4).

    values: (K,) e' P^-1 e of errors e with covariance P, 0 and more, no unit; of a consistent
        filter they have a chi-square distribution of `freedom` degrees of freedom.
    freedom: 2 for the position, 4 for position and velocity.
    """

    values: np.ndarray
    freedom: int

    def __len__(self) -> int:
        return len(self.values)

    @property
    def mean(self) -> float:
        """Mean; `freedom` if consistent, more if covariances are too small; nan without a value."""
        return float(self.values.mean()) if len(self) else float("nan")

    @property
    def inside(self) -> float:
        """Share of values below the 95 % quantile: 0.95 if consistent; nan without a value."""
        bound = chi_square(LEVEL, self.freedom)
        return float((self.values <= bound).mean()) if len(self) else float("nan")

    def band(self, level: float = LEVEL, independent: int | None = None) -> tuple[float, float]:
        """Return the limits between which the mean of a consistent filter lies with a probability.

        level: probability, 0 to 1.
        independent: number of independent values; None: all are. Errors of one track in
            successive frames are not independent: with the number of tracks the band is the
            widest possible.
        """
        return mean_band(len(self) if independent is None else independent, self.freedom, level)

    def in_band(self, tracks: int) -> bool:
        """Return whether the mean lies in its 95 % band, with one independent value a track.

        False without a value.
        """
        low, high = self.band(independent=tracks)
        return low <= self.mean <= high


def nees(errors: StateErrors, *, velocity: bool = False) -> Nees:
    """Return NEES of positions or, with `velocity`, of positions and velocities.

    Pairs whose covariance is not positive definite (of a tracker that has none, say) are left out.
    """
    size = 4 if velocity else 2
    vectors = np.concatenate([errors.positions, errors.velocities], axis=1)[:, :size]
    covariances = errors.covariances[:, :size, :size]
    usable = (np.linalg.eigvalsh(covariances) > 0).all(axis=1)
    vectors, covariances = vectors[usable], covariances[usable]
    solved = np.linalg.solve(covariances, vectors[..., None])[..., 0]
    return Nees(np.einsum("ki,ki->k", vectors, solved), size)


def mean_band(independent: int, freedom: int, level: float = LEVEL) -> tuple[float, float]:
    """Return the limits between which the mean of independent NEES values lies with a probability.

    The sum of n values has a chi-square distribution of n `freedom` degrees of freedom. (0, 0)
    without a value.
    """
    n, tail = max(independent, 1), (1 - level) / 2
    freedom_of_sum = freedom * independent
    return chi_square(tail, freedom_of_sum) / n, chi_square(1 - tail, freedom_of_sum) / n


def chi_square(probability: float, freedom: int) -> float:
    """Return the quantile of the chi-square distribution; 0 without degrees of freedom."""
    # The quantile of scipy.stats is this one, but scipy.stats is slow to import.
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(freedom / 2, probability)) if freedom else 0.0
