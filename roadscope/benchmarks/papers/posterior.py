"""Mean and covariance of a posterior by adaptive importance sampling, the same on every call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

STAGES = 14
ENOUGH, WANTED = 0.1, 0.3
"""Effective share of the sample that a tempered stage must keep, and at which the last one ends."""
SHARES, SCALES = (0.75, 0.25), (1.25, 2.5)
"""The proposal is a mixture of two normal densities wider than the last posterior."""

LogDensity = Callable[[np.ndarray], np.ndarray]


def moments(
    log_density: LogDensity, mean: np.ndarray, covariance: np.ndarray, *, draws: int = 2048
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return mean (D,), covariance (D, D) and effective share of the sample.

    log_density: (N, D) to (N,), unnormalised, may have jumps. mean, covariance: where to begin;
    should cover the posterior. While the sample falls mostly beside the posterior the ratio of
    density to proposal is taken to a power below 1 (tempering), and proposals follow its moments.
    """
    share = 0.0
    for _ in range(STAGES):
        sample, log_proposal = _propose(mean, covariance, draws)
        power, weights = _tempered(log_density(sample) - log_proposal)
        share = float(1.0 / (weights**2).sum() / draws)
        mean = weights @ sample
        offsets = sample - mean
        covariance = (weights[:, None] * offsets).T @ offsets
        covariance += 1e-12 * np.eye(len(mean))
        if power == 1.0 and share >= WANTED:
            break
    return mean, covariance, share if power == 1.0 else 0.0


def _tempered(log_ratios: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the greatest power up to 1 that keeps enough of the sample, and the weights."""
    weights = _weights(log_ratios)
    if _share(weights) >= ENOUGH:
        return 1.0, weights
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if _share(_weights(middle * log_ratios)) >= ENOUGH:
            low = middle
        else:
            high = middle
    return low, _weights(low * log_ratios)


def _weights(log_weights: np.ndarray) -> np.ndarray:
    weights = np.exp(log_weights - log_weights.max())
    scaled: np.ndarray = weights / weights.sum()
    return scaled


def _share(weights: np.ndarray) -> float:
    return float(1.0 / (weights**2).sum() / len(weights))


def _propose(mean: np.ndarray, covariance: np.ndarray, draws: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw (N, D) from the mixture, with its log-density up to a constant."""
    normal, scales = _standard(len(mean), draws)
    factor = np.linalg.cholesky(covariance)
    sample = mean + (scales[:, None] * normal) @ factor.T
    squares = (scales[:, None] * normal) ** 2
    radius = squares.sum(axis=1)
    parts = [
        np.log(share) - len(mean) * np.log(scale) - 0.5 * radius / scale**2
        for share, scale in zip(SHARES, SCALES, strict=True)
    ]
    return sample, np.logaddexp(*parts)


@cache
def _standard(dimensions: int, draws: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, D) evenly spread standard normal points and (N,) scales.

    An additive recurrence with the generalised golden ratio (the root of g^(D+1) = g + 1).
    """
    from scipy.special import ndtri

    ratio = 1.5
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 2))
    steps = ratio ** -np.arange(1.0, dimensions + 2)
    points = (0.5 + np.outer(np.arange(1, draws + 1), steps)) % 1.0
    scales = np.where(points[:, -1] < SHARES[0], SCALES[0], SCALES[1])
    return ndtri(np.clip(points[:, :-1], 1e-12, 1 - 1e-12)), scales
