"""A body that turns: from ISO 8855 angles and their derivatives to what its points do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Turning:
    """Rotation at T instants.

    rotations: (T, 3, 3), of the body in the world.
    omega, alpha: (T, 3) rad/s and rad/s^2, angular velocity and acceleration, world frame.
    """

    rotations: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray

    @staticmethod
    def of(angles: np.ndarray, rates: np.ndarray, accelerations: np.ndarray) -> Turning:
        """Take (T, 3) yaw, pitch and roll in radians with their first two derivatives."""
        rotations = rotation_matrices(angles)
        yaw, pitch = angles[:, 0], angles[:, 1]
        left = np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)])
        ahead = np.column_stack(
            [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
        )
        yawing, pitching, rolling = (rate[:, None] for rate in rates.T)
        level = yawing * UP + pitching * left
        angular = [c[:, None] * axis for c, axis in zip(accelerations.T, (UP, left, ahead),
                                                        strict=True)]  # fmt: skip
        alpha = (
            sum(angular) + pitching * np.cross(yawing * UP, left) + rolling * np.cross(level, ahead)
        )
        return Turning(rotations, level + rolling * ahead, alpha)

    def velocity(self, arms: np.ndarray) -> np.ndarray:
        """(T, 3) velocity of the ends of (T, 3) arms that turn along, world frame."""
        return np.cross(self.omega, arms)

    def acceleration(self, arms: np.ndarray) -> np.ndarray:
        """(T, 3) acceleration of the ends of (T, 3) arms that turn along, world frame."""
        turned: np.ndarray = np.cross(self.alpha, arms) + np.cross(self.omega, self.velocity(arms))
        return turned


def rotation_matrices(angles: np.ndarray) -> np.ndarray:
    """(T, 3, 3) of (T, 3) yaw, pitch and roll, as `Pose.from_euler` turns."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
