"""What is believed of velocities before a second detection: headings, usual speeds, neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Category
from roadscope.trackers.existence_kernels import ellipses
from roadscope.trackers.existence_targets import Measured, Targets
from roadscope.trackers.gating import FAMILIES
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.learned import Learned
from roadscope.trackers.rows import Rows

# Set by hand: lanes are 3 to 4 m wide, drivers in them keep within a few m/s of one another over
# the distance in which they can react to each other; the last two are round figures.
AHEAD_M, ASIDE_M = 40.0, 3.0
"""Over which road users move alike, standard deviations: along a lane, and from lane to lane."""
ALIKE_M_S = 2.0
"""Standard deviation between velocities of those who do."""
USUAL = 0.2
"""Weight of what is usual anywhere, a neighbour at no distance having 1."""
KNOWN_M_S = 2.0
"""Standard deviation beyond which a velocity says nothing of others."""


@dataclass(frozen=True, slots=True, eq=False)
class Neighbours(Rows):
    """Places (N, 2), velocities (N, 2) and families (N,) of those whose motion is known."""

    places: np.ndarray
    velocities: np.ndarray
    families: np.ndarray

    @staticmethod
    def of(targets: Targets, eye: np.ndarray, ego_velocity: np.ndarray | None) -> Neighbours:
        """Take those sure of their velocity, and the ego itself."""
        means, covariances = targets.beliefs.means, targets.beliefs.covariances
        spread = np.maximum(covariances[:, 2, 2], covariances[:, 3, 3])
        known = Neighbours(means[:, :2], means[:, 2:], FAMILIES[targets.categories])
        known = known.select((spread < KNOWN_M_S**2) & (targets.existence > 0))
        if ego_velocity is None:
            return known
        ego = FAMILIES[[Category.CAR]]
        return known.joined(Neighbours(eye[None], ego_velocity[None], ego))


def expected_velocities(new: Measured, known: Neighbours, traits: Learned) -> Gaussians:
    """Return (N, 2) means and (N, 2, 2) covariances for newcomers.

    A newcomer moves along its heading or, where the detector took rear for front, against it.
    Each neighbour is a guess at how fast, which counts for more in the same lane; the mixture of
    all guesses is told by its mean and its variance.
    """
    kinds, yaws = new.categories, new.boxes[:, 6]
    headings = np.column_stack([np.cos(yaws), np.sin(yaws)])
    front = traits.front[kinds]
    speeds, weights = _guesses(new, headings, known, front)
    usual, total = (2 * front - 1) * traits.cruise_m_s[kinds], USUAL + weights.sum(axis=1)
    mean = (USUAL * usual + (weights * speeds).sum(axis=1)) / total
    # The second moment of the usual speed is the same, whatever the mean.
    spread = USUAL * (traits.speed_m_s[kinds] ** 2 + mean**2 - 2 * usual * mean)
    spread += (weights * (ALIKE_M_S**2 + (speeds - mean[:, None]) ** 2)).sum(axis=1)
    along = np.sqrt(spread / total)
    skew = np.minimum(traits.yaw_rad[kinds] * new.growths, 1.0)
    across = np.hypot(traits.aside_m_s[kinds], skew * np.hypot(mean, along))
    return Gaussians(mean[:, None] * headings, ellipses(yaws, along, across))


def _guesses(
    new: Measured, headings: np.ndarray, known: Neighbours, front: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, M) speeds of neighbours along newcomers' headings, and their weights."""
    apart = known.places[None] - new.boxes[:, None, :2]
    speeds, sideways = _turned(np.broadcast_to(known.velocities, apart.shape), headings)
    ahead, aside = _turned(apart, headings)
    skew = sideways / (ALIKE_M_S + 0.2 * np.abs(speeds))
    weights = np.exp(-0.5 * ((ahead / AHEAD_M) ** 2 + (aside / ASIDE_M) ** 2 + skew**2))
    facing = np.where(speeds > 0, front[:, None], 1 - front[:, None])
    alike = FAMILIES[new.categories][:, None] == known.families
    return speeds, weights * alike * facing


def _turned(vectors: np.ndarray, headings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, M) components along and across (N, 2) headings of (N, M, 2) vectors."""
    c, s = headings[:, None, 0], headings[:, None, 1]
    return c * vectors[..., 0] + s * vectors[..., 1], c * vectors[..., 1] - s * vectors[..., 0]
