"""The probability that a detection is right, from features of its box in the scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.evidence import FEATURES, features
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.recognition import Vehicle

# --------------------------------------------------------------------------------------------------
# Weights of the score model: constant, and for every feature its knots and log odds. They were
# fitted by `research.detector_scores clusters` of the repository.

CONSTANT = -10.312
CURVES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "log_returns": (
        (1.099, 3.045, 3.951, 4.883, 5.841, 6.667, 8.641),
        (-10.003, -3.558, -2.101, 0.129, 2.354, 4.602, 8.578),
    ),
    "log_columns": (
        (0.0, 1.099, 2.639, 3.497, 4.382, 5.176, 6.12),
        (-0.665, 0.165, 0.303, -0.323, -0.259, -0.6, 1.378),
    ),
    "levels": (
        (1.0, 2.0, 3.0, 5.0, 11.0, 16.0, 50.0),
        (3.307, 2.398, 1.991, 0.599, -1.191, -2.259, -4.846),
    ),
    "range_m": (
        (3.347, 5.099, 8.682, 17.444, 25.333, 35.712, 57.407),
        (-1.658, -2.131, -0.94, -0.107, 0.974, 1.961, 1.9),
    ),
    "passing": (
        (0.0, 0.002, 0.024, 0.067, 0.139, 0.334, 0.955),
        (0.305, 0.356, 0.485, 0.309, -0.051, -0.624, -0.779),
    ),
    "top_m": (
        (0.587, 0.944, 1.359, 1.9, 2.345, 2.497, 2.5),
        (-0.872, -0.183, -0.576, -0.088, 0.039, 0.65, 1.03),
    ),
    "bottom_m": (
        (0.12, 0.173, 0.245, 0.385, 0.705, 1.027, 2.242),
        (-2.644, -0.004, 0.085, 0.192, 1.221, 0.37, 0.78),
    ),
    "deep": ((0.0, 0.015, 1.0), (-0.226, -1.066, 1.292)),
    "depth_m": (
        (0.0, 0.014, 0.046, 0.087, 0.194, 0.719),
        (0.206, -0.781, 0.726, 0.729, 0.228, -1.107),
    ),
    "ground": ((0.0, 0.18, 2.001, 3.731), (0.983, 1.851, -1.747, -1.087)),
    "ends": ((0.0, 0.545, 1.372, 3.512), (2.265, 0.335, -0.712, -1.889)),
    "sides": ((0.0, 1.458, 2.165, 3.788), (0.993, -0.075, -0.39, -0.528)),
    "above": ((0.0, 1.032, 1.831, 4.065), (1.926, 1.723, 0.465, -4.113)),
    "overhang": ((0.0, 0.506, 1.72, 4.739), (1.086, 0.335, 0.141, -1.562)),
    "log_residual": (
        (-5.298, -4.263, -3.627, -3.197, -2.812, -2.285, -0.102),
        (-1.632, -0.059, 0.457, 0.367, 0.051, -0.787, 1.602),
    ),
    "fit": (
        (-9.394, -5.399, -3.171, -0.875, 0.0, 0.724),
        (-1.16, -0.811, -0.232, 0.541, 0.337, 1.325),
    ),
    "length_m": ((0.491, 4.4, 4.6, 5.7, 16.521), (0.934, 2.212, 1.955, 0.002, -5.102)),
    "width_m": (
        (0.603, 1.82, 1.85, 1.855, 2.03, 2.563),
        (3.469, -1.034, -0.762, -1.053, -0.797, 0.176),
    ),
    "view": (
        (0.001, 0.142, 0.22, 0.458, 0.784, 0.896, 1.0),
        (1.339, 0.773, 0.275, -0.52, -0.751, -0.467, -0.647),
    ),
    "top_level": ((0.0, 1.0), (0.068, -0.068)),
    "top_share": (
        (0.24, 0.507, 0.715, 0.963, 0.998, 1.0, 1.064),
        (-0.672, 0.236, 0.573, 0.089, -0.003, -0.12, -0.104),
    ),
    "fill": (
        (0.125, 0.244, 0.505, 0.876, 1.0, 4.857, 344.0),
        (-3.574, -1.383, 0.413, 2.235, 1.221, 0.53, 0.559),
    ),
    "small": ((0.0, 1.0), (1.548, -1.548)),
    "weighed": ((0.0, 1.0), (-0.245, 0.245)),
}

# --------------------------------------------------------------------------------------------------
# The model.

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Increasing knots and the log odds at each; beyond the first and last knot the curve is
constant."""


@dataclass(frozen=True, slots=True)
class ScoreModel:
    """Log odds that a detection is right: a constant and one curve for each feature.

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
    """Return the (B,) probabilities that there is a road user within 2 m of each vehicle.

    cloud: the whole scan. height_m: height of the sensor above the ground.
    """
    return shipped_model().probabilities(features(vehicles, cloud, horizon, height_m))


@cache
def shipped_model() -> ScoreModel:
    """Return the model with the weights that ship with the package."""
    return ScoreModel(CONSTANT, CURVES)
