"""Kernels of `ExistenceTracker`: all targets, one after the other."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled()
def ellipses(yaws: np.ndarray, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Return (N, 2, 2) covariances with (N,) standard deviations along and across headings."""
    found = np.empty((len(yaws), 2, 2))
    for i in range(len(yaws)):
        c, s = np.cos(yaws[i]), np.sin(yaws[i])
        a, b = along[i] ** 2, across[i] ** 2
        found[i, 0, 0] = c * c * a + s * s * b
        found[i, 1, 1] = s * s * a + c * c * b
        found[i, 0, 1] = found[i, 1, 0] = c * s * (a - b)
    return found


@compiled()
def moved_on(
    means: np.ndarray, covariances: np.ndarray, wander: np.ndarray, drift: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Move (N, 4) states x, y, vx, vy on by dt seconds at constant velocity.

    wander: (N, 2, 2), covariance of how far velocities wander in a second.
    drift: (N, 2, 2), likewise of how far places do beyond that.
    """
    moved, spread = means.copy(), np.empty_like(covariances)
    for i in range(len(means)):
        P = covariances[i]
        for a in range(2):
            moved[i, a] += dt * means[i, 2 + a]
            for b in range(2):
                q = wander[i, a, b]
                crossed = P[a, 2 + b] + dt * P[2 + a, 2 + b]
                far = P[a, b] + dt * P[2 + a, b] + dt * crossed
                spread[i, a, b] = far + q * dt**3 / 3 + drift[i, a, b] * dt
                spread[i, a, 2 + b] = spread[i, 2 + b, a] = crossed + q * dt**2 / 2
                spread[i, 2 + a, 2 + b] = P[2 + a, 2 + b] + q * dt
    return moved, spread


@compiled()
def corrected(
    means: np.ndarray, covariances: np.ndarray, places: np.ndarray, errors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Take (N, 2) measured places in, with (N, 2, 2) covariances of their errors.

    Returns states, their covariances and (N,) squared Mahalanobis distances of the innovations.
    """
    after, spread, distances = means.copy(), np.empty_like(covariances), np.empty(len(means))
    gain = np.empty((4, 2))
    for i in range(len(means)):
        P = covariances[i]
        a, c = P[0, 0] + errors[i, 0, 0], P[1, 1] + errors[i, 1, 1]
        b = P[0, 1] + errors[i, 0, 1]
        determinant = a * c - b * b
        x, y = places[i, 0] - means[i, 0], places[i, 1] - means[i, 1]
        distances[i] = (c * x * x - 2 * b * x * y + a * y * y) / determinant
        for k in range(4):
            gain[k, 0] = (P[k, 0] * c - P[k, 1] * b) / determinant
            gain[k, 1] = (P[k, 1] * a - P[k, 0] * b) / determinant
            after[i, k] += gain[k, 0] * x + gain[k, 1] * y
        for k in range(4):
            for j in range(k + 1):
                taken = gain[k, 0] * (a * gain[j, 0] + b * gain[j, 1])
                taken += gain[k, 1] * (b * gain[j, 0] + c * gain[j, 1])
                spread[i, k, j] = spread[i, j, k] = P[k, j] - taken
    return after, spread, distances


@compiled()
def looked_at(
    before: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    found: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    size_memory: float,
    heading_memory: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Take in what (N, 7) detected boxes say of heights, headings and sizes.

    A detection says its axis well and its front poorly: the axis is filtered up to half turns,
    and fronts are voted for.

    before: heights and yaws (N, 2), fronts (N,), sizes (N, 3) and their weights (N,) of `Targets`,
        which are returned as they are then.
    found: boxes, and (N,) scores, weights of sizes, variances of heights and of yaws.
    size_memory, heading_memory: what a size rests on at most, what a vote is worth a tick later.
    """
    heights, yaws, fronts, sizes, totals = before
    boxes, scores, weights, climbs, turns = found
    heights, yaws, fronts, sizes = heights.copy(), yaws.copy(), fronts.copy(), sizes.copy()
    totals = totals.copy()
    for i in range(len(boxes)):
        _weigh(heights, i, boxes[i, 2] - heights[i, 0], climbs[i])
        off = _wrapped(boxes[i, 6] - yaws[i, 0])
        vote = scores[i]
        if abs(off) > np.pi / 2:
            off, vote = _wrapped(off + np.pi), -vote
        _weigh(yaws, i, off, turns[i])
        front = heading_memory * fronts[i] + vote
        yaws[i, 0] = _wrapped(yaws[i, 0] + (np.pi if front < 0 else 0.0))
        fronts[i] = abs(front)
        totals[i] = min(totals[i], size_memory) + weights[i]
        for k in range(3):
            sizes[i, k] += weights[i] / totals[i] * (boxes[i, 3 + k] - sizes[i, k])
    return heights, yaws, fronts, sizes, totals


@compiled(borrowing=True)
def _weigh(beliefs: np.ndarray, i: int, residual: float, variance: float) -> None:
    """Take a measurement in mean and variance i (scalar Kalman filter)."""
    gain = beliefs[i, 1] / (beliefs[i, 1] + variance)
    beliefs[i, 0] += gain * residual
    beliefs[i, 1] *= 1 - gain


@compiled(borrowing=True)
def _wrapped(angle: float) -> float:
    """Return the same angle in -pi to pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


@compiled()
def hidden_shares(
    boxes: np.ndarray, asked: np.ndarray, solid: np.ndarray, eye: np.ndarray
) -> np.ndarray:
    """Return (N,) which share of each target's width nearer solid ones cover, seen from an eye.

    boxes: (N, 7) as in `Tracklets`; asked: (N,) bool, whose share is wanted, others have 0;
    solid: (N,) bool, who is believed to be there; eye: (2,).
    """
    n = len(boxes)
    bearing, half, range_m = np.empty(n), np.empty(n), np.empty(n)
    shares = np.zeros(n)
    before = np.flatnonzero(solid)
    for i in range(n):
        if asked[i] or solid[i]:
            dx, dy = boxes[i, 0] - eye[0], boxes[i, 1] - eye[1]
            bearing[i], range_m[i] = np.arctan2(dy, dx), max(np.hypot(dx, dy), 1e-3)
            turn = boxes[i, 6] - bearing[i]
            width = boxes[i, 3] * abs(np.sin(turn)) + boxes[i, 4] * abs(np.cos(turn))
            half[i] = np.arctan2(width / 2, range_m[i])
    bearings, halves, ranges = bearing[before], half[before], range_m[before]
    for i in range(n):
        if not asked[i]:
            continue
        for j in range(len(before)):
            if ranges[j] >= range_m[i]:
                continue  # So is one's own.
            apart = abs(bearings[j] - bearing[i])
            apart = min(apart, 2 * np.pi - apart)
            if apart >= half[i] + halves[j]:
                continue
            covered = min(half[i], apart + halves[j]) - max(-half[i], apart - halves[j])
            shares[i] += covered / (2 * half[i])
    return np.minimum(shares, 1.0)
