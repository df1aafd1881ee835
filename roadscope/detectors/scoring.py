"""The probability that a detection is right, from what the scan says of its box.

An additive logistic model: every feature adds log odds that run straight between a few knots, so
that each can be read and drawn by itself. The weights lie in `score_weights` and are fitted by
`roadscope.benchmarks.fit.scores`, which anyone can run again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.evidence import FEATURES, features
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.recognition import Vehicle

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Knots, increasing, and the log odds at each; beyond the ends the curve goes on level."""


@dataclass(frozen=True, slots=True)
class ScoreModel:
    """Log odds that a detection is right: a constant and one curve a feature.

    names: of the features, in their order.
    """

    constant: float
    curves: Mapping[str, Curve]
    names: Sequence[str] = FEATURES

    def probabilities(self, values: np.ndarray) -> np.ndarray:
        """Return (B,) probabilities in (0, 1) for (B, F) features."""
        odds = np.full(len(values), self.constant)
        for column, name in enumerate(self.names):
            if name in self.curves:
                odds += np.interp(values[:, column], *self.curves[name])
        result: np.ndarray = 1 / (1 + np.exp(-np.clip(odds, -30, 30)))
        return result


def scores(
    vehicles: Sequence[Vehicle], cloud: Cloud, horizon: Horizon, height_m: float
) -> np.ndarray:
    """Return (B,) probabilities that vehicles are road users within 2 m of where they are said.

    cloud: the whole scan; height_m: of the sensor above the ground.
    """
    return shipped_model().probabilities(features(vehicles, cloud, horizon, height_m))


@cache
def shipped_model() -> ScoreModel:
    """Return the model with the weights that ship with the package."""
    from roadscope.detectors.score_weights import CONSTANT, CURVES

    return ScoreModel(CONSTANT, CURVES)
