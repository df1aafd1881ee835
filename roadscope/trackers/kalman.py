"""One Kalman filter for all targets at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.trackers.rows import Rows


@dataclass(frozen=True, slots=True, eq=False)
class Gaussians(Rows):
    """What is believed of N targets.

    means: (N, D) float64.
    covariances: (N, D, D) float64, symmetric, positive definite.
    """

    means: np.ndarray
    covariances: np.ndarray

    def __len__(self) -> int:
        return len(self.means)

    @staticmethod
    def empty(dimensions: int) -> Gaussians:
        """Return beliefs of nothing."""
        return Gaussians(np.empty((0, dimensions)), np.empty((0, dimensions, dimensions)))


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """What N measurements say beyond what was expected of N targets, one each.

    residuals: (N, M), measured minus expected.
    covariances: (N, M, M), S.
    gains: (N, D, M), K.
    """

    residuals: np.ndarray
    covariances: np.ndarray
    gains: np.ndarray

    @property
    def distances(self) -> np.ndarray:
        """(N,) squared Mahalanobis distances."""
        return mahalanobis_squared(self.residuals, self.covariances)

    @property
    def log_likelihoods(self) -> np.ndarray:
        """(N,) natural logarithms of the density of each measurement."""
        _, logdet = np.linalg.slogdet(self.covariances)
        size = self.residuals.shape[-1]
        found: np.ndarray = -0.5 * (self.distances + logdet + size * np.log(2 * np.pi))
        return found


def predicted(beliefs: Gaussians, F: np.ndarray, Q: np.ndarray) -> Gaussians:
    """Move beliefs on: F x, F P F' + Q; F and Q (D, D) for all or (N, D, D) for each."""
    means = (F @ beliefs.means[..., None])[..., 0]
    return Gaussians(means, F @ beliefs.covariances @ np.swapaxes(F, -1, -2) + Q)


def innovations(
    beliefs: Gaussians, measured: np.ndarray, H: np.ndarray, R: np.ndarray
) -> Innovations:
    """Compare (N, M) measurements with beliefs; H (M, D), R (M, M), for all or (N, ...) each.

    Angles among the residuals are the caller's to wrap.
    """
    residuals = measured - (H @ beliefs.means[..., None])[..., 0]
    crossed = beliefs.covariances @ np.swapaxes(H, -1, -2)
    covariances = H @ crossed + R
    gains = np.swapaxes(solved(covariances, np.swapaxes(crossed, -1, -2)), -1, -2)
    return Innovations(residuals, covariances, gains)


def updated(beliefs: Gaussians, innovation: Innovations, H: np.ndarray, R: np.ndarray) -> Gaussians:
    """Take the measurements in; covariances in Joseph's form, which stays symmetric."""
    K = innovation.gains
    means = beliefs.means + (K @ innovation.residuals[..., None])[..., 0]
    kept = np.eye(means.shape[-1]) - K @ H
    covariances = kept @ beliefs.covariances @ np.swapaxes(kept, -1, -2) + K @ R @ np.swapaxes(
        K, -1, -2
    )
    return Gaussians(means, 0.5 * (covariances + np.swapaxes(covariances, -1, -2)))


def corrected(beliefs: Gaussians, measured: np.ndarray, H: np.ndarray, R: np.ndarray) -> Gaussians:
    """Compare beliefs with (N, M) measurements and take these in."""
    return updated(beliefs, innovations(beliefs, measured, H, R), H, R)


def mahalanobis_squared(residuals: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return (...,) squared lengths of (..., M) residuals in units of (..., M, M) covariances."""
    weighed = solved(covariances, residuals[..., None])[..., 0]
    distances: np.ndarray = (residuals * weighed).sum(axis=-1)
    return distances


def solved(S: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return S^-1 B of symmetric (..., M, M) and (..., M, K) matrices.

    Two by two it is written out: LAPACK takes them one by one.
    """
    if S.shape[-1] != 2:
        return np.linalg.solve(S, B)
    a, b, c = (S[..., i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    determinant = a * c - b * b
    top, bottom = B[..., 0, :], B[..., 1, :]
    rows = (c * top - b * bottom) / determinant, (a * bottom - b * top) / determinant
    return np.stack(rows, axis=-2)
