"""From a first guess of a body's state to its best one: damped least squares over all rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.detectors.pose.body_kernels import POSE, misfits
from roadscope.detectors.pose.body_sampling import Problem

SLACKS_M = (0.25, 0.15, 0.08, 0.04, 0.02, 0.01, 0.0, 0.0)
"""Added to noise and edges round by round: first every ray counts, then the near ones."""
STEPS = np.array([0.01, 0.01, 0.003, 0.05, 0.02, 0.05, 0.2, 0.2, 0.2, 0.2, 0.2])
"""By how much values are moved to see what follows: about a standard deviation."""
LIMIT = 3.0
"""Misfits beyond so many standard deviations lose weight."""


@dataclass(frozen=True, slots=True)
class Best:
    """Best vectors (S, D), their covariances (S, D, D) and costs (S,)."""

    vectors: np.ndarray
    covariances: np.ndarray
    costs: np.ndarray


def descend(problem: Problem, vectors: np.ndarray, slacks: tuple[float, ...] = SLACKS_M) -> Best:
    """Improve (S, D) vectors of a problem side by side."""
    free = problem.free
    precision = np.diag(1.0 / problem.prior[free] ** 2)
    steps = STEPS[free]
    for slack in slacks:
        misfit, slope = _slopes(problem, vectors, steps, slack)
        weight = 1.0 / (1.0 + (misfit / LIMIT) ** 2)
        weighted = slope * weight[:, :, None]
        normal = np.einsum("smd,sme->sde", weighted, slope) + precision
        pull = np.einsum("smd,sm->sd", weighted, misfit)
        pull += (vectors - problem.centre[free]) @ precision
        damped = normal + _damping(steps, slack)
        vectors = vectors - np.linalg.solve(damped, pull[:, :, None])[:, :, 0]
    misfit, _ = _slopes(problem, vectors, steps, 0.0)
    costs = LIMIT**2 * np.log1p((misfit / LIMIT) ** 2).sum(axis=1)
    off = (vectors - problem.centre[free]) / problem.prior[free]
    costs += (off**2).sum(axis=1)
    return Best(vectors, np.linalg.inv(normal + _damping(steps, slack)), costs)


def _damping(steps: np.ndarray, slack: float) -> np.ndarray:
    """Keep what the rays say little of from running away."""
    damping: np.ndarray = np.diag(1.0 / ((0.3 + slack) * 30.0 * steps) ** 2)
    return damping


def _slopes(
    problem: Problem, vectors: np.ndarray, steps: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """Misfits (S, M) and their derivatives (S, M, D), by moving each value a step both ways."""
    count, size = vectors.shape
    moved = np.repeat(vectors[:, None], 2 * size + 1, axis=1)
    for d in range(size):
        moved[:, 1 + d, d] += steps[d]
        moved[:, 1 + size + d, d] -= steps[d]
    whole = problem.whole(moved.reshape(-1, size))
    out = np.empty((len(whole), len(problem.rays.slope)))
    parts = problem.model.parts(whole[:, POSE:])
    edge = problem.chances.edge_m + slack
    states = np.ascontiguousarray(whole[:, :POSE])
    misfits(states, parts, problem.rays, slack, edge, out)
    out = out.reshape(count, 2 * size + 1, -1)
    slopes = (out[:, 1 : size + 1] - out[:, size + 1 :]) / (2 * steps[:, None])
    return out[:, 0], np.swapaxes(slopes, 1, 2)
