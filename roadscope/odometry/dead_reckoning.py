"""Dead reckoning from the IMU alone."""

from __future__ import annotations

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.clock import Clock, ScanTick
from roadscope.odometry.estimates import estimate, propagated_covariance
from roadscope.odometry.imu_buffer import NO_SAMPLES, ImuBuffer
from roadscope.odometry.inertial.filter import GRAVITY_M_S2
from roadscope.odometry.rigid import exp_so3, inverse, orthonormal

REST_S = 1.0
"""Longest time at the start over which samples are averaged while they are constant. Chosen by
hand."""
REST_RATE_RAD_S, REST_FORCE_M_S2 = 0.02, 0.15
"""Samples count as constant while the mean rate and force of each interval differ from those since
the start by at most this along each axis. Chosen by hand."""
RATE_RAD_SQRT_S, FORCE_M_S_SQRT_S = 2.4e-4, 2.3e-3
"""Noise densities of an ADIS16448 by its data sheet, for the covariance: rad/s and m/s2 per root
hertz."""
RATE_BIAS_RAD_S, FORCE_BIAS_M_S2 = 1e-3, 0.03
"""Standard deviations of the biases after a rest. Chosen by hand."""


class DeadReckoningOdometry:
    """Integrates turn rate and specific force from a start at rest: a lower mark.

    While samples are constant after the start they are averaged: their mean rate is the gyro's
    bias, their mean force is gravity plus the accelerometer's bias. An IMU does not measure speed,
    so a drive that begins at speed is treated as one from rest. Without samples the speed is
    assumed to be constant, and the estimate is degraded.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear pose, speed and biases."""
        self._clock, self._imu = Clock(), ImuBuffer(lidar_from_imu)
        self._lever = np.zeros(3) if lidar_from_imu is None else lidar_from_imu.translation.copy()
        self._pose, self._covariance = np.eye(4), np.zeros((6, 6))
        self._position, self._velocity, self._bias = self._lever.copy(), np.zeros(3), np.zeros(3)
        self._gravity: np.ndarray | None = None
        self._sums, self._rested_s, self._moving_s = np.zeros(6), 0.0, 0.0
        self._at_rest = True

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Integrate up to the stamp of the scan; its points are not used."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), tick.reason)
        reason = self._advance(scan.stamp_s, tick)
        return estimate(self._pose, self._covariance, scan.stamp_s, len(scan), reason)

    def _advance(self, stamp_s: float, tick: ScanTick) -> str:
        if not tick.elapsed_s:
            return ""
        before = self._pose.copy()
        start_s = stamp_s - tick.elapsed_s
        covered = self._imu.covers(start_s, stamp_s)
        if covered:
            samples = self._imu.within(start_s, stamp_s)
            if not (self._at_rest and self._still_at_rest(*samples)):
                self._integrate(*samples)
        else:
            self._position = self._position + self._velocity * tick.elapsed_s
            self._set_pose(self._pose[:3, :3])
        self._moving_s += 0.0 if self._at_rest else tick.elapsed_s
        motion = inverse(before) @ self._pose
        self._covariance = propagated_covariance(
            self._covariance, motion, self._motion_covariance(tick.elapsed_s)
        )
        return tick.reason if covered else NO_SAMPLES

    def _still_at_rest(self, lengths: np.ndarray, rates: np.ndarray, forces: np.ndarray) -> bool:
        """Add an interval to the means while samples are constant; return whether they are."""
        elapsed_s = float(lengths.sum())
        mean = lengths @ np.hstack([rates, forces]) / elapsed_s
        means = self._sums / self._rested_s if self._rested_s else mean
        change = np.abs(mean - means)
        moving = change[:3].max() > REST_RATE_RAD_S or change[3:].max() > REST_FORCE_M_S2
        self._at_rest = not moving and self._rested_s < REST_S
        if self._at_rest or not self._rested_s:
            self._sums = self._sums + mean * elapsed_s
            self._rested_s += elapsed_s
        means = self._sums / self._rested_s
        self._bias, self._gravity = means[:3], means[3:]
        return self._at_rest

    def _integrate(self, lengths: np.ndarray, rates: np.ndarray, forces: np.ndarray) -> None:
        """Integrate position and velocity of the IMU, with forces rotated to the start frame."""
        assert self._gravity is not None
        rotation, position, velocity = self._pose[:3, :3], self._position, self._velocity
        for length_s, rate, force in zip(lengths, rates - self._bias, forces, strict=True):
            turned = rotation @ exp_so3(rate * length_s)
            acceleration = (rotation + turned) / 2 @ force - self._gravity
            position = position + velocity * length_s + acceleration * length_s**2 / 2
            velocity, rotation = velocity + acceleration * length_s, turned
        self._position, self._velocity = position, velocity
        self._set_pose(rotation)

    def _set_pose(self, rotation: np.ndarray) -> None:
        """Set the pose of the LiDAR from the position of the IMU and its lever arm."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, self._position - rotation @ self._lever
        self._pose = orthonormal(pose)

    def _motion_covariance(self, elapsed_s: float) -> np.ndarray:
        """Return the (6, 6) covariance of the last motion by biases and noise since the start."""
        t = self._moving_s
        turned = RATE_BIAS_RAD_S * t + RATE_RAD_SQRT_S * np.sqrt(t)
        tilted = GRAVITY_M_S2 * turned
        speed = (FORCE_BIAS_M_S2 + tilted) * t + FORCE_M_S_SQRT_S * np.sqrt(t)
        turn = RATE_BIAS_RAD_S * elapsed_s + RATE_RAD_SQRT_S * np.sqrt(elapsed_s)
        spread: np.ndarray = np.diag([(speed * elapsed_s) ** 2] * 3 + [turn**2] * 3)
        return spread
