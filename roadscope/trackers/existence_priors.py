"""What is believed of velocities before a second detection: headings, usual speeds, neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
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
    told, drawn, squared = _guessed(
        new.boxes, FAMILIES[kinds], front, known.places, known.velocities, known.families
    ).T
    usual, total = (2 * front - 1) * traits.cruise_m_s[kinds], USUAL + told
    mean = (USUAL * usual + drawn) / total
    # The second moment of the usual speed is the same, whatever the mean.
    spread = USUAL * (traits.speed_m_s[kinds] ** 2 + mean**2 - 2 * usual * mean)
    spread += told * (ALIKE_M_S**2 + mean**2) + squared - 2 * mean * drawn
    along = np.sqrt(spread / total)
    skew = np.minimum(traits.yaw_rad[kinds] * new.growths, 1.0)
    across = np.hypot(traits.aside_m_s[kinds], skew * np.hypot(mean, along))
    return Gaussians(mean[:, None] * headings, ellipses(yaws, along, across))


@compiled()
def _guessed(
    boxes: np.ndarray,
    families: np.ndarray,
    front: np.ndarray,
    places: np.ndarray,
    velocities: np.ndarray,
    others: np.ndarray,
) -> np.ndarray:
    """Return (N, 3) sums over neighbours of weights, and of these times speeds and their squares.

    Speeds are those along newcomers' headings; others: (M,) families of neighbours.
    """
    sums = np.zeros((len(boxes), 3))
    for i in range(len(boxes)):
        c, s = np.cos(boxes[i, 6]), np.sin(boxes[i, 6])
        for j in range(len(places)):
            if families[i] != others[j]:
                continue
            dx, dy = places[j, 0] - boxes[i, 0], places[j, 1] - boxes[i, 1]
            speed = c * velocities[j, 0] + s * velocities[j, 1]
            skew = c * velocities[j, 1] - s * velocities[j, 0]
            skew /= ALIKE_M_S + 0.2 * abs(speed)
            ahead, aside = (c * dx + s * dy) / AHEAD_M, (c * dy - s * dx) / ASIDE_M
            weight = np.exp(-0.5 * (ahead**2 + aside**2 + skew**2))
            weight *= front[i] if speed > 0 else 1 - front[i]
            sums[i, 0] += weight
            sums[i, 1] += weight * speed
            sums[i, 2] += weight * speed**2
    return sums
