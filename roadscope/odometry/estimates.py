"""Estimates of odometries: records, covariances, and scans with too few points."""

from __future__ import annotations

import numpy as np

from roadscope.core import OdometryEstimate, OdometryStatus, Pose
from roadscope.odometry.rigid import adjoint, inverse, orthonormal


def estimate(
    pose: np.ndarray,
    covariance: np.ndarray,
    stamp_s: float,
    returns: int,
    reason: str = "",
    *,
    dynamic: np.ndarray | None = None,
) -> OdometryEstimate:
    """Return the record of a (4, 4) pose; degraded if there is a reason.

    dynamic: (N,) bool, returns of moving objects; None: none of them.
    """
    status = OdometryStatus.DEGRADED if reason else OdometryStatus.OK
    symmetric = (covariance + covariance.T) / 2
    moving = np.zeros(returns, bool) if dynamic is None else dynamic
    return OdometryEstimate(Pose(orthonormal(pose)), symmetric, moving, stamp_s, status, reason)


def propagated_covariance(
    covariance: np.ndarray, motion: np.ndarray, of_motion: np.ndarray
) -> np.ndarray:
    """Return the (6, 6) covariance of a pose after an uncertain motion.

    motion: (4, 4) `previous_from_now`; of_motion: (6, 6), in the frame now.
    """
    transform = adjoint(inverse(motion))
    result: np.ndarray = transform @ covariance @ transform.T + of_motion
    return result


def lack_of_points(points: int, least: int, rings: np.ndarray) -> str:
    """Return why a scan has too few points to be matched; empty if it has enough.

    points: number that can be matched. least: number that is needed. rings: (N,) of all returns.
    """
    if points < least:
        return f"only {points} points can be matched"
    if rings.min() == rings.max():
        return "all returns are of one ring"
    return ""
