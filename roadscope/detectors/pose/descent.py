"""`body_descent.descend`, compiled: for many bodies of a few rays, where calls cost most."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.pose.body_descent import (
    AROUND,
    LIMIT,
    SHARES,
    SLACKS_M,
    STEPS,
    WIDTH,
)
from roadscope.detectors.pose.body_sampling import Problem, normal_points
from roadscope.detectors.pose.descent_kernels import Drawn, Rules, Space, descended


def descend_compiled(
    problem: Problem, vectors: np.ndarray, slacks: tuple[float, ...] = SLACKS_M
) -> tuple[np.ndarray, np.ndarray]:
    """Return improved (S, D) vectors of a problem and their costs (S,), as `descend` does."""
    model, free = problem.model, problem.free
    drawn = Drawn(
        np.array([model.length_m, model.width_m]),
        np.array(model.storeys),
        (*model.radius_m, *model.axles, *model.narrowing),
    )
    space = Space(
        free,
        problem.fixed,
        1.0 / problem.prior[free] ** 2,
        problem.centre[free],
        STEPS[free],
        WIDTH * normal_points(AROUND, len(free))[0],
        np.array(SHARES),
    )
    starts = np.ascontiguousarray(vectors, np.float64)
    told = problem.rays, Rules(LIMIT, problem.chances.edge_m)
    best, _, costs = descended(starts, np.array([*slacks, 0.0]), drawn, space, told)
    return best, costs
