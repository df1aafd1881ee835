"""One Kalman filter for all tracks at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.tables import ArrayTable


@dataclass(frozen=True, slots=True, eq=False)
class Gaussians(ArrayTable):
    """The state estimates of N tracks.

    means: (N, D) float64.
    covariances: (N, D, D) float64, symmetric, positive definite.
    """

    means: np.ndarray
    covariances: np.ndarray

    def __len__(self) -> int:
        return len(self.means)

    @staticmethod
    def empty(dimensions: int) -> Gaussians:
        """Return no estimates, of states with D dimensions."""
        return Gaussians(np.empty((0, dimensions)), np.empty((0, dimensions, dimensions)))


def predicted(estimates: Gaussians, F: np.ndarray, Q: np.ndarray) -> Gaussians:
    """Return estimates after a time step: F x and F P F' + Q.

    F, Q: (D, D) for all tracks or (N, D, D) for each.
    """
    means, covariances = _contiguous(estimates)
    D = means.shape[1]
    return Gaussians(*_predicted(means, covariances, F.reshape(-1, D, D), Q.reshape(-1, D, D)))


def corrected(
    estimates: Gaussians, measured: np.ndarray, H: np.ndarray, R: np.ndarray
) -> Gaussians:
    """Return estimates after one measurement of each track.

    measured: (N, M). The caller wraps angles: they must lie near the expected ones.
    H: (M, D), the measurement is H x plus noise.
    R: (M, M) covariance of the noise for all tracks, or (N, M, M) for each.
    """
    return corrected_with_likelihood(estimates, measured, H, R)[0]


def corrected_with_likelihood(
    estimates: Gaussians, measured: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[Gaussians, np.ndarray]:
    """Return what `corrected` returns and the (N,) log-likelihoods of the measurements."""
    means, covariances = _contiguous(estimates)
    M = measured.shape[1]
    means, covariances, log_likelihoods = _corrected(
        means, covariances, np.ascontiguousarray(measured), H, R.reshape(-1, M, M)
    )
    return Gaussians(means, covariances), log_likelihoods


def _contiguous(estimates: Gaussians) -> tuple[np.ndarray, np.ndarray]:
    """Return means and covariances in C order, for which alone the kernels are compiled."""
    return np.ascontiguousarray(estimates.means), np.ascontiguousarray(estimates.covariances)


@compiled()
def _predicted(
    means: np.ndarray, covariances: np.ndarray, F: np.ndarray, Q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return F x and F P F' + Q; F and Q are (1 or N, D, D) and F is sparse."""
    after, spread = np.zeros_like(means), np.empty_like(covariances)
    D = means.shape[1]
    FP = np.empty((D, D))
    for n in range(len(means)):
        f, q = F[n % len(F)], Q[n % len(Q)]
        FP[:] = 0
        spread[n] = q
        for i in range(D):
            for k in range(D):
                if f[i, k] != 0:
                    after[n, i] += f[i, k] * means[n, k]
                    for j in range(D):
                        FP[i, j] += f[i, k] * covariances[n, k, j]
        for i in range(D):
            for k in range(D):
                if f[i, k] != 0:
                    for j in range(i, D):
                        spread[n, i, j] += f[i, k] * FP[j, k]
            for j in range(i):
                spread[n, i, j] = spread[n, j, i]
    return after, spread


@compiled()
def _corrected(
    means: np.ndarray, covariances: np.ndarray, measured: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means, covariances and log-likelihoods.

    With the Cholesky factor S = L L' of the innovation covariance, W = L^-1 H P and w = L^-1 times
    the residual, the mean grows by W'w, the covariance shrinks by W'W, and w'w is the squared
    Mahalanobis distance. H is sparse, and so is W where parts of the state are independent.
    """
    N, D = means.shape
    M = measured.shape[1]
    after, spread, log_likelihoods = means.copy(), covariances.copy(), np.empty(N)
    L, W, w = np.empty((M, M)), np.empty((M, D)), np.empty(M)
    h_rows, h_columns = np.nonzero(H)
    for n in range(N):
        P, r = covariances[n], R[n % len(R)]
        w[:], W[:], L[:] = measured[n], 0, r
        for k in range(len(h_rows)):
            a, i = h_rows[k], h_columns[k]
            w[a] -= H[a, i] * means[n, i]
            for j in range(D):
                W[a, j] += H[a, i] * P[i, j]
        for k in range(len(h_rows)):
            b, i = h_rows[k], h_columns[k]
            for a in range(b, M):
                L[a, b] += H[b, i] * W[a, i]
        half_log_determinant = _divide_by_cholesky_factor(L, W, w)
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
        log_likelihoods[n] = -0.5 * (distance + M * np.log(2 * np.pi)) - half_log_determinant
    return after, spread, log_likelihoods


@compiled()
def _divide_by_cholesky_factor(S: np.ndarray, W: np.ndarray, w: np.ndarray) -> float:
    """Divide (M, D) W and (M,) w by the Cholesky factor L of S in place; return log det L.

    Only the lower half of S is read; it is overwritten with L.
    """
    log_determinant = 0.0
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
        log_determinant += np.log(S[a, a])
        w[a] /= S[a, a]
        for j in range(W.shape[1]):
            W[a, j] /= S[a, a]
    return log_determinant
