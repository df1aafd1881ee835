"""Mean and covariance of a posterior by adaptive importance sampling, the same on every call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

STAGES = 14
POOLED = 4
"""The last stages of which all samples count (Cornuet 2012, adaptive multiple importance
sampling): a posterior with edges is nothing like its proposal, and one stage alone keeps few."""
ENOUGH, WANTED = 0.1, 0.3
"""Effective number of samples, as a share of a stage's draws, that tempering keeps, and with which
the sampling ends."""
SHARES, SCALES = (0.75, 0.25), (1.25, 2.5)
"""The proposal is a mixture of two normal densities wider than the last posterior."""

LogDensity = Callable[[np.ndarray], np.ndarray]


class _Stage(NamedTuple):
    """Where (D,) and how wide (D, D) was proposed; sample (N, D) and log-density (N,)."""

    mean: np.ndarray
    factor: np.ndarray
    sample: np.ndarray
    logs: np.ndarray


def moments(
    log_density: LogDensity,
    mean: np.ndarray,
    covariance: np.ndarray,
    *,
    draws: int = 2048,
    wanted: float = WANTED,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return mean (D,), covariance (D, D) and effective number of samples as a share of draws.

    log_density: (N, D) to (N,), unnormalised, may have jumps. mean, covariance: where to begin;
    should cover the posterior. While the sample falls mostly beside the posterior the ratio of
    density to proposal is taken to a power below 1 (tempering), and proposals follow its moments.
    """
    share, power = 0.0, 0.0
    stages: list[_Stage] = []
    for number in range(STAGES):
        normal, scales = _standard(len(mean), draws, number)
        factor = np.linalg.cholesky(covariance)
        sample = mean + (scales[:, None] * normal) @ factor.T
        stages = [*stages[-POOLED + 1 :], _Stage(mean, factor, sample, log_density(sample))]
        logs = np.concatenate([stage.logs for stage in stages])
        sample = np.concatenate([stage.sample for stage in stages])
        power, weights = _tempered(logs - _log_proposal(stages, sample), ENOUGH * draws)
        share = _effective(weights) / draws
        mean = weights @ sample
        offsets = sample - mean
        covariance = (weights[:, None] * offsets).T @ offsets / (1.0 - (weights**2).sum())
        covariance += 1e-12 * np.eye(len(mean))
        if power == 1.0 and share >= wanted:
            break
    return mean, covariance, share if power == 1.0 else 0.0


def _tempered(log_ratios: np.ndarray, enough: float) -> tuple[float, np.ndarray]:
    """Return the greatest power up to 1 that keeps enough samples, and the weights."""
    weights = _weights(log_ratios)
    if _effective(weights) >= enough:
        return 1.0, weights
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if _effective(_weights(middle * log_ratios)) >= enough:
            low = middle
        else:
            high = middle
    return low, _weights(low * log_ratios)


def _weights(log_weights: np.ndarray) -> np.ndarray:
    weights = np.exp(log_weights - log_weights.max())
    scaled: np.ndarray = weights / weights.sum()
    return scaled


def _effective(weights: np.ndarray) -> float:
    return float(1.0 / (weights**2).sum())


def _log_proposal(stages: list[_Stage], sample: np.ndarray) -> np.ndarray:
    """Return the log-density (N,), up to a constant, of what all stages together drew from."""
    parts = []
    for stage in stages:
        standard = np.linalg.solve(stage.factor, (sample - stage.mean).T)
        radius = (standard**2).sum(axis=0)
        size = np.log(np.diag(stage.factor)).sum()
        parts += [
            np.log(share) - len(standard) * np.log(scale) - size - 0.5 * radius / scale**2
            for share, scale in zip(SHARES, SCALES, strict=True)
        ]
    mixed: np.ndarray = np.logaddexp.reduce(parts)
    return mixed


@cache
def _standard(dimensions: int, draws: int, stage: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, D) evenly spread standard normal points and (N,) scales, others in each stage.

    An additive recurrence with the generalised golden ratio (the root of g^(D+1) = g + 1).
    """
    from scipy.special import ndtri

    ratio = 1.5
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 2))
    steps = ratio ** -np.arange(1.0, dimensions + 2)
    numbers = np.arange(stage * draws + 1, (stage + 1) * draws + 1)
    points = (0.5 + np.outer(numbers, steps)) % 1.0
    scales = np.where(points[:, -1] < SHARES[0], SCALES[0], SCALES[1])
    return ndtri(np.clip(points[:, :-1], 1e-12, 1 - 1e-12)), scales
