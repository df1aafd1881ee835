"""Odometry estimates."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.pose import Pose
from roadscope.core.record import Record


class OdometryStatus(StrEnum):
    """Whether an estimate was measured, or predicted because the scan did not determine it."""

    OK = "ok"
    DEGRADED = "degraded"


@dataclass(frozen=True, slots=True, eq=False)
class OdometryEstimate(Record):
    """The pose of the LiDAR that an odometry estimates from a scan.

    start_from_lidar: maps points of the LiDAR frame at the stamp into that of the first scan
        after a reset.
    covariance: (6, 6) float64, of a small motion in the LiDAR frame that would correct the pose:
        metres along x, y, z, then radians about them.
    dynamic: (N,) bool, returns of the scan that the odometry takes for moving objects.
    stamp_s: stamp of the scan, seconds since reset.
    status: degraded if the pose is predicted from earlier scans, wholly or in part.
    reason: why it is degraded, as text; empty if it is not.
    """

    start_from_lidar: Pose
    covariance: np.ndarray
    dynamic: np.ndarray
    stamp_s: float
    status: OdometryStatus = OdometryStatus.OK
    reason: str = ""

    def __post_init__(self) -> None:
        settle_arrays(self, covariance=(np.float64, (6, 6)), dynamic=(np.bool_, ("N",)))
        asymmetry = float(np.abs(self.covariance - self.covariance.T).max())
        scale = max(1.0, float(np.abs(self.covariance).max()))
        require(asymmetry <= 1e-9 * scale, self, "covariance", "a symmetric matrix", asymmetry)
        least = float(self.covariance.diagonal().min())
        require(least >= 0, self, "covariance", "variances of 0 or more", least)
        degraded = self.status is OdometryStatus.DEGRADED
        require(
            degraded == bool(self.reason),
            self,
            "reason",
            "a reason if the status is degraded, and none if it is ok",
            self.reason,
        )

    @property
    def ok(self) -> bool:
        """Whether the estimate was measured."""
        return self.status is OdometryStatus.OK
