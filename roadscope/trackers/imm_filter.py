"""Interacting multiple models (Blom and Bar-Shalom 1988), for all targets at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections
from roadscope.core.jit import compiled
from roadscope.trackers.kalman import Gaussians, weighed
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.rows import Rows
from roadscope.trackers.settings import check_positive

SHARED = 4
"""All states begin with x, y, vx, vy."""


@dataclass(frozen=True, slots=True, eq=False)
class Modes(Rows):
    """N targets as three models see them.

    velocity, acceleration, turn: beliefs by each model, conditional on its being right.
    shares: (N, 3) probabilities that it is.
    """

    velocity: Gaussians
    acceleration: Gaussians
    turn: Gaussians
    shares: np.ndarray

    def __len__(self) -> int:
        return len(self.shares)

    @property
    def parts(self) -> tuple[Gaussians, ...]:
        """The beliefs by model, in the order of `shares`."""
        return self.velocity, self.acceleration, self.turn

    @property
    def shared(self) -> Gaussians:
        """(3, N, ...) what each model believes of x, y, vx, vy."""
        return Gaussians(
            np.stack([part.means[:, :SHARED] for part in self.parts]),
            np.stack([part.covariances[:, :SHARED, :SHARED] for part in self.parts]),
        )

    @property
    def mixture(self) -> Gaussians:
        """Mean and covariance of x, y, vx, vy over all models."""
        shared = self.shared
        return Gaussians(*_moments(shared.means, shared.covariances, self.shares))


@dataclass(frozen=True, slots=True)
class ImmFilter:
    """Three filters that exchange what they believe before every prediction.

    filters: in the order of `Modes`.
    sojourn_s: mean time for which a target keeps to one model; then it is in either other.
    """

    filters: tuple[PlaceFilter, PlaceFilter, PlaceFilter]
    sojourn_s: float = 3.0

    def __post_init__(self) -> None:
        check_positive(sojourn_s=self.sojourn_s)

    def started(self, targets: Detections) -> Modes:
        """Begin with (N,) detections, all models alike."""
        v, a, t = (each.started(targets) for each in self.filters)
        return Modes(v, a, t, np.full((len(targets), 3), 1 / 3))

    def transition(self, dt: float) -> np.ndarray:
        """Return (3, 3) probabilities of going from one model to another in dt seconds."""
        settled = np.exp(-1.5 * dt / self.sojourn_s)
        chain: np.ndarray = settled * np.eye(3) + (1 - settled) / 3
        return chain

    def predicted(self, modes: Modes, dt: float) -> Modes:
        """Mix, then move each model's belief on by dt seconds."""
        flow = modes.shares[:, :, None] * self.transition(dt)
        shares = flow.sum(axis=1)
        mixing = flow / shares[:, None]
        shared = modes.shared
        v, a, t = (
            each.predicted(mixed(own, shared, mixing[:, :, j], j), dt)
            for j, (each, own) in enumerate(zip(self.filters, modes.parts, strict=True))
        )
        return Modes(v, a, t, shares)

    def corrected(self, modes: Modes, places: np.ndarray) -> Modes:
        """Take a measured place for each, (N, 2), which also says which model is right."""
        parts, likelihoods = [], np.empty_like(modes.shares)
        for j, (each, part) in enumerate(zip(self.filters, modes.parts, strict=True)):
            after, likelihoods[:, j] = weighed(part, places, each.H, each.R)
            parts.append(after)
        likelihoods -= likelihoods.max(axis=1, keepdims=True)
        shares = modes.shares * np.exp(likelihoods)
        return Modes(parts[0], parts[1], parts[2], shares / shares.sum(axis=1, keepdims=True))


def mixed(own: Gaussians, shared: Gaussians, weights: np.ndarray, j: int) -> Gaussians:
    """Return what model j starts from: the mean and covariance over all, by (N, 3) weights.

    own, shared: what it believes, and what all believe of x, y, vx, vy. Of what model j knows
    beyond, the others say nothing, so for them its own belief stands, independent of theirs
    (Granstrom, Willett and Bar-Shalom 2015).
    """
    means, covariances = own.means.copy(), own.covariances.copy()
    means[:, :SHARED], covariances[:, :SHARED, :SHARED] = _moments(
        shared.means, shared.covariances, weights
    )
    covariances[:, :SHARED, SHARED:] *= weights[:, j, None, None]
    covariances[:, SHARED:, :SHARED] *= weights[:, j, None, None]
    return Gaussians(means, covariances)


@compiled()
def _moments(
    means: np.ndarray, covariances: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of N mixtures.

    means: (K, N, D); covariances: (K, N, D, D); weights: (N, K).
    """
    K, N, D = means.shape
    mean, spread = np.zeros((N, D)), np.zeros((N, D, D))
    for n in range(N):
        for k in range(K):
            for a in range(D):
                mean[n, a] += weights[n, k] * means[k, n, a]
        for k in range(K):
            for a in range(D):
                apart = means[k, n, a] - mean[n, a]
                for b in range(D):
                    square = apart * (means[k, n, b] - mean[n, b])
                    spread[n, a, b] += weights[n, k] * (covariances[k, n, a, b] + square)
    return mean, spread
