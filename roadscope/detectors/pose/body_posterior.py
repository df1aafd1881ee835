"""The posterior of a body's state by adaptive importance sampling, the same every time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.detectors.pose.body_model import MOTION
from roadscope.detectors.pose.body_rays import HIT
from roadscope.detectors.pose.body_search import (
    LIMIT,
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
WIDER_FLATTENED = 1.3
"""The same while weights are flattened, and spread hardly less than what was drawn."""
FEW = 0.1
"""Share of a round's samples that must count; where fewer would, the weights are flattened."""
QUADRATIC_SD, QUADRATIC_ERROR = 2.5, 0.3
"""A ray is quadratic if its log-likelihood departs from its quadratic form by no more than the
second value at so many standard deviations along each principal axis."""
WORK, FEWEST, MOST = 24_000, 224, 640
"""Rays times samples of a round, and bounds on samples: few rays bound a posterior with corners,
many make it normal."""
ROUNDS = 3
"""Rounds of sampling after each split of the rays."""
SPLITS, MOST_SPLITS = 2, 8
"""Splits of the rays, and the most where the samples have not reached the posterior yet."""
LOOSE, LOOSE_SD = 0.5, 4.0
"""How far off a search leaves the values of the shape, as a share of its steps, and at most in
standard deviations: a corner's radius is bound from one side, which no quadratic form around its
best value tells."""
ENOUGH = 130.0
"""Effective number of samples that gives mean and covariance."""
MOVED_SD, GROWN = 2.0, 4.0
"""By how much the mean may move, in standard deviations of the guess, and a variance may grow, for
one split to be enough."""
DAMPED = 0.1
"""Share of a guess's precision that holds it where it is."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Where a posterior is looked for: mean (D,) and covariance (D, D).

    rough: whether the mean is no more than the end of a search, whose steps are coarse.
    """

    mean: np.ndarray
    covariance: np.ndarray
    rough: bool = False


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean (D,) and covariance (D, D) of a posterior.

    evidence: log of the density's integral. effective: number of samples that count. reached:
    whether samples have the posterior's own weights, not flattened ones.
    """

    mean: np.ndarray
    covariance: np.ndarray
    evidence: float
    effective: float
    reached: bool


def guess_around(problem: BodyProblem, vector: np.ndarray, covariance: np.ndarray) -> Guess:
    """Return where to look for the posterior around the end of a search."""
    known_sd = LOOSE_SD * np.sqrt(np.diag(covariance))
    loose = np.minimum(LOOSE * STEPS[problem.free], known_sd) * (problem.free >= MOTION)
    return Guess(vector, 2.0 * covariance + np.diag(loose**2), rough=True)


def posterior(problem: BodyProblem, guess: Guess, *, work: int = WORK) -> Posterior:
    """Return the posterior of a problem around a guess.

    Rays well inside a face are merged into one quadratic form first, so that the many samples cost
    only the rays near a silhouette or a corner. Where the samples move away or few of them count,
    both are done again around them. work: rays times samples of a round.
    """
    # Fewer returns than unknowns leave a posterior without bounds, which samples would follow.
    is_bound = (problem.rays.kind == HIT).sum() >= len(problem.free)
    start, reached = guess.mean, True
    for split in range(MOST_SPLITS if is_bound else SPLITS):
        near, mean = split_rays(problem, guess)
        more = max(split - SPLITS + 2, 1)
        count = more * work // max(len(near.rays.slope), 1)
        count = int(np.clip(count, FEWEST, more * MOST)) // 32 * 32
        found = _sampled(near, replace(guess, mean=mean), count, reached)
        reached = found.reached
        settled = found.effective > ENOUGH and _covers(mean, guess.covariance, found)
        if reached and (settled or split >= SPLITS - 1):
            break
        guess = Guess(found.mean, found.covariance)
    if not is_bound and not reached:
        # Their mean says no more than how far they have come.
        moved = found.mean - start
        return replace(found, mean=start, covariance=found.covariance + np.outer(moved, moved))
    return found


def _covers(mean: np.ndarray, covariance: np.ndarray, found: Posterior) -> bool:
    """Tell whether samples around a mean covered all of the posterior that they found."""
    off = found.mean - mean
    growth = np.linalg.eigvals(np.linalg.solve(covariance, found.covariance)).real.max()
    return bool(off @ np.linalg.solve(covariance, off) < MOVED_SD**2 and growth < GROWN)


def split_rays(problem: BodyProblem, guess: Guess) -> tuple[BodyProblem, np.ndarray]:
    """Return the problem with its quadratic rays merged, and the mean of the guess.

    A rough mean is moved by one more step of least squares.
    """
    free, covariance, edge_m = problem.free, guess.covariance, problem.tolerance.edge_m
    steps = np.maximum(0.5 * np.sqrt(np.diag(covariance)), 0.02 * STEPS[free])
    misfits, slopes = problem.slopes(guess.mean[None], steps, edge_m=edge_m)
    misfit, slope, mean = misfits[0], slopes[0], guess.mean
    if guess.rough:
        weighed = slope / (1.0 + (misfit / LIMIT) ** 2)
        precision = problem.sd[free] ** -2.0
        normal = weighed @ slope.T + np.diag(precision) + DAMPED * np.linalg.inv(covariance)
        pull = weighed @ misfit + precision * (mean - problem.centre[free])
        step = -np.linalg.solve(normal, pull)
        mean, misfit = mean + step, misfit + step @ slope
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
    return replace(problem, rays=problem.rays.rows(~is_quadratic), quadratic=quadratic), mean


def _sampled(problem: BodyProblem, guess: Guess, count: int, reached: bool) -> Posterior:
    """Adapt a normal proposal to the posterior, round by round, of so many samples each.

    The samples of all rounds count, each weighed by the posterior over the mixture of all
    proposals (Cornuet 2012, adaptive multiple importance sampling). While too few would count,
    weights are flattened, so that the proposal moves there in steps. reached: whether the guess
    is of a posterior with weights of its own.
    """
    mean, covariance = guess.mean, guess.covariance
    normals, proposals = normal_points(count, len(mean)), []
    samples, logs = np.empty((0, len(mean))), np.empty(0)
    for turn in range(ROUNDS):
        root = np.linalg.cholesky((WIDER if reached else WIDER_FLATTENED) * covariance)
        proposals.append((mean, root))
        drawn = mean + normals[turn % SETS] @ root.T
        samples = np.concatenate([samples, drawn])
        logs = np.concatenate([logs, problem.log_density(drawn)])
        ratios = logs - _mixture(proposals, samples)
        power = _flattening(ratios, FEW * count)
        weights = np.exp(power * (ratios - ratios.max()))
        evidence = np.log(weights.mean()) + power * ratios.max()
        weights /= weights.sum()
        effective = 1.0 / (weights @ weights)
        mean = weights @ samples
        off = samples - mean
        # A little of the proposal is mixed in where few samples count: it must not collapse.
        share = 0.02 * min(0.5, len(mean) / max(effective, 1.0) / 4)
        covariance = (off.T * weights) @ off + share * (root @ root.T)
        reached = power == 1.0
        if reached and effective > ENOUGH:
            break
    # What so few evenly spread samples add to the errors, compared with 20 times as many.
    covariance = covariance * (effective + 1.0) / max(effective - 1.0, 1.0)
    return Posterior(mean, covariance, float(evidence), float(effective), reached)


def _mixture(proposals: list[tuple[np.ndarray, np.ndarray]], samples: np.ndarray) -> np.ndarray:
    """Return the log density (K,) of the mixture of normal proposals: means and roots."""
    densities = []
    for mean, root in proposals:
        z = np.linalg.solve(root, (samples - mean).T)
        densities.append(-np.log(np.diag(root)).sum() - 0.5 * (z * z).sum(axis=0))
    return np.asarray(np.logaddexp.reduce(densities, axis=0) - np.log(len(proposals)))


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
