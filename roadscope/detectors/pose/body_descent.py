"""From a first guess of a body's state to its best one: damped least squares over all rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.detectors.pose.body_kernels import POSE
from roadscope.detectors.pose.body_misfits import misfits
from roadscope.detectors.pose.body_sampling import Problem, normal_points

SLACKS_M = (0.25, 0.15, 0.08, 0.04, 0.02, 0.01, 0.0, 0.0)
"""Added to noise and edges round by round: first every ray counts, then the near ones."""
STEPS = np.array([0.01, 0.01, 0.003, 0.05, 0.02, 0.05, 0.2, 0.2, 0.2, 0.2, 0.2])
"""By how much values are moved to see what follows: about a standard deviation."""
SHARES = (1.0, 0.5, 0.2, 0.05)
"""Shares of a step that are tried."""
AROUND, WIDTH = 8, 1.5
"""Places around the step's end that are tried too, and how many standard deviations wide."""
LIMIT = 3.0
"""Misfits beyond so many standard deviations lose weight."""


@dataclass(frozen=True, slots=True)
class Best:
    """Best vectors (S, D), their covariances (S, D, D) and costs (S,)."""

    vectors: np.ndarray
    covariances: np.ndarray
    costs: np.ndarray


def descend(
    problem: Problem,
    vectors: np.ndarray,
    slacks: tuple[float, ...] = SLACKS_M,
    *,
    around: int = AROUND,
) -> Best:
    """Improve (S, D) vectors of a problem side by side.

    around: places around each step's end that are tried too.
    """
    free = problem.free
    precision = np.diag(1.0 / problem.prior[free] ** 2)
    steps = STEPS[free]
    least = np.full(len(vectors), np.inf)
    best, normals = vectors, np.empty((len(vectors), len(free), len(free)))
    for rounds_left, slack in zip(range(len(slacks), -1, -1), (*slacks, 0.0), strict=True):
        misfit, slope = slopes_of(problem, vectors, steps, slack)
        weight = 1.0 / (1.0 + (misfit / LIMIT) ** 2)
        weighted = slope * weight[:, :, None]
        normal = np.einsum("smd,sme->sde", weighted, slope) + precision
        off = vectors - problem.centre[free]
        if slack == 0.0:
            costs = _costs(problem, vectors, misfit)
            better = costs < least
            least = np.where(better, costs, least)
            best = np.where(better[:, None], vectors, best)
            normals[better] = normal[better]
        if rounds_left == 0:
            break
        pull = np.einsum("smd,sm->sd", weighted, misfit) + off @ precision
        damped = normal + _damping(steps, slack)
        inverse = np.linalg.inv(damped)
        step = np.einsum("sde,se->sd", inverse, pull)
        root = np.linalg.cholesky(inverse)
        places = normal_points(AROUND, len(free))[0, :around]
        spread = WIDTH * np.einsum("sde,te->tsd", root, places)
        vectors = _stepped(problem, vectors, step, spread, slack)
    return Best(best, np.linalg.inv(normals + _damping(steps, 0.0)), least)


def _damping(steps: np.ndarray, slack: float) -> np.ndarray:
    """Keep what the rays say little of from running away."""
    damping: np.ndarray = np.diag(1.0 / ((0.3 + slack) * 30.0 * steps) ** 2)
    return damping


def _costs(problem: Problem, vectors: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """Return the sum of squares, tempered for what fits nothing, and of the prior: (S,)."""
    off = (vectors - problem.centre[problem.free]) / problem.prior[problem.free]
    costs: np.ndarray = LIMIT**2 * np.log1p((misfit / LIMIT) ** 2).sum(axis=1)
    costs += np.einsum("sd,sd->s", off, off)
    return costs


def _stepped(
    problem: Problem, vectors: np.ndarray, step: np.ndarray, spread: np.ndarray, slack: float
) -> np.ndarray:
    """Take the best of shares of a step and of places around: silhouettes make no parabola."""
    shares = np.stack([vectors - share * step for share in SHARES])
    tried = np.concatenate([shares, vectors - step + spread])
    flat = tried.reshape(-1, vectors.shape[1])
    costs = _costs(problem, flat, _misfits(problem, flat, slack)).reshape(len(tried), -1)
    best: np.ndarray = tried[np.argmin(costs, axis=0), np.arange(len(vectors))]
    return best


def _misfits(problem: Problem, vectors: np.ndarray, slack: float) -> np.ndarray:
    """Return the misfits (K, M) of (K, D) vectors."""
    whole = problem.whole(vectors)
    out = np.empty((len(whole), len(problem.rays.slope)))
    parts = problem.model.parts(whole[:, POSE:])
    edge = problem.chances.edge_m + slack
    states = np.ascontiguousarray(whole[:, :POSE])
    misfits(states, parts, problem.rays, slack, edge, out)
    return out


def slopes_of(
    problem: Problem, vectors: np.ndarray, steps: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """Misfits (S, M) and their derivatives (S, M, D), by moving each value a step both ways."""
    count, size = vectors.shape
    moved = np.repeat(vectors[:, None], 2 * size + 1, axis=1)
    for d in range(size):
        moved[:, 1 + d, d] += steps[d]
        moved[:, 1 + size + d, d] -= steps[d]
    out = _misfits(problem, moved.reshape(-1, size), slack).reshape(count, 2 * size + 1, -1)
    slopes = (out[:, 1 : size + 1] - out[:, size + 1 :]) / (2 * steps[:, None])
    return out[:, 0], np.swapaxes(slopes, 1, 2)
