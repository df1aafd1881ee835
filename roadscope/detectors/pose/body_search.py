"""From the rays of a body to its most likely states and to their posterior.

Damped least squares begin at first guesses. Adaptive importance sampling around their ends gives
the posterior. Nothing is random: the same rays give the same result.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.detectors.pose.body_likelihood import ROUGHLY_DRAWN, RayFits, Tolerance, ray_fits
from roadscope.detectors.pose.body_model import MOTION, STATE, VALUES, BodyModel
from roadscope.detectors.pose.body_rays import HIT, BodyRays

STEPS = np.array([0.01, 0.01, 0.003, 0.05, 0.02, 0.05, 0.2, 0.2, 0.2, 0.2, 0.2])
"""Finite-difference step of each value of a state (m, rad, m/s, ...), about its standard deviation;
chosen by hand."""
SLACKS_M = (0.25, 0.15, 0.08, 0.04, 0.02, 0.01, 0.005, 0.0)
"""Added to noise and to the width of edges in successive iterations: at first all rays have an
effect, later those near the body's surface and edges; chosen by hand."""
STEP_FRACTIONS = np.array([1.0, 0.5, 0.2, 0.0])
"""Fractions of a step that are tried."""
EXTRA_CANDIDATES, EXTRA_SPREAD_SD = 8, 1.5
"""Number of further states around the step's end that are tried, and their spread in standard
deviations."""
LIMIT = 3.0
"""Misfits beyond so many standard deviations lose weight."""
LOOSE_STEPS = 30.0
"""At a slack of 1 m, a value that the rays hardly determine moves by about so many of its steps."""
WIDER = 2.0
"""Samples are drawn with the covariance of the last estimate times this: the posterior of one scan
has corners that narrower samples miss (with 1.3 the covariance was 5 % too small)."""
LEAST_EFFECTIVE, FLATTER = 0.1, 0.85
"""Least effective share of a round's samples; with less, the weights are raised to a power below 1,
the greatest one of 1, `FLATTER`, `FLATTER` squared and so on that is enough."""
QUADRATIC_SD, QUADRATIC_ERROR = 2.5, 0.3
"""A ray is quadratic if its log-likelihood departs from its quadratic form by at most
`QUADRATIC_ERROR` at `QUADRATIC_SD` standard deviations along each principal axis."""
WORK, FEWEST, MOST = 24_000, 224, 512
"""Rays times samples of a round, and bounds on the number of samples: with few rays the posterior
has corners, with many it is nearly normal."""
MANY_RAYS = WORK // FEWEST
"""Up to so many rays are all sampled; of more, the quadratic ones are merged."""
ROUNDS, UNBOUNDED_ROUNDS = 10, 6
"""Most rounds of sampling if the posterior is bounded, and if it is unbounded."""
MOVED_SD, GROWN = 2.0, 4.0
"""The quadratic rays are chosen anew if the mean moves by more than `MOVED_SD` standard deviations
or a variance grows by more than the factor `GROWN`, because their form holds only where it was
tried."""
LEAST_VARIANCE, LEAST_BEND = 1e-18, 1e-9
"""Bounds against division by zero, of a variance and of the second difference of a log-density."""
LOOSE, LOOSE_SD = 0.5, 4.0
"""Extra standard deviation of the shape's values in the first proposal: `LOOSE` of the search's
steps, at most `LOOSE_SD` standard deviations. Rays bound a corner's radius from one side only, so
the covariance of least squares is too small."""
SETTLED = 0.6
"""The estimate is settled if the effective number of samples is at least this share of the number
that a known normal posterior would give."""
ANGLES = np.radians(np.arange(0.0, 90.0, 3.0))
"""Headings that are tried for a first guess."""
CLOSE_M = 0.2
"""A return farther than this from a side says nothing about it."""
SETS = 4
"""Sets of evenly spread points."""
GUESS_POINTS = 64
"""Most returns for a first guess."""


