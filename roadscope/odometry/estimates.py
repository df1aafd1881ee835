"""How an odometry's estimates come about from a pose and what is known of its motion."""

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
    """Make the record of a (4, 4) pose; degraded if there is a reason.

    dynamic: (N,) bool, returns held to be of things that move; None: not one of them.
    """
    status = OdometryStatus.DEGRADED if reason else OdometryStatus.OK
    symmetric = (covariance + covariance.T) / 2
    moving = np.zeros(returns, bool) if dynamic is None else dynamic
    return OdometryEstimate(Pose(orthonormal(pose)), symmetric, moving, stamp_s, status, reason)


def grown(covariance: np.ndarray, motion: np.ndarray, of_motion: np.ndarray) -> np.ndarray:
    """Return the (6, 6) covariance of a pose after a motion with a covariance of its own.

    motion: (4, 4) `previous_from_now`; of_motion: (6, 6), in the frame now.
    """
    carried = adjoint(inverse(motion))
    larger: np.ndarray = carried @ covariance @ carried.T + of_motion
    return larger


def poverty(points: int, least: int, rings: np.ndarray) -> str:
    """Say why a scan cannot tell where it was taken; empty if it may.

    points: how many can be matched, of the least that are needed. rings: (N,) of all returns.
    """
    if points < least:
        return f"{points} points that can be matched"
    if rings.min() == rings.max():
        return "returns of one ring alone"
    return ""
