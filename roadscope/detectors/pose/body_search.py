"""From the rays of a body to its most likely states: first guesses and damped least squares."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from roadscope.detectors.pose.body_likelihood import (
    EDGE_M,
    ROUGHLY_DRAWN,
    Tolerance,
    ray_likelihoods,
    ray_misfits,
)
from roadscope.detectors.pose.body_model import INDEX, VALUES, BodyModel
from roadscope.detectors.pose.body_rays import HIT, BodyRays

STEPS = np.array([0.01, 0.01, 0.003, 0.05, 0.02, 0.05, 0.2, 0.2, 0.2, 0.2, 0.2])
"""By how much the values of a state are moved for a slope: about a standard deviation."""
SLACKS_M = (0.25, 0.15, 0.08, 0.04, 0.02, 0.01, 0.0, 0.0)
"""Added to noise and edges iteration by iteration: first every ray counts, then the near ones."""
SHARES = np.array([1.0, 0.5, 0.2, 0.05])
"""Shares of a step that are tried."""
AROUND, WIDTH = 8, 1.5
"""Places around the step's end that are tried too, and how many standard deviations wide."""
LIMIT = 3.0
"""Misfits beyond so many standard deviations lose weight."""
LOOSE_STEPS = 30.0
"""Steps, at a slack of 1 m, by which a value moves that the rays say little of."""
ANGLES = np.radians(np.arange(0.0, 90.0, 3.0))
"""Headings that are tried for a first guess."""
CLOSE_M = 0.2
"""Distance from a side beyond which a return says nothing about it."""
SETS = 4
"""Sets of evenly spread points."""
GUESS_POINTS = 64
"""Most returns for a first guess."""


@dataclass(frozen=True, slots=True)
class QuadraticRays:
    """Rays whose misfits are linear in the vector: their log-likelihood is one quadratic form.

    at: (D,) vector around which. normal (D, D), pull (D,): the log-likelihood of a departure d is
    -0.5 d' normal d - pull' d, plus the constant.
    """

    at: np.ndarray
    normal: np.ndarray
    pull: np.ndarray
    constant: float

    def log_likelihood(self, vectors: np.ndarray) -> np.ndarray:
        """Return the log-likelihood (K,) of vectors (K, D)."""
        off = vectors - self.at
        return np.asarray(self.constant - ((0.5 * off @ self.normal + self.pull) * off).sum(axis=1))


