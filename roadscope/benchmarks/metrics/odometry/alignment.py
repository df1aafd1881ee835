"""Which motion brings an estimated trajectory nearest to the true one."""

from __future__ import annotations

from typing import Literal

import numpy as np

from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories
from roadscope.core.names import unknown

Alignment = Literal["none", "origin", "yaw", "se3"]
ALIGNMENTS = ("none", "origin", "yaw", "se3")


def aligned(both: Trajectories, how: Alignment) -> np.ndarray:
    """Return the (N, 4, 4) estimated poses in the truth's frame.

    none: as they are, for poses told in the same frame. origin: first pose on first pose, which
    needs no look at the rest. yaw: the shift and the turn about z, se3: the whole motion, with
    the least sum of squared distances (Umeyama 1991, without scale).
    """
    if how not in ALIGNMENTS:
        raise ValueError(unknown("alignment", how, ALIGNMENTS))
    if how == "none" or not len(both):
        return both.estimate
    if how == "origin":
        moved: np.ndarray = both.truth[0] @ np.linalg.inv(both.estimate[0]) @ both.estimate
        return moved
    moved = (
        truth_from_estimate(both.estimate[:, :3, 3], both.truth[:, :3, 3], yaw_only=how == "yaw")
        @ both.estimate
    )
    return moved


def truth_from_estimate(
    estimate: np.ndarray, truth: np.ndarray, *, yaw_only: bool = False
) -> np.ndarray:
    """Return the (4, 4) motion that brings (N, 3) places nearest to others.

    Where places leave a turn open, all on one line, say, one of the best is returned.
    """
    centre, aim = estimate.mean(axis=0), truth.mean(axis=0)
    spread = (truth - aim).T @ (estimate - centre) / len(truth)
    matrix = np.eye(4)
    if yaw_only:
        yaw = np.arctan2(spread[1, 0] - spread[0, 1], spread[0, 0] + spread[1, 1])
        cos, sin = np.cos(yaw), np.sin(yaw)
        matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    else:
        left, _, right = np.linalg.svd(spread)
        mirror = np.sign(np.linalg.det(left) * np.linalg.det(right))
        matrix[:3, :3] = left @ np.diag([1.0, 1.0, mirror]) @ right
    matrix[:3, 3] = aim - matrix[:3, :3] @ centre
    return matrix
