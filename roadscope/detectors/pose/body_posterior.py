"""The posterior of a body's state by adaptive importance sampling, the same every time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.detectors.pose.body_model import MOTION
from roadscope.detectors.pose.body_search import (
    SETS,
    STEPS,
    BodyProblem,
    QuadraticRays,
    normal_points,
)

WIDER = 2.0
"""How much wider than the last estimate samples are drawn, as a factor on the covariance: the
posterior of one scan has corners that narrower samples leave out (1.3 made it a twentieth too
small)."""
FEW = 0.1
"""Share of a round's samples that must count; where fewer would, the weights are flattened."""
QUADRATIC_SD, QUADRATIC_ERROR = 2.5, 0.3
"""A ray is quadratic if its log-likelihood departs from its quadratic form by no more than the
second value at so many standard deviations along each principal axis."""
WORK, FEWEST, MOST = 24_000, 224, 640
"""Rays times samples of a round, and bounds on samples: few rays bound a posterior with corners,
many make it normal."""
ROUNDS, UNBOUND_ROUNDS, SPLITS = 10, 6, (0, 1, 4, 7)
"""Most rounds of sampling, of a posterior without bounds too, and in which rounds the quadratic
rays are chosen anew."""
LOOSE, LOOSE_SD = 0.5, 4.0
"""How far off a search leaves the values of the shape, as a share of its steps, and at most in
standard deviations: a corner's radius is bound from one side, which no quadratic form around its
best value tells."""
SETTLED = 0.6
"""Samples that count, as a share of those that would if the posterior were normal and known, from
which the estimate is settled."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean (D,) and covariance (D, D) of a posterior.

    evidence: log of the density's integral. reached: whether samples have the posterior's own
    weights, not flattened ones.
    """

    mean: np.ndarray
    covariance: np.ndarray
    evidence: float
    reached: bool


def posterior(problem: BodyProblem, vector: np.ndarray, covariance: np.ndarray) -> Posterior:
    """Return the posterior of a problem around the end of a search.

    In each round samples are drawn from a normal distribution around the last estimate of mean
    and covariance, and weighed by the posterior over what they were drawn from. While too few
    would count, weights are flattened, so that the estimate moves there in steps.
    """
    known_sd = LOOSE_SD * np.sqrt(np.diag(covariance))
    loose = np.minimum(LOOSE * STEPS[problem.free], known_sd) * (problem.free >= MOTION)
    mean, covariance = vector, covariance + np.diag(loose**2)
    # Fewer returns than unknowns leave a posterior without bounds, which samples would follow.
    of_normal = (2.0 / WIDER - WIDER**-2.0) ** (0.5 * len(mean))
    is_bound, was_reached = problem.hits >= len(mean), False
    for turn in range(ROUNDS if is_bound else UNBOUND_ROUNDS):
        if turn in SPLITS:
            near = with_quadratic_rays(problem, mean, covariance)
        count = int(np.clip(WORK // max(len(near.rays.slope), 1), FEWEST, MOST)) // 32 * 32
        root = np.linalg.cholesky(WIDER * covariance)
        normals = normal_points(count, len(mean))[turn % SETS]
        samples = mean + normals @ root.T
        ratios = near.log_density(samples) + 0.5 * (normals * normals).sum(axis=1)
        power = _flattening(ratios, FEW * count)
        weights = np.exp(power * (ratios - ratios.max()))
        evidence = np.log(weights.mean()) + power * ratios.max() + np.log(np.diag(root)).sum()
        weights /= weights.sum()
        effective = 1.0 / (weights @ weights)
        mean = weights @ samples
        off = samples - mean
        # A little of the proposal is mixed in where few samples count: it must not collapse.
        share = 0.02 * min(0.5, len(mean) / effective / 4)
        covariance = (off.T * weights) @ off + share * (root @ root.T)
        if was_reached and power == 1.0 and effective > SETTLED * of_normal * count:
            break
        was_reached = power == 1.0
    if not is_bound and power < 1.0:
        # Their mean says no more than how far they have come.
        covariance, mean = covariance + np.outer(mean - vector, mean - vector), vector
    # What so few evenly spread samples add to the errors, compared with 20 times as many.
    covariance = covariance * (effective + 1.0) / max(effective - 1.0, 1.0)
    return Posterior(mean, covariance, float(evidence), bool(power == 1.0))


def with_quadratic_rays(
    problem: BodyProblem, mean: np.ndarray, covariance: np.ndarray
) -> BodyProblem:
    """Return the problem with its quadratic rays around a mean merged into one form.

    So the many samples cost only the rays near a silhouette or a corner.
    """
    steps = np.maximum(0.5 * np.sqrt(np.diag(covariance)), 0.02 * STEPS[problem.free])
    found = problem.slopes(mean[None], steps, edge_m=problem.tolerance.edge_m)
    misfit, slope = found[0][0], found[1][0]
    variances, axes = np.linalg.eigh(covariance)
    moves = QUADRATIC_SD * (axes * np.sqrt(np.maximum(variances, 0.0))).T
    moves = np.concatenate([np.zeros((1, len(mean))), moves, -moves])
    logs = np.log(problem.likelihoods(mean + moves))
    form = -0.5 * ((misfit + moves @ slope) ** 2 - misfit**2)
    is_quadratic = (np.abs(logs - logs[0] - form) < QUADRATIC_ERROR).all(axis=0)
    slope = slope[:, is_quadratic]
    quadratic = QuadraticRays(
        mean, slope @ slope.T, slope @ misfit[is_quadratic], float(logs[0, is_quadratic].sum())
    )
    return replace(problem, rays=problem.rays.rows(~is_quadratic), quadratic=quadratic)


def _flattening(logs: np.ndarray, least: float) -> float:
    """Return the power of the weights at which at least so many samples count."""

    def effective(power: float) -> float:
        weights = np.exp(power * (logs - logs.max()))
        return float(weights.sum() ** 2 / (weights @ weights))

    low, high = 0.0, 1.0
    if effective(high) >= least:
        return high
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= least else (low, middle)
    return low
