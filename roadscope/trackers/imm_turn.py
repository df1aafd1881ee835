"""Constant turn rate and velocity, with the velocity along x and y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.motion import ConstantVelocity, sinc, sinc_slope

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Turns a vector by a right angle, to the left."""


@dataclass(frozen=True, slots=True)
class CartesianTurn:
    """State x, y, vx, vy, yaw rate: the motion of `CoordinatedTurn` in other coordinates.

    Here the first four mean the same as in the other models, so that estimates can be mixed, and
    a target at rest needs no heading.

    velocity_walk, turn_walk: m/s and rad/s per root second, by which velocity and yaw rate wander.
    turn_rad_s: standard deviation of the yaw rate at first.
    """

    velocity_walk: float = 0.5
    turn_walk: float = 0.3
    turn_rad_s: float = 0.3

    @property
    def dimensions(self) -> int:
        """5."""
        return 5

    def started(
        self,
        places: np.ndarray,
        yaws: np.ndarray,
        *,
        position_m: float,
        speed_m_s: np.ndarray | float,
    ) -> Gaussians:
        """Begin with a velocity and a yaw rate of 0, more or less."""
        straight = ConstantVelocity().started(
            places, yaws, position_m=position_m, speed_m_s=speed_m_s
        )
        covariances = np.zeros((len(places), 5, 5))
        covariances[:, :4, :4] = straight.covariances
        covariances[:, 4, 4] = self.turn_rad_s**2
        return Gaussians(np.pad(straight.means, ((0, 0), (0, 1))), covariances)

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Drive along the chord, which points half the turn aside of the velocity."""
        half, velocity = means[:, 4] * dt / 2, means[:, 2:4, None]
        after = means.copy()
        after[:, :2] += (_chord(half, dt) @ velocity)[..., 0]
        after[:, 2:4] = (_rotation(2 * half) @ velocity)[..., 0]
        return after

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, 5, 5)."""
        half, velocity = means[:, 4] * dt / 2, means[:, 2:4, None]
        slope = dt * sinc_slope(half)[:, None, None] * _rotation(half)
        slope = (slope + QUARTER @ _chord(half, dt)) * dt / 2
        F = np.tile(np.eye(5), (len(means), 1, 1))
        F[:, :2, 2:4] = _chord(half, dt)
        F[:, 2:4, 2:4] = _rotation(2 * half)
        F[:, :2, 4:] = slope @ velocity
        F[:, 2:4, 4:] = dt * QUARTER @ F[:, 2:4, 2:4] @ velocity
        return F

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (5, 5)."""
        Q = np.zeros((5, 5))
        Q[:4, :4] = ConstantVelocity(self.velocity_walk).noise(means, dt)
        Q[4, 4] = dt * self.turn_walk**2
        return Q

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Leave the yaw rate out."""
        return Gaussians(beliefs.means[:, :4], beliefs.covariances[:, :4, :4])


def _chord(half: np.ndarray, dt: float) -> np.ndarray:
    """Return (N, 2, 2) from velocity to displacement; half: the angle turned through, halved."""
    chord: np.ndarray = dt * sinc(half)[:, None, None] * _rotation(half)
    return chord


def _rotation(angles: np.ndarray) -> np.ndarray:
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    rotation: np.ndarray = c * np.eye(2) + s * QUARTER
    return rotation
