"""The posterior around the best state: exact where edges matter, quadratic where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.detectors.pose.body_descent import STEPS, slopes_of
from roadscope.detectors.pose.body_kernels import MOST_PARTS, POSE, Rays, log_chances
from roadscope.detectors.pose.body_sampling import Posterior, Problem, Smooth, refine

LEVELS = (2.5,)
"""Standard deviations along each principal axis at which rays are tried."""
STRAIGHT = 0.3
"""Departure of a ray's log-likelihood from its quadratic form up to which the form is used."""
WORK, FEWEST, MOST = 30_000, 160, 512
"""Rays times samples of a round, and bounds on samples: few rays bound a posterior with corners,
many make it normal."""
ROUNDS = 2, 3
"""Rounds of sampling after the first look at the rays, and after the second."""
WIDE = 2.0
"""How much wider the first proposal is than the guessed covariance."""
LOOSE = 0.5
"""How far off a descent leaves the body's unknowns, as a share of its steps: a corner's radius is
bound from one side, which no quadratic form around its best value tells."""
ENOUGH = 100.0
"""Effective number of samples that gives mean and covariance."""
MOVED = 2.0
"""Standard deviations of the guess by which the mean may move for one look to be enough."""


def posterior(
    problem: Problem, vector: np.ndarray, covariance: np.ndarray, *, work: int = WORK
) -> Posterior:
    """Return the posterior of a problem around a vector (D,) with a guessed covariance (D, D).

    Returns well inside a face are merged into one quadratic form first, so that the many samples
    cost only the rays near a silhouette or a corner. Where the samples move away or few of them
    count, that is done again around them. work: rays times samples of a round.
    """
    loose = np.where(problem.free >= POSE, LOOSE * STEPS[problem.free], 0.0)
    mean, spread = vector, WIDE * covariance + np.diag(loose**2)
    for rounds in ROUNDS:
        near = split(problem, mean, spread)
        count = int(np.clip(work // max(len(near.rays.slope), 1), FEWEST, MOST)) // 32 * 32
        found = refine(near, mean, spread, count=count, rounds=rounds, enough=ENOUGH)
        off = found.mean - mean
        if found.effective > ENOUGH and off @ np.linalg.solve(spread, off) < MOVED**2:
            break
        mean, spread = found.mean, found.covariance
    return found


def split(problem: Problem, vector: np.ndarray, covariance: np.ndarray) -> Problem:
    """Merge the rays whose log-likelihood is quadratic within three standard deviations."""
    values, axes = np.linalg.eigh(covariance)
    ways = (axes * np.sqrt(np.maximum(values, 0.0))).T
    moves = np.concatenate([[0.0 * vector]] + [s * ways for f in LEVELS for s in (f, -f)])
    logs = _logs(problem, vector + moves)
    steps = np.maximum(0.5 * np.sqrt(np.diag(covariance)), 0.02 * STEPS[problem.free])
    misfit, slope = slopes_of(problem, vector[None], steps, 0.0)
    bent = misfit[0][:, None] + slope[0] @ moves.T
    form = -0.5 * (bent**2 - bent[:, :1] ** 2).T
    straight = (np.abs(logs - logs[0] - form) < STRAIGHT).all(axis=0)
    normal = slope[0][straight].T @ slope[0][straight]
    pull = slope[0][straight].T @ misfit[0][straight]
    smooth = Smooth(vector, normal, pull, float(logs[0, straight].sum()))
    rays = Rays(*(np.ascontiguousarray(column[~straight]) for column in problem.rays))
    return replace(problem, rays=rays, smooth=smooth)


def _logs(problem: Problem, vectors: np.ndarray) -> np.ndarray:
    whole = problem.whole(vectors)
    out = np.empty((len(whole), len(problem.rays.slope)))
    parts = problem.model.parts(whole[:, POSE:])
    states = np.ascontiguousarray(whole[:, :POSE])
    told = problem.rays, problem.chances
    log_chances(states, parts, told, out, np.empty((3, MOST_PARTS)))
    return out
