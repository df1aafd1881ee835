"""The posterior of a body's state by adaptive importance sampling, the same every time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.detectors.pose.body_kernels import POSE, Chances, Rays
from roadscope.detectors.pose.body_lane_chances import log_likelihoods
from roadscope.detectors.pose.body_model import UNKNOWNS, BodyModel, drawn

WIDER = 2.0
"""How much wider than the last posterior samples are drawn, as a factor on the covariance: one
scan's has corners that narrower ones leave out (1.3 made it a twentieth too small)."""
ON_THE_WAY = 1.3
"""The same while weights are flattened, and spread hardly less than what was drawn."""
SETS = 4
"""Sets of points; more rounds begin with the first again."""
FEW = 0.1
"""Share of a round's samples that must count: where fewer would, the posterior is widened, for a
few samples say nothing of its width."""


@dataclass(frozen=True, slots=True)
class Smooth:
    """Rays whose misfits are straight in the vector: their likelihood is one quadratic form.

    at: (D,) vector around which; normal (D, D), pull (D,): -0.5 d' normal d - pull' d for a
    departure d. constant: at d = 0.
    """

    at: np.ndarray
    normal: np.ndarray
    pull: np.ndarray
    constant: float

    def log_density(self, samples: np.ndarray) -> np.ndarray:
        """Return the log-likelihood (K,) for (K, D) samples."""
        off = samples - self.at
        curved = np.einsum("kd,kd->k", off @ self.normal, off)
        logs: np.ndarray = self.constant - 0.5 * curved - off @ self.pull
        return logs


@dataclass(frozen=True, slots=True)
class Problem:
    """Rays, a body and what is free.

    A vector of the problem holds the free ones of x, y, yaw, speed, turn rate, acceleration and
    of the body's five unknowns.
    fixed: (11,) values of those that are not free. free: (D,) indices.
    prior: (11,) standard deviations of a normal prior around `centre` (11,), inf for flat.
    """

    rays: Rays
    model: BodyModel
    chances: Chances
    fixed: np.ndarray
    free: np.ndarray
    prior: np.ndarray
    centre: np.ndarray
    smooth: Smooth | None = None

    def log_density(self, samples: np.ndarray) -> np.ndarray:
        """Return the log of the posterior, up to a constant, (K,) for (K, D) samples."""
        vectors = np.ascontiguousarray(samples, np.float64)
        kept, told = (self.free, self.fixed), (self.rays, self.chances)
        out: np.ndarray = log_likelihoods(vectors, drawn(self.model), kept, told)
        off = (samples - self.centre[self.free]) / self.prior[self.free]
        out -= 0.5 * np.einsum("kd,kd->k", off, off)
        return out if self.smooth is None else out + self.smooth.log_density(samples)

    def whole(self, samples: np.ndarray) -> np.ndarray:
        """Return all 11 values for (K, D) samples."""
        whole = np.tile(self.fixed, (len(samples), 1))
        whole[:, self.free] = samples
        return whole


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean and covariance of weighted samples.

    mean (D,), covariance (D, D); evidence: log of the density's integral; effective: number of
    samples that count. reached: whether they have the posterior's own weights, not flattened
    ones, which are those of something wider on the way there.
    """

    mean: np.ndarray
    covariance: np.ndarray
    evidence: float
    effective: float
    reached: bool


def refine(
    problem: Problem,
    mean: np.ndarray,
    covariance: np.ndarray,
    *,
    count: int,
    rounds: int,
    enough: float,
    reached: bool = True,
) -> Posterior:
    """Adapt a normal proposal to the posterior, round by round.

    The samples of all rounds count, each weighed by the posterior over the mixture of what all
    rounds drew from (Cornuet 2012, adaptive multiple importance sampling); while too few would
    count, weights are flattened, so that the proposal moves there in steps. enough: effective
    number of samples at which no further round is made. reached: False for mean and covariance
    of a posterior that was not.
    """
    normals = normal_points(count, len(mean))
    drawn: list[tuple[np.ndarray, np.ndarray]] = []
    samples, logs = np.empty((0, len(mean))), np.empty(0)
    for turn in range(rounds):
        drawn.append((mean, _root((WIDER if reached else ON_THE_WAY) * covariance)))
        fresh = mean + normals[turn % SETS] @ drawn[-1][1].T
        samples = np.concatenate([samples, fresh])
        logs = np.concatenate([logs, problem.log_density(fresh)])
        ratios = logs - _mixture(drawn, samples)
        flat = _flattening(ratios, FEW * count)
        weights = np.exp(flat * (ratios - ratios.max()))
        evidence = np.log(weights.mean()) + flat * ratios.max()
        weights /= weights.sum()
        effective = 1.0 / (weights @ weights)
        mean = weights @ samples
        off = samples - mean
        covariance = _regular((off * weights[:, None]).T @ off, drawn[-1][1], effective)
        reached = flat == 1.0
        if reached and effective > enough:
            break
    # What so few evenly spread samples add to the errors, held to 20 times as many.
    covariance = covariance * (effective + 1.0) / max(effective - 1.0, 1.0)
    return Posterior(mean, covariance, float(evidence), float(effective), reached)


def _mixture(drawn: list[tuple[np.ndarray, np.ndarray]], samples: np.ndarray) -> np.ndarray:
    """Return the log density (K,) of the mixture of normal proposals, each a mean and a root."""
    densities = np.empty((len(drawn), len(samples)))
    for i, (mean, root) in enumerate(drawn):
        inverse = np.linalg.inv(root)
        z = (samples - mean) @ inverse.T
        densities[i] = np.log(np.diag(inverse)).sum() - 0.5 * np.einsum("kd,kd->k", z, z)
    top = densities.max(axis=0)
    log: np.ndarray = top + np.log(np.exp(densities - top).mean(axis=0))
    return log


def _flattening(logs: np.ndarray, least: float) -> float:
    """Return the power of the weights at which at least so many samples count."""
    low, high = 0.0, 1.0
    if _effective(logs) >= least:
        return 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _effective(middle * logs) >= least else (low, middle)
    return low


def _effective(logs: np.ndarray) -> float:
    weights = np.exp(logs - logs.max())
    return float(weights.sum() ** 2 / (weights @ weights))


def _regular(covariance: np.ndarray, root: np.ndarray, effective: float) -> np.ndarray:
    """Mix in a little of the last proposal where few samples count: it must not collapse."""
    share = min(0.5, len(covariance) / max(effective, 1.0) / 4)
    mixed: np.ndarray = covariance + share * 0.02 * (root @ root.T)
    return mixed


def _root(covariance: np.ndarray) -> np.ndarray:
    jitter = 1e-12 * np.eye(len(covariance))
    root: np.ndarray = np.linalg.cholesky(covariance + jitter)
    return root


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
    points.flags.writeable = False
    return np.asarray(points)


@cache
def free_of(model: BodyModel, moving: bool) -> np.ndarray:
    """Return the indices of what is free for one scan, or for a body on its way."""
    pose = np.arange(POSE if moving else 3)
    return np.concatenate([pose, POSE + model.uncertain])


WHOLE = POSE + UNKNOWNS
