"""Eigenvalues of 3 x 3 symmetric matrices; faster than the call of LAPACK."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

SWEEPS = 8
"""Most rounds of rotations in all three planes."""
NEGLIGIBLE = 1e-24
"""Ratio of squares off the diagonal to those on it at which the iteration ends."""


@compiled(borrowing=True)
def eigen3(matrix: np.ndarray, values: np.ndarray, vectors: np.ndarray) -> None:
    """Write the eigenvalues, ascending, and unit eigenvectors, as rows, of a symmetric matrix.

    matrix: (3, 3), overwritten. values: (3,). vectors: (3, 3). By Jacobi's rotations.
    """
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
        on = matrix[0, 0] ** 2 + matrix[1, 1] ** 2 + matrix[2, 2] ** 2
        if off <= NEGLIGIBLE * on:
            break
        _rotate(matrix, vectors, 0, 1)
        _rotate(matrix, vectors, 0, 2)
        _rotate(matrix, vectors, 1, 2)
    for i in range(3):
        values[i] = matrix[i, i]
    _order(values, vectors, 0, 1)
    _order(values, vectors, 1, 2)
    _order(values, vectors, 0, 1)


@compiled(borrowing=True)
def _rotate(a: np.ndarray, vectors: np.ndarray, p: int, q: int) -> None:
    """Rotate in the plane of two axes so that their off-diagonal element becomes 0."""
    if a[p, q] == 0.0:
        return
    theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    sign = 1.0 if theta >= 0.0 else -1.0
    t = sign / (abs(theta) + np.sqrt(theta * theta + 1.0))
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    r = 3 - p - q
    apq = a[p, q]
    a[p, p] -= t * apq
    a[q, q] += t * apq
    a[p, q] = a[q, p] = 0.0
    arp, arq = a[r, p], a[r, q]
    a[r, p] = a[p, r] = c * arp - s * arq
    a[r, q] = a[q, r] = s * arp + c * arq
    for k in range(3):
        vp, vq = vectors[p, k], vectors[q, k]
        vectors[p, k] = c * vp - s * vq
        vectors[q, k] = s * vp + c * vq


@compiled(borrowing=True)
def _order(values: np.ndarray, vectors: np.ndarray, i: int, j: int) -> None:
    if values[i] <= values[j]:
        return
    values[i], values[j] = values[j], values[i]
    for k in range(3):
        vectors[i, k], vectors[j, k] = vectors[j, k], vectors[i, k]