@dataclass(frozen=True, slots=True)
class QuadraticRays:
    """Rays whose misfits are linear in the vector: their log-likelihood is one quadratic form.

    at: (D,) vector at which it was made. normal (D, D), pull (D,), constant: at a distance d from
    that vector the log-likelihood is -0.5 d' normal d - pull' d + constant.
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

    free: (D,) indices of the values that are searched, in the order of a vector.
    fixed: (11,) the other values.
    centre, sd: (11,) mean and standard deviation of a normal prior; infinite without a prior.
    quadratic: rays that are merged into one form, besides `rays`; None for none.
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
        """How many rays have a return from the body."""
        return int((self.rays.kind == HIT).sum())

    def fits(self, vectors: np.ndarray, slack_m: float = 0.0) -> RayFits:
        """Return likelihoods and misfits (..., M) of vectors (..., D); see `ray_fits`."""
        states = self.states(vectors.reshape(-1, len(self.free)))
        fits = ray_fits(states, self.model.shape, self.rays, self.tolerance, slack_m)
        shape = *vectors.shape[:-1], len(self.rays.slope)
        return RayFits(fits.likelihoods.reshape(shape), fits.misfits.reshape(shape))

    def log_density(self, vectors: np.ndarray) -> np.ndarray:
        """Return the log of the posterior, up to a constant, (K,) for vectors (K, D)."""
        logs: np.ndarray = np.log(self.fits(vectors).likelihoods).sum(axis=1)
        logs -= 0.5 * self.prior_cost(vectors)
        return logs if self.quadratic is None else logs + self.quadratic.log_likelihood(vectors)

    def prior_cost(self, vectors: np.ndarray) -> np.ndarray:
        """Return the sum of squares (...,) of vectors (..., D) under the prior."""
        off = (vectors - self.centre[self.free]) / self.sd[self.free]
        return np.asarray((off * off).sum(axis=-1))

    def cost(self, vectors: np.ndarray, slack_m: float = 0.0) -> np.ndarray:
        """Return the cost (...,): squared misfits, large ones with less weight, and the prior."""
        misfits = self.fits(vectors, slack_m).misfits
        return np.asarray(robust_cost(misfits) + self.prior_cost(vectors))

    def slopes(
        self, vectors: np.ndarray, steps: np.ndarray, slack_m: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return misfits (S, M) of vectors (S, D) and their derivatives (S, D, M).

        steps: (D,) of the central differences.
        """
        moves = np.concatenate([np.zeros((1, len(steps))), np.diag(steps), -np.diag(steps)])
        misfits = self.fits(vectors[:, None] + moves, slack_m).misfits
        ahead, back = misfits[:, 1 : 1 + len(steps)], misfits[:, 1 + len(steps) :]
        return misfits[:, 0], (ahead - back) / (2.0 * steps[:, None])

    def thinned(self, most: int) -> BodyProblem:
        """Return the problem with at most `most` rays, those at the silhouette first."""
        return replace(self, rays=self.rays.thinned(most))


def prior_sd(**sd: float) -> np.ndarray:
    """Return standard deviations (11,) of a prior: flat for the motion, 1 for the shape."""
    values = dict.fromkeys(("x", "y", "yaw", "speed", "turn_rate", "acceleration"), np.inf) | sd
    return np.array([values.get(name, 1.0) for name in STATE])


def robust_cost(misfits: np.ndarray) -> np.ndarray:
    """Return the sum (...,) of squared misfits (..., M), large ones with less weight."""
    return np.asarray(LIMIT**2 * np.log1p((misfits / LIMIT) ** 2).sum(axis=-1))


@dataclass(frozen=True, slots=True)
class Descent:
    """The ends of searches: vectors (S, D), their covariances (S, D, D) and costs (S,)."""

    vectors: np.ndarray
    covariances: np.ndarray
    costs: np.ndarray


