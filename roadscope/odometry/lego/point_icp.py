"""Points onto points, the nearest to the nearest (Besl and McKay 1992)."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.rigid import exp_se3, log_se3

STEPS = 30
KEPT = 0.8
"""Share of the pairs, the nearest ones, that counts: what one scan alone saw has none."""


def onto(points: np.ndarray, target: np.ndarray, start: np.ndarray, reach_m: float) -> np.ndarray:
    """Return the (4, 4) `target_from_points` that brings (N, 3) points onto (M, 3) others.

    start: (4, 4), whence to look. reach_m: pairs that lie farther apart do not count.
    """
    from scipy.spatial import cKDTree

    pose, tree = start.copy(), cKDTree(target)
    for _ in range(STEPS):
        there = points @ pose[:3, :3].T + pose[:3, 3]
        away, nearest = tree.query(there, distance_upper_bound=reach_m)
        bound = np.quantile(away[np.isfinite(away)], KEPT) if np.isfinite(away).any() else 0.0
        held = away <= bound
        if held.sum() < 6:
            return pose
        move = between(there[held], target[nearest[held]])
        pose = move @ pose
        if np.abs(log_se3(move)).max() < 1e-3:
            break
    return pose


def overlap(points: np.ndarray, target: np.ndarray, pose: np.ndarray, within_m: float) -> float:
    """Return the share of (N, 3) points that a (4, 4) motion brings so near to one of others."""
    from scipy.spatial import cKDTree

    there = points @ pose[:3, :3].T + pose[:3, 3]
    away, _ = cKDTree(target).query(there, distance_upper_bound=within_m)
    return float(np.isfinite(away).mean())


def between(points: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the (4, 4) motion that brings (N, 3) points nearest to as many others, in pairs."""
    centre, aim = points.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - aim).T @ (points - centre))
    motion = exp_se3(np.zeros(6))
    motion[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    motion[:3, 3] = aim - motion[:3, :3] @ centre
    return motion
