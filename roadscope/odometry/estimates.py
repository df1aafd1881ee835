"""What odometries share: records, covariances, limits, and scans with too few points."""

from __future__ import annotations

import numpy as np

from roadscope.core import OdometryEstimate, OdometryStatus, Pose
from roadscope.odometry.rigid import adjoint, inverse, orthonormal

LEAST_POINTS = 60
"""Least number of points for a match, and of those that lie on surfaces of the map. Chosen by
hand."""
LOST = 5
"""After this many rejected scans in a row an odometry is started again. Chosen by hand."""
WEAKEST_M = 0.2
"""With a larger standard deviation of a motion in some direction, the prediction is used instead.
Chosen by hand."""
SIMILAR = 50.0
"""So many returns or features have the weight of one independent measurement, because errors of
neighbours and of traffic are correlated. Chosen by hand."""


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


def covariance_of(pose: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Return the (6, 6) covariance of a match in the sensor's frame.

    pose: (4, 4), matched. information: (6, 6), of all points, along the axes of the map.
    """
    axes = np.kron(np.eye(2), pose[:3, :3])
    independent = axes.T @ information @ axes / SIMILAR
    covariance: np.ndarray = np.linalg.inv(independent + 1e-6 * np.eye(6))
    return covariance


def lack_of_points(points: int, rings: np.ndarray) -> str:
    """Return why a scan has too few points to be matched; empty if it has enough.

    points: number that can be matched. rings: (N,) of all returns.
    """
    if points < LEAST_POINTS:
        return f"only {points} points can be matched"
    if rings.min() == rings.max():
        return "all returns are of one ring"
    return ""
