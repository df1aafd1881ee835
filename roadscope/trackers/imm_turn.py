"""Constant turn rate and velocity, with the velocity along x and y."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.motion import ConstantVelocity, Start


@dataclass(frozen=True, slots=True)
class CartesianTurn:
    """State x, y, vx, vy, yaw rate: the motion of `CoordinatedTurn` in other coordinates.

    Here the first four mean the same as in the other models, so that estimates can be mixed, and
    a target at rest needs no heading.

    velocity_walk, turn_walk: m/s and rad/s per root second, by which velocity and yaw rate wander.
    turn_rad_s: standard deviation of the yaw rate at first.
    """

    dimensions: ClassVar[int] = 5
    velocity_walk: float = 0.5
    turn_walk: float = 0.3
    turn_rad_s: float = 0.3

    def started(self, start: Start) -> Gaussians:
        """Begin with a velocity and a yaw rate of 0, more or less."""
        straight = ConstantVelocity().started(start)
        covariances = np.zeros((len(start.places), 5, 5))
        covariances[:, :4, :4] = straight.covariances
        covariances[:, 4, 4] = self.turn_rad_s**2
        return Gaussians(np.pad(straight.means, ((0, 0), (0, 1))), covariances)

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Drive along the chord, which points half the turn aside of the velocity."""
        return _turned(np.ascontiguousarray(means), dt)[0]

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, 5, 5)."""
        return _turned(np.ascontiguousarray(means), dt)[1]

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (5, 5)."""
        Q = np.zeros((5, 5))
        Q[:4, :4] = ConstantVelocity(self.velocity_walk).noise(means, dt)
        Q[4, 4] = dt * self.turn_walk**2
        return Q

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Leave the yaw rate out."""
        return Gaussians(beliefs.means[:, :4], beliefs.covariances[:, :4, :4])


@compiled()
def _turned(means: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 5) states after dt seconds and (N, 5, 5) their derivatives.

    h: half the angle turned through; the chord is dt sin(h) / h long for each m/s.
    """
    after, F = means.copy(), np.zeros((len(means), 5, 5))
    for n in range(len(means)):
        vx, vy, turn = means[n, 2], means[n, 3], means[n, 4]
        h = turn * dt / 2
        near = abs(h) < 1e-3
        length = 1 - h * h / 6 if near else np.sin(h) / h
        # The formula would cancel near 0; the series' next term is below 1e-10 there.
        slope = -h / 3 if near else (np.cos(h) - length) / h
        c, s = np.cos(h), np.sin(h)
        along, across = dt * length * c, dt * length * s
        further, aside = dt / 2 * (dt * slope * c - across), dt / 2 * (dt * slope * s + along)
        cos, sin = np.cos(2 * h), np.sin(2 * h)
        after[n, 0] += along * vx - across * vy
        after[n, 1] += across * vx + along * vy
        after[n, 2], after[n, 3] = cos * vx - sin * vy, sin * vx + cos * vy
        for k in range(5):
            F[n, k, k] = 1.0
        F[n, 0, 2] = F[n, 1, 3] = along
        F[n, 0, 3], F[n, 1, 2] = -across, across
        F[n, 2, 2] = F[n, 3, 3] = cos
        F[n, 2, 3], F[n, 3, 2] = -sin, sin
        F[n, 0, 4], F[n, 1, 4] = further * vx - aside * vy, aside * vx + further * vy
        F[n, 2, 4], F[n, 3, 4] = -dt * after[n, 3], dt * after[n, 2]
    return after, F
