"""Smoothing of finished trajectories."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.pose import wrap_angle
from roadscope.trackers.offline_noise import MOTION, carried
from roadscope.trackers.offline_trajectories import Trajectory


@dataclass(frozen=True, slots=True)
class Rescoring:
    """How tracks are told anew; round figures set by hand, for tracks of any tracker.

    velocity_walk: m/s per root second by which velocities are taken to wander where nothing is
        known of that. It lies between what was learned of cars (0.85) and of cyclists (0.67);
        pedestrians (0.28) are smoothed less than they could be.
    fade_s: time over which heights and headings are averaged, to either side.
    size_fade_s: likewise sizes, of bodies that do not change.
    longest_gap_s: time over which fragments are joined.
    least_score: tracks whose mean score is lower are dropped.
    least_seen: tracks with fewer detections are dropped.
    """

    velocity_walk: float = 0.8
    fade_s: float = 0.3
    size_fade_s: float = 2.0
    longest_gap_s: float = 2.5
    least_score: float = 0.6
    least_seen: int = 3


def smoothed(trajectory: Trajectory, rules: Rescoring) -> Trajectory:
    """Let every tick know of those after it; scores stay."""
    means, covariances = backward(
        trajectory.stamps_s, trajectory.means, trajectory.covariances, trajectory.walks,
        trajectory.drifts,
    )  # fmt: skip
    sure = trajectory.seen.astype(float)
    near = _shares(trajectory.stamps_s, sure, rules.fade_s)
    bodies = _shares(trajectory.stamps_s, sure, rules.size_fade_s)
    return replace(
        trajectory, means=means, covariances=covariances, heights=near @ trajectory.heights,
        sizes=bodies @ trajectory.sizes, yaws=_headings(trajectory.yaws, near, bodies),
    )  # fmt: skip


def backward(
    stamps_s: np.ndarray, means: np.ndarray, covariances: np.ndarray, walks: np.ndarray,
    drifts: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return (K, 4), (K, 4, 4) smoothed states from filtered ones (Rauch, Tung, Striebel 1965).

    walks, drifts: (K, 2, 2), as in `MotionNoise`, from each tick to the next.
    """
    x, P = means.copy(), covariances.copy()
    for k in range(len(x) - 2, -1, -1):
        dt = stamps_s[k + 1] - stamps_s[k]
        foretold, predicted = carried(means[k], covariances[k], walks[k], drifts[k], dt)
        F = MOTION.jacobian(x[:1], dt)
        gain = np.linalg.solve(predicted, F @ covariances[k]).T
        x[k] += gain @ (x[k + 1] - foretold)
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
