"""One Kalman filter for all targets at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
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


def predicted(beliefs: Gaussians, F: np.ndarray, Q: np.ndarray) -> Gaussians:
    """Move beliefs on: F x, F P F' + Q; F and Q (D, D) for all or (N, D, D) for each."""
    means, covariances = _dense(beliefs)
    D = means.shape[1]
    return Gaussians(*_predicted(means, covariances, F.reshape(-1, D, D), Q.reshape(-1, D, D)))


def corrected(beliefs: Gaussians, measured: np.ndarray, H: np.ndarray, R: np.ndarray) -> Gaussians:
    """Take (N, M) measurements in; H (M, D); R (M, M) for all or (N, M, M) for each.

    Angles among measurements are the caller's to wrap: near to those expected.
    """
    return weighed(beliefs, measured, H, R)[0]


def weighed(
    beliefs: Gaussians, measured: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[Gaussians, np.ndarray]:
    """Likewise, with (N,) natural logarithms of how dense each measurement was expected there."""
    means, covariances = _dense(beliefs)
    M = measured.shape[1]
    R = R.reshape(-1, M, M)
    means, covariances, densities = _weighed(
        means, covariances, np.ascontiguousarray(measured), H, R
    )
    return Gaussians(means, covariances), densities


def _dense(beliefs: Gaussians) -> tuple[np.ndarray, np.ndarray]:
    """Kernels are compiled once, for arrays without gaps."""
    return np.ascontiguousarray(beliefs.means), np.ascontiguousarray(beliefs.covariances)


@compiled()
def _predicted(
    means: np.ndarray, covariances: np.ndarray, F: np.ndarray, Q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Do so; F and Q (1 or N, D, D). Most of F is 0 in every model of motion."""
    moved, spread = np.zeros_like(means), np.empty_like(covariances)
    D = means.shape[1]
    crossed = np.empty((D, D))
    for n in range(len(means)):
        f, q = F[n % len(F)], Q[n % len(Q)]
        crossed[:] = 0
        spread[n] = q
        for i in range(D):
            for k in range(D):
                if f[i, k] != 0:
                    moved[n, i] += f[i, k] * means[n, k]
                    for j in range(D):
                        crossed[i, j] += f[i, k] * covariances[n, k, j]
        for i in range(D):
            for k in range(D):
                if f[i, k] != 0:
                    for j in range(i, D):
                        spread[n, i, j] += f[i, k] * crossed[j, k]
            for j in range(i):
                spread[n, i, j] = spread[n, j, i]
    return moved, spread


@compiled()
def _weighed(
    means: np.ndarray, covariances: np.ndarray, measured: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means, covariances and logarithms of densities.

    With S = L L', W = L^-1 H P and w = L^-1 of the residual, the mean grows by W'w, the covariance
    shrinks by W'W, and w'w is the squared Mahalanobis distance. Most of H is 0, and much of W
    where the parts of a state know nothing of each other.
    """
    N, D = means.shape
    M = measured.shape[1]
    after, spread, densities = means.copy(), covariances.copy(), np.empty(N)
    L, W, w = np.empty((M, M)), np.empty((M, D)), np.empty(M)
    shown, column = np.nonzero(H)
    for n in range(N):
        P, r = covariances[n], R[n % len(R)]
        w[:], W[:], L[:] = measured[n], 0, r
        for k in range(len(shown)):
            a, i = shown[k], column[k]
            w[a] -= H[a, i] * means[n, i]
            for j in range(D):
                W[a, j] += H[a, i] * P[i, j]
        for k in range(len(shown)):
            b, i = shown[k], column[k]
            for a in range(b, M):
                L[a, b] += H[b, i] * W[a, i]
        log_root = _solve_triangles(L, W, w)
        distance = 0.0
        for a in range(M):
            distance += w[a] * w[a]
            for i in range(D):
                if W[a, i] != 0:
                    after[n, i] += W[a, i] * w[a]
                    for j in range(i, D):
                        spread[n, i, j] -= W[a, i] * W[a, j]
        for i in range(D):
            for j in range(i):
                spread[n, i, j] = spread[n, j, i]
        densities[n] = -0.5 * (distance + M * np.log(2 * np.pi)) - log_root
    return after, spread, densities


@compiled()
def _solve_triangles(S: np.ndarray, W: np.ndarray, w: np.ndarray) -> float:
    """Divide (M, D) W and (M,) w by Cholesky's root of S, in place; return its log determinant.

    Of S the lower half is read and overwritten.
    """
    log_root = 0.0
    for a in range(len(S)):
        for b in range(a + 1):
            total = S[a, b]
            for c in range(b):
                total -= S[a, c] * S[b, c]
            S[a, b] = np.sqrt(total) if a == b else total / S[b, b]
        for b in range(a):
            if S[a, b] != 0:
                w[a] -= S[a, b] * w[b]
                for j in range(W.shape[1]):
                    W[a, j] -= S[a, b] * W[b, j]
        log_root += np.log(S[a, a])
        w[a] /= S[a, a]
        for j in range(W.shape[1]):
            W[a, j] /= S[a, a]
    return log_root
