"""Mean and covariance of a posterior by adaptive importance sampling, the same on every call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

ROUNDS = 14
POOLED_ROUNDS = 4
"""The samples of this many last rounds are used (Cornuet 2012, adaptive multiple importance
sampling): a posterior with edges differs from its proposal, and few samples of one round have
weight."""
LEAST_SHARE, WANTED_SHARE = 0.1, 0.3
"""Effective number of samples as a share of the draws of a round: what tempering keeps, and what
ends the sampling."""
MIXTURE_SHARES, MIXTURE_SCALES = (0.75, 0.25), (1.25, 2.5)
"""The proposal is a mixture of two normal densities that are wider than the last posterior."""
BISECTIONS = 20
"""Steps of the search for the power of tempering: it is exact to 1e-6."""

LogDensity = Callable[[np.ndarray], np.ndarray]
"""Returns the (N,) unnormalised log-density of (N, D) points. It may have jumps."""


class SampledPosterior(NamedTuple):
    """Moments of a posterior with D dimensions.

    mean: (D,). covariance: (D, D).
    effective_share: effective number of samples as a share of the draws of a round; 0 where the
        sampling did not reach the posterior.
    """

    mean: np.ndarray
    covariance: np.ndarray
    effective_share: float


class _Round(NamedTuple):
    """Mean (D,) and root (D, D) of the proposal, samples (N, D) and their log-density (N,)."""

    mean: np.ndarray
    root: np.ndarray
    samples: np.ndarray
    log_density: np.ndarray


def sampled_posterior(
    log_density: LogDensity,
    mean: np.ndarray,
    covariance: np.ndarray,
    *,
    draws: int = 2048,
    wanted_share: float = WANTED_SHARE,
) -> SampledPosterior:
    """Return mean and covariance of a posterior.

    mean, covariance: (D,) and (D, D) of the first proposal, which should cover the posterior.
    draws: samples of each round.

    While most samples lie beside the posterior, the ratio of density to proposal is raised to a
    power below 1 (tempering), and the next proposal has the moments that result.
    """
    share, power = 0.0, 0.0
    rounds: list[_Round] = []
    for number in range(ROUNDS):
        normal, scales = _standard_points(len(mean), draws, number)
        root = np.linalg.cholesky(covariance)
        samples = mean + (scales[:, None] * normal) @ root.T
        rounds = [*rounds[-POOLED_ROUNDS + 1 :], _Round(mean, root, samples, log_density(samples))]
        logs = np.concatenate([each.log_density for each in rounds])
        samples = np.concatenate([each.samples for each in rounds])
        power, weights = _tempered(logs - _log_proposal(rounds, samples), LEAST_SHARE * draws)
        share = _effective_number(weights) / draws
        mean = weights @ samples
        offsets = samples - mean
        covariance = (weights[:, None] * offsets).T @ offsets / (1.0 - (weights**2).sum())
        covariance += 1e-12 * np.eye(len(mean))
        if power == 1.0 and share >= wanted_share:
            break
    return SampledPosterior(mean, covariance, share if power == 1.0 else 0.0)


def _tempered(log_ratios: np.ndarray, least_number: float) -> tuple[float, np.ndarray]:
    """Return the greatest power up to 1 with enough effective samples, and the weights."""
    weights = _weights(log_ratios)
    if _effective_number(weights) >= least_number:
        return 1.0, weights
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _effective_number(_weights(middle * log_ratios)) >= least_number:
            low = middle
        else:
            high = middle
    return low, _weights(low * log_ratios)


def _weights(log_weights: np.ndarray) -> np.ndarray:
    weights = np.exp(log_weights - log_weights.max())
    normalised: np.ndarray = weights / weights.sum()
    return normalised


def _effective_number(weights: np.ndarray) -> float:
    return float(1.0 / (weights**2).sum())


def _log_proposal(rounds: list[_Round], samples: np.ndarray) -> np.ndarray:
    """Return the (N,) log-density, up to a constant, of the mixture of all rounds' proposals."""
    parts = []
    for each in rounds:
        standard = np.linalg.solve(each.root, (samples - each.mean).T)
        squares = (standard**2).sum(axis=0)
        log_volume = np.log(np.diag(each.root)).sum()
        parts += [
            np.log(share) - len(standard) * np.log(scale) - log_volume - 0.5 * squares / scale**2
            for share, scale in zip(MIXTURE_SHARES, MIXTURE_SCALES, strict=True)
        ]
    mixed: np.ndarray = np.logaddexp.reduce(parts)
    return mixed


@cache
def _standard_points(dimensions: int, draws: int, round_number: int) -> tuple[np.ndarray, ...]:
    """Return (N, D) evenly spread standard normal points and (N,) scales, others in each round.

    An additive recurrence with the generalised golden ratio (the root of g^(D+1) = g + 1).
    """
    from scipy.special import ndtri

    ratio = 1.5
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 2))
    steps = ratio ** -np.arange(1.0, dimensions + 2)
    numbers = np.arange(round_number * draws + 1, (round_number + 1) * draws + 1)
    points = (0.5 + np.outer(numbers, steps)) % 1.0
    scales = np.where(points[:, -1] < MIXTURE_SHARES[0], MIXTURE_SCALES[0], MIXTURE_SCALES[1])
    return ndtri(np.clip(points[:, :-1], 1e-12, 1 - 1e-12)), scales
