"""The Kalman filter of one target (Lu 2018, section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
"""Eq. 13: the state is (x, vx, y, vy)."""
SHOWN = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
"""From (x, vx, y, vy) to the order (x, y, vx, vy) of `Tracks`."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What the filter believes.

    sigma_p_m, sigma_m_m: standard deviations of place and of measurement (below eq. 16).
    acceleration_m_s2: standard deviation of the white acceleration between frames; 0 is the
        paper's eq. 8, which has no process noise.
    """

    sigma_p_m: float
    sigma_m_m: float
    acceleration_m_s2: float


class ConstantVelocityFilter:
    """A target that moves at constant velocity, wrapped around filterpy's `KalmanFilter`."""

    def __init__(
        self, noise: Noise, position: np.ndarray, velocity: np.ndarray, period_s: float
    ) -> None:
        """Start at a measured (2,) position with a guess of the (2,) velocity."""
        self._noise = noise
        self._kalman: Any = KalmanFilter(dim_x=4, dim_z=2)
        self._kalman.x = np.array([position[0], velocity[0], position[1], velocity[1]])
        self._kalman.H = H
        self._kalman.P = initial_covariance(noise.sigma_p_m, period_s)
        self._kalman.R = noise.sigma_m_m**2 * np.eye(2)

    @property
    def position(self) -> np.ndarray:
        """(2,) x, y in metres."""
        position: np.ndarray = self._kalman.x[[0, 2]]
        return position

    @property
    def velocity(self) -> np.ndarray:
        """(2,) vx, vy in m/s."""
        velocity: np.ndarray = self._kalman.x[[1, 3]]
        return velocity

    @velocity.setter
    def velocity(self, velocity: np.ndarray) -> None:
        self._kalman.x[[1, 3]] = velocity

    @property
    def covariance(self) -> np.ndarray:
        """(4, 4) of x, y, vx, vy."""
        covariance: np.ndarray = self._kalman.P[SHOWN]
        return covariance

    def predict(self, period_s: float) -> None:
        """Move on by one period (eq. 16 and 8)."""
        self._kalman.predict(
            F=transition(period_s), Q=process_noise(self._noise.acceleration_m_s2, period_s)
        )

    def update(self, position: np.ndarray) -> None:
        """Take a measured (2,) position (eq. 9 to 11)."""
        self._kalman.update(position)


@lru_cache(maxsize=8)
def transition(T: float) -> np.ndarray:
    """Return A (eq. 12)."""
    return _for_both_axes(1.0, T, 0.0, 1.0)


def initial_covariance(sigma_p: float, T: float) -> np.ndarray:
    """Return P (eq. 14), which the paper calls the initial state of the matrix."""
    return _for_both_axes(1.0, 1 / T, 1 / T, 2 / T**2) * sigma_p**2


@lru_cache(maxsize=8)
def process_noise(acceleration: float, T: float) -> np.ndarray:
    """Return the covariance of a white acceleration held for one period; 0 as in the paper."""
    return _for_both_axes(T**4 / 4, T**3 / 2, T**3 / 2, T**2) * acceleration**2


def _for_both_axes(a: float, b: float, c: float, d: float) -> np.ndarray:
    """Place a 2 x 2 block of one axis twice on the diagonal."""
    return np.array([[a, b, 0, 0], [c, d, 0, 0], [0, 0, a, b], [0, 0, c, d]])
