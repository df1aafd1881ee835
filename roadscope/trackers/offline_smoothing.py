"""Smoothing of finished trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core.pose import wrap_angle
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.offline_trajectories import Trajectory


def smoothed(
    trajectory: Trajectory, velocity_walk: float, fade_s: float, size_fade_s: float
) -> Trajectory:
    """Let every tick know of those after it; scores stay."""
    means, covariances = backward(
        trajectory.stamps_s, trajectory.means, trajectory.covariances, velocity_walk
    )
    sure = trajectory.seen.astype(float)
    near = _shares(trajectory.stamps_s, sure, fade_s)
    bodies = _shares(trajectory.stamps_s, sure, size_fade_s)
    return replace(
        trajectory, means=means, covariances=covariances, heights=near @ trajectory.heights,
        sizes=bodies @ trajectory.sizes, yaws=_headings(trajectory.yaws, near, bodies),
    )  # fmt: skip


def backward(
    stamps_s: np.ndarray, means: np.ndarray, covariances: np.ndarray, velocity_walk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (K, 4), (K, 4, 4) smoothed states from filtered ones (Rauch, Tung, Striebel 1965)."""
    motion = ConstantVelocity(velocity_walk)
    x, P = means.copy(), covariances.copy()
    for k in range(len(x) - 2, -1, -1):
        dt = stamps_s[k + 1] - stamps_s[k]
        F = motion.jacobian(x[:1], dt)
        predicted = F @ covariances[k] @ F.T + motion.noise(x[:1], dt)
        gain = np.linalg.solve(predicted, F @ covariances[k]).T
        x[k] += gain @ (x[k + 1] - F @ means[k])
        spread = P[k] + gain @ (P[k + 1] - predicted) @ gain.T
        P[k] = _proper(0.5 * (spread + spread.T), covariances[k])
    return x, P


def _proper(smoothed: np.ndarray, filtered: np.ndarray) -> np.ndarray:
    """Fall back on the filter's where its own noise was another than the smoother's."""
    return smoothed if np.linalg.eigvalsh(smoothed)[0] > 0 else filtered


def _shares(stamps_s: np.ndarray, weights: np.ndarray, fade_s: float) -> np.ndarray:
    """Return (K, K) with which share each tick counts for each, fading to either side."""
    shares = np.exp(-np.abs(stamps_s[:, None] - stamps_s) / fade_s) * weights
    normed: np.ndarray = shares / shares.sum(axis=1, keepdims=True)
    return normed


def _headings(yaws: np.ndarray, near: np.ndarray, all_over: np.ndarray) -> np.ndarray:
    """Return (K,) headings: axes averaged up to half turns, fronts by a majority further around."""
    double = near @ np.column_stack([np.cos(2 * yaws), np.sin(2 * yaws)])
    axes = 0.5 * np.arctan2(double[:, 1], double[:, 0])
    agree = (all_over * np.cos(yaws[None] - axes[:, None])).sum(axis=1)
    return wrap_angle(np.where(agree < 0, axes + np.pi, axes))