def descend(
    problem: BodyProblem,
    vectors: np.ndarray,
    slacks_m: tuple[float, ...] = SLACKS_M,
    *,
    around: int = EXTRA_CANDIDATES,
) -> Descent:
    """Improve vectors (S, D) of a problem, independently of each other, by damped least squares.

    slacks_m: added to noise and edges, one value for each iteration. around: number of vectors
    around the end of each step that are tried too, because costs at a silhouette are no parabola.
    """
    steps, vectors = STEPS[problem.free], np.array(vectors, np.float64)
    precision, centre = problem.sd[problem.free] ** -2.0, problem.centre[problem.free]
    spread = EXTRA_SPREAD_SD * normal_points(EXTRA_CANDIDATES, len(steps))[0, :around]
    for slack_m in slacks_m:
        misfits, slopes = problem.slopes(vectors, steps, slack_m)
        weighed = slopes / (1.0 + (misfits / LIMIT) ** 2)[:, None]
        # The last term keeps values that the rays hardly determine from diverging.
        damping = precision + ((0.3 + slack_m) * LOOSE_STEPS * steps) ** -2.0
        covariances = np.linalg.inv(weighed @ np.swapaxes(slopes, 1, 2) + np.diag(damping))
        pull = (weighed @ misfits[..., None])[..., 0] + precision * (vectors - centre)
        step = (covariances @ pull[..., None])[..., 0]
        ends = vectors[:, None] - STEP_FRACTIONS[:, None] * step[:, None]
        beside = ends[:, :1] + spread @ np.swapaxes(np.linalg.cholesky(covariances), 1, 2)
        tried = np.concatenate([ends, beside], axis=1)
        costs = problem.cost(tried, slack_m)
        vectors = tried[np.arange(len(tried)), costs.argmin(axis=1)]
    return Descent(vectors, covariances, costs.min(axis=1))


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


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean (D,) and covariance (D, D) of a posterior.

    evidence: logarithm of the density's integral, up to a constant that depends on D alone.
    reached: whether the last weights were not flattened; otherwise the evidence is not valid.
    """

    mean: np.ndarray
    covariance: np.ndarray
    evidence: float
    reached: bool


def posterior(problem: BodyProblem, vector: np.ndarray, covariance: np.ndarray) -> Posterior:
    """Return the posterior of a problem around the end of a search.

    In each round samples are drawn from a normal distribution with the last estimate of mean and
    covariance. Their weights are the posterior density over the density from which they were drawn.
    While the effective number of samples is too small, the weights are flattened, so that the
    estimate moves to the posterior in steps.
    """
    known_sd = LOOSE_SD * np.sqrt(np.diag(covariance))
    loose = np.minimum(LOOSE * STEPS[problem.free], known_sd) * (problem.free >= MOTION)
    mean, covariance = vector, covariance + np.diag(loose**2)
    # The effective share of samples if the posterior is normal with this mean and covariance.
    of_normal = (2.0 / WIDER - WIDER**-2.0) ** (0.5 * len(mean))
    # With fewer returns than unknowns the posterior is unbounded, and rounds do not converge.
    is_bounded, was_reached = problem.hits >= len(mean), False
    near, split, is_to_split = problem, None, len(problem.rays.slope) > MANY_RAYS
    for k in range(ROUNDS if is_bounded else UNBOUNDED_ROUNDS):
        if is_to_split:
            split = split_rays(problem, mean, covariance)
            near, mean = split.problem, split.better_mean
        count = int(np.clip(WORK // max(len(near.rays.slope), 1), FEWEST, MOST)) // 32 * 32
        root = np.linalg.cholesky(WIDER * covariance)
        normals = normal_points(count, len(mean))[k % SETS]
        samples = mean + normals @ root.T
        ratios = near.log_density(samples) + 0.5 * (normals * normals).sum(axis=1)
        power = _flattening(ratios, LEAST_EFFECTIVE * count)
        weights = np.exp(power * (ratios - ratios.max()))
        evidence = np.log(weights.mean()) + power * ratios.max() + np.log(np.diag(root)).sum()
        weights /= weights.sum()
        effective = 1.0 / (weights @ weights)
        mean = weights @ samples
        off = samples - mean
        # A little of the proposal is mixed in: with few effective samples it would collapse.
        share = 0.02 * min(0.5, len(mean) / effective / 4)
        covariance = (off.T * weights) @ off + share * (root @ root.T)
        is_to_split = split is not None and _has_left(split, mean, covariance)
        is_settled = effective > SETTLED * of_normal * count and not is_to_split
        if was_reached and power == 1.0 and is_settled:
            break
        was_reached = power == 1.0
    if not is_bounded and power < 1.0:
        # The samples have not reached the posterior, so their mean is not its mean.
        covariance, mean = covariance + np.outer(mean - vector, mean - vector), vector
    # Allow for the error of so few evenly spread samples; measured against 20 times as many.
    covariance = covariance * (effective + 1.0) / max(effective - 1.0, 1.0)
    return Posterior(mean, covariance, float(evidence), bool(power == 1.0))


class SplitRays(NamedTuple):
    """A problem whose quadratic rays are merged into one form.

    mean (D,), covariance (D, D): the estimate around which the form was tried. better_mean: (D,)
    after a step of Newton's method along each principal axis of the covariance.
    """

    problem: BodyProblem
    mean: np.ndarray
    covariance: np.ndarray
    better_mean: np.ndarray


def split_rays(problem: BodyProblem, mean: np.ndarray, covariance: np.ndarray) -> SplitRays:
    """Merge the quadratic rays of a problem around a mean into one form.

    Only the other rays, near a silhouette or a corner, are then computed for each sample.
    """
    size = len(mean)
    variances, axes = np.linalg.eigh(covariance)
    moves = QUADRATIC_SD * axes * np.sqrt(np.maximum(variances, LEAST_VARIANCE))
    tried = mean + np.concatenate([np.zeros((1, size)), moves.T, -moves.T])
    likelihoods, misfits = problem.fits(tried)
    logs, misfit = np.log(likelihoods), misfits[0]
    slope = np.linalg.solve(moves.T, 0.5 * (misfits[1 : size + 1] - misfits[size + 1 :]))
    form = -0.5 * ((misfit + (tried - mean) @ slope) ** 2 - misfit**2)
    is_quadratic = (np.abs(logs - logs[0] - form) < QUADRATIC_ERROR).all(axis=0)
    slope = slope[:, is_quadratic]
    quadratic = QuadraticRays(
        mean, slope @ slope.T, slope @ misfit[is_quadratic], float(logs[0, is_quadratic].sum())
    )
    gains = logs.sum(axis=1) - 0.5 * problem.prior_cost(tried)
    ahead, back = gains[1 : size + 1] - gains[0], gains[size + 1 :] - gains[0]
    share = 0.5 * (ahead - back) / np.maximum(-(ahead + back), LEAST_BEND)
    return SplitRays(
        replace(problem, rays=problem.rays.rows(~is_quadratic), quadratic=quadratic),
        mean,
        covariance,
        mean + moves @ np.clip(share, -1.0, 1.0),
    )


def _has_left(split: SplitRays, mean: np.ndarray, covariance: np.ndarray) -> bool:
    """Return whether an estimate has left the region in which the quadratic form was tried."""
    off = mean - split.mean
    shares = np.linalg.solve(split.covariance, np.column_stack([off, covariance]))
    growth = np.linalg.eigvals(shares[:, 1:]).real.max()
    return bool(off @ shares[:, 0] > MOVED_SD**2 or growth > GROWN)


def _flattening(logs: np.ndarray, least: float) -> float:
    """Return the greatest power, at most 1, that leaves at least `least` effective samples.

    logs: (K,) logarithms of the weights that are raised to it.
    """
    for power in FLATTER ** np.arange(60.0):
        weights = np.exp(power * (logs - logs.max()))
        if weights.sum() ** 2 >= least * (weights @ weights):
            return float(power)
    return 0.0


def first_poses(
    points: np.ndarray, origin: np.ndarray, model: BodyModel, *, cut: bool = False
) -> np.ndarray:
    """Return x, y, yaw (4, 3), metres and radians, one for each side of a first rectangle.

    points: (N, 2) metres, N at least 1. origin: (2,) metres, the sensor. cut: whether the sweep
    began or ended on the body, so that its near end may be missing. Then there are 16 more poses,
    each with one end of the body at an end of the points.
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
    """Return the heading of the rectangle whose sides near the sensor fit the returns best.

    With fewer than 3 returns it is the direction from the sensor to their mean.
    """
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
