"""The probability that a box is right, from its traits."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.detectors.camera.decoding import TRAITS

FAMILY_COUNT = 3
FARTHEST = 4.0
"""Traits are clipped to so many standard deviations from their mean."""
TERM_COUNT = 1 + len(TRAITS) + len(TRAITS) * (len(TRAITS) + 1) // 2
"""A constant, the traits, and the products of any two of them."""


def _heat_alone() -> np.ndarray:
    weights = np.zeros((FAMILY_COUNT, TERM_COUNT))
    weights[:, 1] = 1.0
    return weights


@dataclass(frozen=True, slots=True, eq=False)
class BoxCalibration(Record):
    """A logistic model (Platt 1999) for each family, of traits and products of two of them.

    By default the probability is that of the heat alone, with log odds from -4 to 4.

    middles, spreads: (9,) mean and standard deviation of each trait.
    weights: (3, 55) of the `terms` of traits, for vehicles, cyclists and pedestrians.
    """

    middles: np.ndarray = field(default_factory=lambda: np.zeros(len(TRAITS)))
    spreads: np.ndarray = field(default_factory=lambda: np.ones(len(TRAITS)))
    weights: np.ndarray = field(default_factory=_heat_alone)

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            middles=(np.float64, (len(TRAITS),)),
            spreads=(np.float64, (len(TRAITS),)),
            weights=(np.float64, (FAMILY_COUNT, TERM_COUNT)),
        )
        finite = all(np.isfinite(x).all() for x in (self.middles, self.spreads, self.weights))
        if not finite or self.spreads.min() <= 0:
            raise ValueError("a calibration has finite numbers, and spreads above 0")

    def scores(self, traits: np.ndarray, families: np.ndarray) -> np.ndarray:
        """Return the (N,) probabilities that boxes with (N, 9) traits are right."""
        log_odds = (self.terms(traits) * self.weights[families]).sum(axis=1)
        scores: np.ndarray = 1 / (1 + np.exp(-np.clip(log_odds, -40, 40)))
        return scores

    def terms(self, traits: np.ndarray) -> np.ndarray:
        """Return (N, 55) terms: 1, the normalised traits, and products of any two of them."""
        normalised = np.clip((traits - self.middles) / self.spreads, -FARTHEST, FARTHEST)
        first, second = np.triu_indices(len(TRAITS))
        one = np.ones((len(traits), 1))
        products = normalised[:, first] * normalised[:, second]
        return np.concatenate([one, normalised, products], axis=1)
