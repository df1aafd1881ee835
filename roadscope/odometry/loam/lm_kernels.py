"""Levenberg and Marquardt's method on distances from lines and planes (Zhang 2022, eq. 9-10)."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.loam.pair_kernels import Pairs

STEPS = 4
"""Steps between two looks for neighbours."""
FIRST_LAMBDA, SHRUNK, RAISED = 1e-4, 0.3, 10.0
TUKEY = 4.685
"""Robust deviations from which on a pair counts for nothing: the bisquare's for 95 % efficiency."""
DEVIATION = 1.4826
"""Standard deviations a median of absolute values (normal distribution)."""
FLOOR = 1e-9
"""Added to the diagonal, so that what no pair holds stays where it is."""


@compiled()
def distances(pairs: Pairs, matrix: np.ndarray) -> np.ndarray:
    """Return the distance of each pair, (K,) metres, under a (4, 4) motion."""
    away, off = np.empty(len(pairs.points)), np.empty(2)
    for n in range(len(away)):
        _off(pairs, matrix, n, off)
        away[n] = np.sqrt(off[0] * off[0] + off[1] * off[1])
    return away


@compiled()
def bisquare(away: np.ndarray, least: float, wider: float) -> np.ndarray:
    """Return the weights, (K,) 1/m^2, of pairs by their distances: Tukey's bisquare.

    Their scatter is told by the median, but is `least` at least. wider: than 95 % efficiency asks.
    """
    weights = np.empty(len(away))
    if len(away) == 0:
        return weights
    deviation = max(DEVIATION * np.median(away), least)
    for n in range(len(away)):
        share = min(away[n] / (wider * TUKEY * deviation), 1.0)
        weights[n] = ((1.0 - share * share) / deviation) ** 2
    return weights


@compiled()
def normal_equations(
    pairs: Pairs, weights: np.ndarray, matrix: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return J'WJ (6, 6), J'Wd (6,) and the sum of weighted squares.

    The unknowns are a shift, metres, and a turn about the sensor, radians, along the axes of
    the frame that the (4, 4) motion leads to.
    """
    H, b, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    off, j, q = np.empty(2), np.empty(6), np.empty(3)
    for n in range(len(pairs.points)):
        if weights[n] <= 0.0:
            continue
        _off(pairs, matrix, n, off)
        for i in range(3):
            q[i] = (
                matrix[i, 0] * pairs.points[n, 0]
                + matrix[i, 1] * pairs.points[n, 1]
                + matrix[i, 2] * pairs.points[n, 2]
            )
        for k in range(2):
            a0, a1, a2 = pairs.axes[n, k]
            if a0 == 0.0 and a1 == 0.0 and a2 == 0.0:
                continue
            j[0], j[1], j[2] = a0, a1, a2
            j[3], j[4], j[5] = q[1] * a2 - q[2] * a1, q[2] * a0 - q[0] * a2, q[0] * a1 - q[1] * a0
            for r in range(6):
                b[r] += weights[n] * j[r] * off[k]
                for c in range(r, 6):
                    H[r, c] += weights[n] * j[r] * j[c]
            cost += weights[n] * off[k] * off[k]
    for r in range(6):
        for c in range(r):
            H[r, c] = H[c, r]
    return H, b, cost


@compiled()
def descend(pairs: Pairs, weights: np.ndarray, start: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the (4, 4) motion after some steps down from a start; only what is free moves."""
    matrix, damping = start.copy(), FIRST_LAMBDA
    H, b, cost = normal_equations(pairs, weights, matrix)
    for _ in range(STEPS):
        damped = H.copy()
        for r in range(6):
            damped[r, r] += damping * H[r, r] + FLOOR
            if not free[r]:
                damped[r, :] = 0.0
                damped[:, r] = 0.0
                damped[r, r] = 1.0
        step = -np.linalg.solve(damped, np.where(free, b, 0.0))
        tried = moved(matrix, step)
        H_there, b_there, cost_there = normal_equations(pairs, weights, tried)
        if cost_there < cost:
            matrix, H, b, cost = tried, H_there, b_there, cost_there
            damping *= SHRUNK
        else:
            damping *= RAISED
    return matrix


@compiled()
def moved(matrix: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return a (4, 4) motion shifted and turned by a (6,) step along the axes it leads to."""
    angle = np.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    once = np.sin(angle) / angle if angle > 1e-8 else 1.0
    twice = (1 - np.cos(angle)) / (angle * angle) if angle > 1e-8 else 0.5
    across = np.zeros((3, 3))
    across[0, 1], across[0, 2], across[1, 2] = -step[5], step[4], -step[3]
    across[1, 0], across[2, 0], across[2, 1] = step[5], -step[4], step[3]
    result = matrix.copy()
    turn = np.eye(3) + once * across + twice * (across @ across)
    result[:3, :3] = turn @ np.ascontiguousarray(matrix[:3, :3])
    result[:3, 3] += step[:3]
    return result


@compiled()
def _off(pairs: Pairs, matrix: np.ndarray, n: int, off: np.ndarray) -> None:
    """Fill how far a pair's point lies from its anchor along both axes."""
    off[:] = 0.0
    for i in range(3):
        place = matrix[i, 3] - pairs.anchors[n, i]
        for j in range(3):
            place += matrix[i, j] * pairs.points[n, j]
        off[0] += pairs.axes[n, 0, i] * place
        off[1] += pairs.axes[n, 1, i] * place
