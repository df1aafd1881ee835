"""Fitted models of the probabilities of detections of both sensors, read from `weights.toml`.

`research.fusion_weights` of the repository fits and writes it.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class SecondOrderModel:
    """Multinomial logistic model of second order: a constant, F features and their products.

    mean, spread: (F,) mean and standard deviation of the features, which are clipped at three
        standard deviations.
    weights: (T, K), T = 1 + F + F (F + 1) / 2, of the log odds of K classes against none of them.
    """

    mean: np.ndarray
    spread: np.ndarray
    weights: np.ndarray

    def values(self, features: np.ndarray) -> np.ndarray:
        """Return (N, K) log odds of (N, F) features."""
        bounded = np.clip((features - self.mean) / self.spread, -3.0, 3.0)
        log_odds: np.ndarray = second_order(bounded) @ self.weights
        return log_odds

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """Return (N, K + 1) probabilities of the classes, then of none, for (N, F) features."""
        values = self.values(features)
        log_odds = np.column_stack([values, np.zeros(len(values))])
        odds = np.exp(log_odds - log_odds.max(axis=1, keepdims=True))
        probabilities: np.ndarray = odds / odds.sum(axis=1, keepdims=True)
        return probabilities


@dataclass(frozen=True, slots=True)
class OddsModel:
    """Logistic model.

    weights: (1 + F,) of a constant and of F features.
    """

    weights: np.ndarray

    @property
    def size(self) -> int:
        """Number of features."""
        return len(self.weights) - 1

    def odds(self, features: np.ndarray) -> np.ndarray:
        """Return (N,) log odds of (N, F) features."""
        result: np.ndarray = self.weights[0] + features @ self.weights[1:]
        return result


def second_order(values: np.ndarray) -> np.ndarray:
    """Return (N, 1 + F + F (F + 1) / 2): 1, (N, F) values, and products of any two of them."""
    rows, columns = np.triu_indices(values.shape[1])
    return np.column_stack([np.ones(len(values)), values, values[:, rows] * values[:, columns]])


@cache
def table() -> dict[str, Any]:
    """Return the whole file."""
    text = files("roadscope.fusion").joinpath("weights.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@cache
def lidar_model() -> SecondOrderModel:
    """Return the model of the family of a cluster: vehicle, cyclist, pedestrian or none."""
    return _second_order_model("lidar_classes")


@cache
def ranking_model() -> SecondOrderModel:
    """Return the model of whether a camera box shows a target that no box of higher score shows."""
    return _second_order_model("camera_ranking")


def _second_order_model(name: str) -> SecondOrderModel:
    part = table()[name]
    return SecondOrderModel(*(np.array(part[key]) for key in ("mean", "spread", "weights")))


@cache
def odds_model(name: str) -> OddsModel:
    """Return the logistic model of a name in the section `odds` of the file."""
    return OddsModel(np.array(table()["odds"][name]))


@cache
def confusion(sensor: str) -> np.ndarray:
    """Return (3, 3): of the detections reported as a family (row) the share of each (column).

    sensor: `lidar` or `camera`.
    """
    shares = np.array(table()["confusion"][sensor])
    result: np.ndarray = shares / shares.sum(axis=1, keepdims=True)
    return result
