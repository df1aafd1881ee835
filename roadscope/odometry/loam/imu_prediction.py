"""How a LiDAR moved from one scan to the next, before that is looked at (Zhang 2022, eq. 3)."""

from __future__ import annotations

import numpy as np

from roadscope.core import ImuSamples, Pose
from roadscope.core.jit import compiled
from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.rigid import exp_se3, exp_so3, log_so3

BIAS_GAIN = 0.05
GRAVITY_GAIN = 0.01
"""Shares of what a step shows that are learned: gravity from noisy speeds, so more slowly."""


class ImuPrediction:
    """Integrates turn rates once and specific forces twice over the time between two scans.

    Reading taken: the paper takes the way from the IMU and names no initial speed; it is that of
    the last step of the odometry. Gravity, the accelerometer's bias with it, and the gyro's bias
    are learned from steps. Where samples lack the motion goes on at constant velocity.

    velocity: (3,) m/s, turning: (3,) rad/s, now, lidar frame.
    """

    def __init__(self, lidar_from_imu: Pose | None) -> None:
        self.samples = ImuBuffer(lidar_from_imu)
        self._lever = np.zeros(3) if lidar_from_imu is None else lidar_from_imu.translation.copy()
        self.velocity, self.turning = np.zeros(3), np.zeros(3)
        self._bias, self._gravity = np.zeros(3), np.full(3, np.nan)
        self._end_velocity, self._rate, self._force = np.zeros(3), np.zeros(3), np.full(3, np.nan)

    def add(self, imu: ImuSamples | None) -> None:
        """Take further samples."""
        self.samples.add(imu)

    def motion(self, start_s: float, end_s: float) -> np.ndarray:
        """Return (4, 4) `before_from_now`, from the last scan to the one at the end."""
        elapsed_s = end_s - start_s
        self._force[:] = np.nan
        if not self.samples.covers(start_s, end_s):
            self._end_velocity = exp_so3(-self.turning * elapsed_s) @ self.velocity
            return exp_se3(np.concatenate([self.velocity, self.turning]) * elapsed_s)
        lengths, rates, forces = self.samples.within(start_s, end_s)
        self._rate = lengths @ rates / elapsed_s
        if np.isnan(self._gravity[0]):
            self._gravity = lengths @ forces / elapsed_s
        state = np.array([self.velocity, self._gravity, self._lever, self._bias])
        moved, self._end_velocity, self._force = _integrated(lengths, rates, forces, state)
        return moved

    def learn(self, predicted: np.ndarray, found: np.ndarray, elapsed_s: float) -> None:
        """Take the motion that the scans showed in place of the one that was predicted."""
        back = found[:3, :3].T
        start, measured = self.velocity, not np.isnan(self._force[0])
        off = back @ (found[:3, 3] - predicted[:3, 3]) / elapsed_s
        self.velocity = self._end_velocity + off
        self.turning = log_so3(found[:3, :3]) / elapsed_s
        if not measured:
            self._end_velocity = self.velocity = back @ found[:3, 3] / elapsed_s
            return
        self._bias = self._bias + BIAS_GAIN * (self._rate - self._bias - self.turning)
        gained = (self.velocity - back @ start) / elapsed_s
        seen = back @ self._force - gained
        self._gravity = back @ self._gravity
        self._gravity += GRAVITY_GAIN * (seen - self._gravity)

    def carry_on(self, predicted: np.ndarray, elapsed_s: float) -> None:
        """Believe the prediction."""
        self.velocity = self._end_velocity
        self.turning = log_so3(predicted[:3, :3]) / elapsed_s
        if not np.isnan(self._force[0]):
            self._gravity = predicted[:3, :3].T @ self._gravity


@compiled()
def _integrated(
    lengths: np.ndarray, rates: np.ndarray, forces: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return motion (4, 4), speed at the end (3,), its frame, and mean force (3,), first frame.

    lengths: (K,) s. rates, forces: (K, 3). state: (4, 3) speed, gravity, place of the IMU and
    bias of its gyro.
    """
    velocity, gravity, lever, bias = (
        state[0].copy(),
        state[1].copy(),
        state[2].copy(),
        state[3].copy(),
    )
    first = rates[0] - bias
    speed = velocity + np.cross(first, lever)
    turned, place, force, whole = np.eye(3), np.zeros(3), np.zeros(3), lengths.sum()
    for k in range(len(lengths)):
        dt = lengths[k]
        rate = rates[k] - bias
        # Half a step's turn: forces act in the middle of it.
        felt = turned @ (forces[k] + 0.5 * dt * np.cross(rate, forces[k]))
        force += felt * dt / whole
        place += speed * dt + 0.5 * dt * dt * (felt - gravity)
        speed += dt * (felt - gravity)
        turned = turned @ _turn(rate * dt)
    moved = np.eye(4)
    moved[:3, :3] = turned
    moved[:3, 3] = place + lever - turned @ lever
    last = rates[len(rates) - 1] - bias
    return moved, turned.T @ speed - np.cross(last, lever), force


@compiled()
def _turn(vector: np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation of a small rotation vector, (3,) radians."""
    angle = np.sqrt((vector**2).sum())
    x, y, z = vector
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    once = 1.0 - angle**2 / 6.0
    twice = 0.5 - angle**2 / 24.0
    rotation: np.ndarray = np.eye(3) + once * across + twice * (across @ across)
    return rotation
