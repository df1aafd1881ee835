"""The posterior around the best state: exact where edges matter, quadratic where they do not."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from roadscope.detectors.pose.body_descent import LIMIT, STEPS, slopes_of
from roadscope.detectors.pose.body_kernels import HIT, POSE, Rays
from roadscope.detectors.pose.body_lane_chances import ray_chances
from roadscope.detectors.pose.body_model import drawn
from roadscope.detectors.pose.body_sampling import Posterior, Problem, Smooth, refine

LEVELS = (2.5,)
"""Standard deviations along each principal axis at which rays are tried."""
STRAIGHT = 0.3
"""Departure of a ray's log-likelihood from its quadratic form up to which the form is used."""
WORK, FEWEST, MOST = 36_000, 320, 1024
"""Rays times samples of a round, and bounds on samples: few rays bound a posterior with corners,
many make it normal."""
ROUNDS = 3
"""Rounds of sampling after each look at the rays."""
LOOKS, FARTHER = 2, 8
"""Looks at the rays, and at most so many where the samples have not reached the posterior yet."""
WIDE = 2.0
"""How much wider the first proposal is than the guessed covariance."""
LOOSE, LOOSE_SD = 0.5, 4.0
"""How far off a descent leaves the body's unknowns, as a share of its steps, and at most in
standard deviations: a corner's radius is bound from one side, which no quadratic form around its
best value tells."""
ENOUGH = 200.0
"""Effective number of samples that gives mean and covariance."""
MOVED = 2.0
"""Standard deviations of the guess by which the mean may move for one look to be enough."""
GROWN = 4.0
"""By what factor a variance may grow beyond the guess's for one look to be enough: samples of a
narrow part of a posterior count for each other, and say nothing of the rest."""
DAMPED = 0.1
"""Share of a guess's precision that holds it where it is."""


class Guess(NamedTuple):
    """Where a posterior is looked for: mean (D,) and covariance (D, D).

    rough: whether the mean is no more than the end of a descent, whose steps are coarse.
    """

    mean: np.ndarray
    covariance: np.ndarray
    rough: bool


def around(problem: Problem, vector: np.ndarray, covariance: np.ndarray) -> Guess:
    """Return where to look around a descent's end."""
    body = problem.free >= POSE
    known = LOOSE_SD * np.sqrt(np.diag(covariance))
    loose = np.where(body, np.minimum(LOOSE * STEPS[problem.free], known), 0.0)
    return Guess(vector, WIDE * covariance + np.diag(loose**2), True)


def posterior(problem: Problem, guess: Guess, *, work: int = WORK) -> Posterior:
    """Return the posterior of a problem around a guess.

    Returns well inside a face are merged into one quadratic form first, so that the many samples
    cost only the rays near a silhouette or a corner. Where the samples move away or few of them
    count, that is done again around them, and until their weights are the posterior's, with more
    samples each time. work: rays times samples of a round.
    """
    # Fewer returns than unknowns leave a posterior without bounds, which samples would follow.
    bound = (problem.rays.kind == HIT).sum() >= len(problem.free)
    start, reached = guess.mean, True
    for look in range(FARTHER if bound else LOOKS):
        near, mean = split(problem, guess)
        more = max(look - LOOKS + 2, 1)
        count = more * work // max(len(near.rays.slope), 1)
        count = int(np.clip(count, FEWEST, more * MOST)) // 32 * 32
        spread = guess.covariance
        found = refine(
            near, mean, spread, count=count, rounds=ROUNDS, enough=ENOUGH, reached=reached
        )
        reached = found.reached
        settled = found.effective > ENOUGH and _covers(mean, spread, found)
        if found.reached and (settled or look >= LOOKS - 1):
            break
        guess = Guess(found.mean, found.covariance, False)
    if not bound and not found.reached:
        # Their mean says no more than how far they have come.
        way = found.mean - start
        return replace(found, mean=start, covariance=found.covariance + np.outer(way, way))
    return found


def _covers(mean: np.ndarray, covariance: np.ndarray, found: Posterior) -> bool:
    """Whether samples from a normal distribution met all of the posterior that they told of."""
    off = found.mean - mean
    parts = np.linalg.solve(covariance, np.column_stack([off, found.covariance]))
    growth = np.linalg.eigvals(parts[:, 1:]).real.max()
    return bool(off @ parts[:, 0] < MOVED**2 and growth < GROWN)


def split(problem: Problem, guess: Guess) -> tuple[Problem, np.ndarray]:
    """Merge the rays whose log-likelihood is quadratic within three standard deviations.

    The second is the mean of the guess, a rough one after one more step of least squares.
    """
    start, covariance = guess.mean, guess.covariance
    steps = np.maximum(0.5 * np.sqrt(np.diag(covariance)), 0.02 * STEPS[problem.free])
    misfits, slopes = slopes_of(problem, start[None], steps, 0.0)
    misfit, slope = misfits[0], slopes[0]
    step = _step(problem, guess, misfit, slope) if guess.rough else np.zeros(len(start))
    vector, misfit = start + step, misfit + slope @ step
    values, axes = np.linalg.eigh(covariance)
    ways = (axes * np.sqrt(np.maximum(values, 0.0))).T
    moves = np.concatenate([[0.0 * vector]] + [s * ways for f in LEVELS for s in (f, -f)])
    logs = _logs(problem, vector + moves)
    bent = misfit[:, None] + slope @ moves.T
    form = -0.5 * (bent**2 - bent[:, :1] ** 2).T
    straight = (np.abs(logs - logs[0] - form) < STRAIGHT).all(axis=0)
    normal = slope[straight].T @ slope[straight]
    pull = slope[straight].T @ misfit[straight]
    smooth = Smooth(vector, normal, pull, float(logs[0, straight].sum()))
    rays = Rays(*(np.ascontiguousarray(column[~straight]) for column in problem.rays))
    return replace(problem, rays=rays, smooth=smooth), vector


def _step(problem: Problem, guess: Guess, misfit: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the step (D,) of weighted least squares from a guess."""
    weights = 1.0 / (1.0 + (misfit / LIMIT) ** 2)
    precision = 1.0 / problem.prior[problem.free] ** 2
    normal = (slope * weights[:, None]).T @ slope + np.diag(precision)
    normal += DAMPED * np.linalg.inv(guess.covariance)
    pull = slope.T @ (weights * misfit)
    pull += precision * (guess.mean - problem.centre[problem.free])
    return -np.linalg.solve(normal, pull)


def _logs(problem: Problem, vectors: np.ndarray) -> np.ndarray:
    """Return the log-likelihood (K, M) of each ray alone for (K, D) vectors."""
    kept, told = (problem.free, problem.fixed), (problem.rays, problem.chances)
    vectors = np.ascontiguousarray(vectors)
    logs: np.ndarray = np.log(ray_chances(vectors, drawn(problem.model), kept, told))
    return logs
