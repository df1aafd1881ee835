"""Where steps from scan to scan have led so far."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.estimates import grown
from roadscope.odometry.loam.feature_match import FeatureMatch
from roadscope.odometry.loam.imu_prediction import ImuPrediction
from roadscope.odometry.rigid import inverse, log_se3

LEAST_PAIRS = 20
"""Fewer pairs of features cannot be told from chance."""
WEAKEST_M = 0.2
"""A way that features leave so uncertain in some level direction is not believed. Upwards, where
nothing but ground tells much, the prediction stands instead."""
SIMILAR = 50.0
"""So many features are worth one: neighbours err alike."""
ACCELERATION_M_S2, TURNING_RAD_S2 = 8.0, 2.0
"""What a prediction may miss at most: vehicles do not exceed it for long."""
WEAKEST_RAD = 0.05
"""A turn that features say may be off by so much, as a way by `WEAKEST_M`."""
SURE, PATIENCE = 5, 3
"""After so many steps in a row that went as predicted, so many scans in a row that say otherwise
are not believed; then it is the speed that was wrong."""


class Progress:
    """The pose at the last scan that was matched, and at the latest one.

    pose, covariance: (4, 4) `start_from_lidar` and (6, 6), at the latest scan. stamp_s: of the
    last scan that counts. begun: whether a step has told the speed.
    """

    def __init__(self, imu: ImuPrediction) -> None:
        self._imu = imu
        self.pose, self.covariance, self.stamp_s = np.eye(4), np.zeros((6, 6)), np.nan
        self._pose, self._covariance = self.pose, self.covariance
        self.begun = False
        self._agreed, self._doubted = 0, 0

    def since(self, stamp_s: float) -> float:
        """Return the time, s, since the last scan that counts; some where there is none."""
        return 1.0 if np.isnan(self.stamp_s) else stamp_s - self.stamp_s

    def predicted(self, stamp_s: float) -> np.ndarray:
        """Return the (4, 4) motion since the last scan that counts, to a stamp."""
        if np.isnan(self.stamp_s):
            return np.eye(4)
        return self._imu.motion(self.stamp_s, stamp_s)

    def step(
        self, predicted: np.ndarray, found: FeatureMatch, stamp_s: float
    ) -> tuple[np.ndarray, str]:
        """Go on as features say; where they say too little, as predicted, with the reason.

        Returns the (4, 4) motion `before_from_now` that is believed, and the reason. What leaps
        beside a sure prediction is not believed for a while: all that is seen may move along.
        """
        poor, elapsed_s = misfit_of(found), stamp_s - self.stamp_s
        motion = predicted if poor else settled(predicted, found)
        leap, sure = leap_of(predicted, motion, elapsed_s), self._agreed >= SURE
        if poor or (leap and sure and self._doubted < PATIENCE):
            self._doubted += bool(leap)
            self.carry_on(predicted, stamp_s, counts=True)
            return predicted, poor or leap
        self._agreed, self._doubted = (0 if leap else self._agreed + 1), 0
        self._imu.learn(predicted, motion, elapsed_s)
        self._arrive(motion, covariance_of(found))
        self._count(stamp_s)
        self.begun = True
        return motion, leap if sure else ""

    def carry_on(self, predicted: np.ndarray, stamp_s: float, *, counts: bool) -> None:
        """Go on as predicted; counts: whether the next step begins here or where this one did."""
        elapsed_s = 0.0 if np.isnan(self.stamp_s) else stamp_s - self.stamp_s
        spread = np.array([ACCELERATION_M_S2] * 3 + [TURNING_RAD_S2] * 3) * elapsed_s**2
        self._arrive(predicted, np.diag(spread**2))
        if counts and elapsed_s > 0:
            self._imu.carry_on(predicted, elapsed_s)
        if counts:
            self._count(stamp_s)

    def _arrive(self, motion: np.ndarray, uncertain: np.ndarray) -> None:
        self.pose = self._pose @ motion
        self.covariance = grown(self._covariance, motion, uncertain)

    def _count(self, stamp_s: float) -> None:
        self._pose, self._covariance, self.stamp_s = self.pose, self.covariance, stamp_s


def leap_of(predicted: np.ndarray, motion: np.ndarray, elapsed_s: float) -> str:
    """Say how far a motion is beside the one predicted if no vehicle could do that; else empty."""
    beside = log_se3(inverse(predicted) @ motion)
    away_m, turned = np.linalg.norm(beside[:3]), np.linalg.norm(beside[3:])
    if away_m > WEAKEST_M + ACCELERATION_M_S2 * elapsed_s**2:
        return f"a leap of {away_m:.2g} m beside the prediction"
    if turned > WEAKEST_RAD + TURNING_RAD_S2 * elapsed_s**2:
        return f"a leap of {turned:.2g} rad beside the prediction"
    return ""


def covariance_of(found: FeatureMatch) -> np.ndarray:
    """Return the (6, 6) covariance of a motion along the axes of the frame now."""
    axes = np.kron(np.eye(2), found.before_from_now[:3, :3])
    information = axes.T @ found.information @ axes / SIMILAR
    covariance: np.ndarray = np.linalg.inv(information + 1e-6 * np.eye(6))
    return covariance


def settled(predicted: np.ndarray, found: FeatureMatch) -> np.ndarray:
    """Return the (4, 4) motion found, but its way as predicted where features leave it open.

    J. Zhang, M. Kaess and S. Singh, "On degeneracy of optimization-based state estimation
    problems", ICRA 2016.
    """
    motion = found.before_from_now.copy()
    rotation = motion[:3, :3]
    variances, axes = np.linalg.eigh(rotation @ covariance_of(found)[:3, :3] @ rotation.T)
    known = axes[:, variances < WEAKEST_M**2]
    motion[:3, 3] = predicted[:3, 3] + known @ known.T @ (motion[:3, 3] - predicted[:3, 3])
    return motion


def misfit_of(found: FeatureMatch) -> str:
    """Say why a motion is not to be believed; empty if it is."""
    if found.held < LEAST_PAIRS:
        return f"{found.held} features that match"
    weakest_m = float(np.sqrt(np.linalg.eigvalsh(covariance_of(found)[:2, :2])[-1]))
    if weakest_m > WEAKEST_M:
        return f"features leave {weakest_m:.2g} m open in one direction"
    return ""
