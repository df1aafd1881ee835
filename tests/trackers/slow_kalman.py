"""A Kalman filter for all targets at once in plain NumPy, as a reference."""

from typing import NamedTuple

import numpy as np

from roadscope.trackers import Gaussians


class Innovations(NamedTuple):
    """What N measurements say beyond what was expected, one each: residuals, S, K."""

    residuals: np.ndarray
    covariances: np.ndarray
    gains: np.ndarray

    @property
    def distances(self):
        """(N,) squared Mahalanobis distances."""
        return mahalanobis_squared(self.residuals, self.covariances)

    @property
    def log_likelihoods(self):
        """(N,) natural logarithms of the density of each measurement."""
        logdet = np.linalg.slogdet(self.covariances)[1]
        size = self.residuals.shape[-1]
        return -0.5 * (self.distances + logdet + size * np.log(2 * np.pi))


def transposed(matrices):
    return np.swapaxes(matrices, -1, -2)


def predicted(beliefs, F, Q):
    """F x, F P F' + Q."""
    means = (F @ beliefs.means[..., None])[..., 0]
    return Gaussians(means, F @ beliefs.covariances @ transposed(F) + Q)


def innovations(beliefs, measured, H, R):
    residuals = measured - (H @ beliefs.means[..., None])[..., 0]
    crossed = beliefs.covariances @ transposed(H)
    covariances = H @ crossed + R
    gains = transposed(np.linalg.solve(covariances, transposed(crossed)))
    return Innovations(residuals, covariances, gains)


def updated(beliefs, innovation, H, R):
    """Take the measurements in; covariances in Joseph's form, which holds for any gain."""
    K = innovation.gains
    means = beliefs.means + (K @ innovation.residuals[..., None])[..., 0]
    I_minus_KH = np.eye(means.shape[-1]) - K @ H
    covariances = I_minus_KH @ beliefs.covariances @ transposed(I_minus_KH) + K @ R @ transposed(K)
    return Gaussians(means, covariances)


def mahalanobis_squared(residuals, covariances):
    """(...,) squared lengths of (..., M) residuals in units of (..., M, M) covariances."""
    weighed = np.linalg.solve(covariances, residuals[..., None])[..., 0]
    return (residuals * weighed).sum(axis=-1)
