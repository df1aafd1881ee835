"""From a first guess of a body's state to its best one: damped least squares over all rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.detectors.pose.body_descent_kernels import (
    Rules,
    Space,
    descended,
    disagreed,
)
from roadscope.detectors.pose.body_model import drawn
from roadscope.detectors.pose.body_sampling import Problem, normal_points

SLACKS_M = (0.25, 0.15, 0.08, 0.04, 0.02, 0.01, 0.0, 0.0)
"""Added to noise and edges round by round: first every ray counts, then the near ones."""
STEPS = np.array([0.01, 0.01, 0.003, 0.05, 0.02, 0.05, 0.2, 0.2, 0.2, 0.2, 0.2])
"""By how much values are moved to see what follows: about a standard deviation."""
SHARES = np.array([1.0, 0.5, 0.2, 0.05])
"""Shares of a step that are tried."""
AROUND, WIDTH = 8, 1.5
"""Places around the step's end that are tried too, and how many standard deviations wide."""
LIMIT = 3.0
"""Misfits beyond so many standard deviations lose weight."""
EDGE_M = 0.006
"""How exactly a descent takes silhouettes to be drawn: beyond a harder edge it feels no slope."""
RULES = Rules(LIMIT, EDGE_M)


@dataclass(frozen=True, slots=True)
class Best:
    """Best vectors (S, D), inverses of their covariances (S, D, D) and costs (S,)."""

    vectors: np.ndarray
    normals: np.ndarray
    costs: np.ndarray

    @property
    def covariances(self) -> np.ndarray:
        """(S, D, D)."""
        return np.linalg.inv(self.normals)


def descend(
    problem: Problem,
    vectors: np.ndarray,
    slacks: tuple[float, ...] = SLACKS_M,
    *,
    around: int = AROUND,
    ways: int = 2,
) -> Best:
    """Improve (S, D) vectors of a problem, each on its own.

    around: places around each step's end that are tried too. ways: in which values are moved to
    see what follows, 2 or, for half the work, 1.
    """
    space = space_of(problem, around=around, ways=ways)
    starts = np.ascontiguousarray(vectors, np.float64)
    told = problem.rays, RULES
    best, normals, costs = descended(
        starts, np.array([*slacks, 0.0]), drawn(problem.model), space, told
    )
    return Best(best, normals, costs)


def space_of(problem: Problem, *, around: int, ways: int) -> Space:
    """Return where a problem is searched; arguments as in `descend`."""
    free = problem.free
    return Space(
        free,
        problem.fixed,
        1.0 / problem.prior[free] ** 2,
        problem.centre[free],
        STEPS[free],
        WIDTH * normal_points(AROUND, len(free))[0, :around],
        SHARES,
        ways,
    )


def slopes_of(
    problem: Problem, vectors: np.ndarray, steps: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """Misfits (S, M) and their derivatives (S, M, D), by moving each value a step both ways."""
    count, size = vectors.shape
    moved = np.repeat(vectors[:, None], 2 * size + 1, axis=1)
    for d in range(size):
        moved[:, 1 + d, d] += steps[d]
        moved[:, 1 + size + d, d] -= steps[d]
    rules = Rules(LIMIT, problem.chances.edge_m)
    out = misfits_of(problem, moved.reshape(-1, size), slack, rules)
    out = out.reshape(count, 2 * size + 1, -1)
    slopes = (out[:, 1 : size + 1] - out[:, size + 1 :]) / (2 * steps[:, None])
    return out[:, 0], np.swapaxes(slopes, 1, 2)


def misfits_of(
    problem: Problem, vectors: np.ndarray, slack: float, rules: Rules = RULES
) -> np.ndarray:
    """Return the misfits (K, M) of (K, D) vectors; rules: left out, those of a descent."""
    told = problem.rays, rules
    starts = np.ascontiguousarray(vectors, np.float64)
    space = space_of(problem, around=AROUND, ways=2)
    return np.asarray(disagreed(starts, slack, drawn(problem.model), space, told))