@dataclass(frozen=True, slots=True)
class BodyProblem:
    """Rays, a body, and which of the 11 values of its state are searched.

    free: (D,) indices of these values, in the order of a vector. fixed: (11,) the others.
    centre, sd: (11,) mean and standard deviation of a normal prior, infinite for none.
    """

    rays: BodyRays
    model: BodyModel
    free: np.ndarray
    tolerance: Tolerance = ROUGHLY_DRAWN
    fixed: np.ndarray = field(default_factory=lambda: np.zeros(VALUES))
    centre: np.ndarray = field(default_factory=lambda: np.zeros(VALUES))
    sd: np.ndarray = field(default_factory=lambda: prior_sd())
    quadratic: QuadraticRays | None = None

    def states(self, vectors: np.ndarray) -> np.ndarray:
        """Return the states (K, 11) of vectors (K, D)."""
        states = np.tile(self.fixed, (len(vectors), 1))
        states[:, self.free] = vectors
        return states

    @property
    def hits(self) -> int:
        """How many rays brought a return of the body."""
        return int((self.rays.kind == HIT).sum())

    def likelihoods(self, vectors: np.ndarray) -> np.ndarray:
        """Return the likelihood (K, M) of each ray."""
        return np.asarray(
            ray_likelihoods(self.states(vectors), self.model.shape, self.rays, self.tolerance)
        )

    def log_density(self, vectors: np.ndarray) -> np.ndarray:
        """Return the log of the posterior, up to a constant, (K,) for vectors (K, D)."""
        logs = np.log(self.likelihoods(vectors)).sum(axis=1) - 0.5 * self.prior_cost(vectors)
        return logs if self.quadratic is None else logs + self.quadratic.log_likelihood(vectors)

    def prior_cost(self, vectors: np.ndarray) -> np.ndarray:
        """Return the sum of squares (...,) of vectors (..., D) under the prior."""
        off = (vectors - self.centre[self.free]) / self.sd[self.free]
        return np.asarray((off * off).sum(axis=-1))

    def misfits(
        self, vectors: np.ndarray, slack_m: float = 0.0, edge_m: float = EDGE_M
    ) -> np.ndarray:
        """Return the misfits (..., M) of vectors (..., D); see `ray_misfits`."""
        states = self.states(vectors.reshape(-1, len(self.free)))
        found = ray_misfits(states, self.model.shape, self.rays, slack_m, edge_m)
        return np.asarray(found.reshape(*vectors.shape[:-1], len(self.rays.slope)))

    def cost(self, vectors: np.ndarray, slack_m: float = 0.0) -> np.ndarray:
        """Return the cost (...,): squared misfits, tempered for outliers, and the prior."""
        return tempered(self.misfits(vectors, slack_m)) + self.prior_cost(vectors)

    def slopes(
        self, vectors: np.ndarray, steps: np.ndarray, slack_m: float = 0.0, edge_m: float = EDGE_M
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return misfits (S, M) of vectors (S, D) and their derivatives (S, D, M).

        steps: (D,) by which each value is moved both ways.
        """
        moves = np.concatenate([np.zeros((1, len(steps))), np.diag(steps), -np.diag(steps)])
        found = self.misfits(vectors[:, None] + moves, slack_m, edge_m)
        ahead, back = found[:, 1 : 1 + len(steps)], found[:, 1 + len(steps) :]
        return found[:, 0], (ahead - back) / (2.0 * steps[:, None])

    def thinned(self, most: int) -> BodyProblem:
        """Return the problem with at most so many rays, evenly chosen."""
        return replace(self, rays=self.rays.thinned(most))


def prior_sd(**sd: float) -> np.ndarray:
    """Return standard deviations (11,) of a prior: flat for the motion, 1 for the shape."""
    values = dict.fromkeys(("x", "y", "yaw", "speed", "turn_rate", "acceleration"), np.inf) | sd
    return np.array([values.get(name, 1.0) for name in INDEX])


def tempered(misfits: np.ndarray) -> np.ndarray:
    """Return the sum (...,) of squared misfits (..., M), large ones counted less."""
    return np.asarray(LIMIT**2 * np.log1p((misfits / LIMIT) ** 2).sum(axis=-1))


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a search ended: vectors (S, D), their covariances (S, D, D) and costs (S,)."""

    vectors: np.ndarray
    covariances: np.ndarray
    costs: np.ndarray


def descend(
    problem: BodyProblem,
    vectors: np.ndarray,
    slacks_m: tuple[float, ...] = SLACKS_M,
    *,
    around: int = AROUND,
) -> Descent:
    """Improve vectors (S, D) of a problem, each on its own, by damped least squares.

    slacks_m: added to noise and edges, iteration by iteration. around: places around the end of
    each step that are tried too, because silhouettes make no parabola.
    """
    steps, vectors = STEPS[problem.free], np.array(vectors, np.float64)
    precision, centre = problem.sd[problem.free] ** -2.0, problem.centre[problem.free]
    spread = WIDTH * normal_points(AROUND, len(steps))[0, :around]
    best, covariances = vectors.copy(), np.zeros((*vectors.shape, len(steps)))
    least = np.full(len(vectors), np.inf)
    for iteration, slack_m in enumerate((*slacks_m, 0.0)):
        misfits, slopes = problem.slopes(vectors, steps, slack_m)
        weighed = slopes / (1.0 + (misfits / LIMIT) ** 2)[:, None]
        # The last term keeps values that the rays say little of from running away.
        damping = precision + ((0.3 + slack_m) * LOOSE_STEPS * steps) ** -2.0
        inverse = np.linalg.inv(weighed @ np.swapaxes(slopes, 1, 2) + np.diag(damping))
        if slack_m == 0.0:
            costs = tempered(misfits) + problem.prior_cost(vectors)
            better = costs < least
            least[better], best[better] = costs[better], vectors[better]
            covariances[better] = inverse[better]
        if iteration == len(slacks_m):
            break
        pull = (weighed @ misfits[..., None])[..., 0] + precision * (vectors - centre)
        step = (inverse @ pull[..., None])[..., 0]
        ends = vectors[:, None] - SHARES[:, None] * step[:, None]
        beside = ends[:, :1] + spread @ np.swapaxes(np.linalg.cholesky(inverse), 1, 2)
        tried = np.concatenate([ends, beside], axis=1)
        chosen = problem.cost(tried, slack_m).argmin(axis=1)
        vectors = tried[np.arange(len(tried)), chosen]
    return Descent(best, covariances, least)


@cache
def normal_points(count: int, dimensions: int) -> np.ndarray:
    """Return sets (4, count, dimensions) of evenly spread standard normal points.

    Additive recurrence with the generalised golden ratio (Roberts 2018); each set is centred and
    scaled to unit variance, so that few points carry little bias.
    """
    from scipy.special import ndtri

    golden = 2.0
    for _ in range(60):
        golden = (1 + golden) ** (1 / (dimensions + 1))
    steps = golden ** -np.arange(1.0, dimensions + 1)
    turns = np.outer(np.arange(1, SETS * count + 1), steps) + 0.5
    points = ndtri(np.clip(turns % 1.0, 1e-6, 1 - 1e-6)).reshape(SETS, count, dimensions)
    points -= points.mean(axis=1, keepdims=True)
    points /= points.std(axis=1, keepdims=True)
    return np.asarray(points)


def first_poses(
    points: np.ndarray, origin: np.ndarray, model: BodyModel, *, cut: bool = False
) -> np.ndarray:
    """Return x, y, yaw (4, 3) for the headings along the sides of an initial rectangle.

    points: (N, 2) metres, N at least 1. origin: (2,) metres, the sensor. cut: the sweep began or
    ended on the body, so that its near end may be missing; (16, 3) more have each end at one of
    the points' own.
    """
    points = points[:: -(-len(points) // GUESS_POINTS)]
    first = _side_direction(points, origin)
    poses = []
    for yaw in first + 0.5 * np.pi * np.arange(4):
        axes = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        halves = 0.5 * np.array([model.length_m[0], model.width_m[0]])
        places, sensor = points @ axes.T, axes @ origin
        low, high = places.min(axis=0), places.max(axis=0)
        # The near side of the body is where the points are.
        near = np.where(sensor > high, high - halves, 0.5 * (low + high))
        near = np.where(sensor < low, low + halves, near)
        poses.append([*near @ axes, yaw])
        for k in range(2) if cut else ():
            for end in (low[k] + halves[k], high[k] - halves[k]):
                moved = near.copy()
                moved[k] = end
                poses.append([*moved @ axes, yaw])
    return np.array(poses)


def _side_direction(points: np.ndarray, origin: np.ndarray) -> float:
    """Return the angle at which the sides next to the sensor are nearest to the returns."""
    if len(points) < 3:
        x, y = points.mean(axis=0) - origin
        return float(np.arctan2(y, x))
    nearest = np.full((len(points), len(ANGLES)), CLOSE_M)
    for angles in (ANGLES, ANGLES + 0.5 * np.pi):
        axes = np.array([np.cos(angles), np.sin(angles)])
        places, sensor = points @ axes, origin @ axes
        low, high = places.min(axis=0), places.max(axis=0)
        is_ahead = sensor > 0.5 * (low + high)
        nearest = np.minimum(nearest, np.where(is_ahead, high - places, places - low))
    return float(ANGLES[nearest.sum(axis=0).argmin()])
