"""How road users move between ticks: constant velocity, constant acceleration, constant turn.

All states begin with x, y in metres, in a frame that stands still or is taken to. Noise is that of
a white acceleration (or jerk, or yaw acceleration) in continuous time, so that two short steps
spread as much as a long one, whatever the sensor's period. Its strength is how far the quantity
wanders in a second, standard deviation, growing with the root of time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from roadscope.core.pose import wrap_angle
from roadscope.trackers.kalman import Gaussians, predicted


class Start(NamedTuple):
    """N targets seen for the first time.

    places: (N, 2); yaws: (N,) headings of the boxes.
    position_m, speed_m_s: standard deviations, along each axis; speeds of all or (N,).
    """

    places: np.ndarray
    yaws: np.ndarray
    position_m: float
    speed_m_s: np.ndarray | float


class Motion(Protocol):
    """A model of motion, for N targets at once."""

    @property
    def dimensions(self) -> int:
        """Length D of the state."""

    def started(self, start: Start) -> Gaussians:
        """Begin with N targets: standing still, more or less."""

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, D) states after dt seconds."""

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return the derivative of `moved`, (D, D) for all or (N, D, D)."""

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return the covariance that dt seconds add, (D, D) for all or (N, D, D)."""

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Return beliefs of x, y, vx, vy."""


def carried(motion: Motion, beliefs: Gaussians, dt: float) -> Gaussians:
    """Move beliefs on by dt seconds: f(x), F P F' + Q (extended Kalman filter)."""
    F, Q = motion.jacobian(beliefs.means, dt), motion.noise(beliefs.means, dt)
    ahead = predicted(beliefs, F, Q)
    if F.ndim == 2:
        return ahead
    return Gaussians(motion.moved(beliefs.means, dt), ahead.covariances)


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """State x, y, vx, vy.

    velocity_walk: m/s per root second, by which each component of the velocity wanders.
    """

    dimensions: ClassVar[int] = 4
    velocity_walk: float = 1.0

    def started(self, start: Start) -> Gaussians:
        """Begin with a velocity of 0, give or take `speed_m_s`."""
        return _standing(start.places, [start.position_m, start.speed_m_s])

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F x."""
        after: np.ndarray = means @ self.jacobian(means, dt).T
        return after

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F."""
        return both_axes([[1, dt], [0, 1]])

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return Q."""
        return both_axes(walk_covariance(dt)) * self.velocity_walk**2

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Return the state."""
        return beliefs


@dataclass(frozen=True, slots=True)
class ConstantAcceleration:
    """State x, y, vx, vy, ax, ay.

    acceleration_walk: m/s2 per root second, by which each component of the acceleration wanders.
    acceleration_m_s2: standard deviation of the acceleration at first, along each axis.
    """

    dimensions: ClassVar[int] = 6
    acceleration_walk: float = 1.0
    acceleration_m_s2: float = 2.0

    def started(self, start: Start) -> Gaussians:
        """Begin with velocity and acceleration of 0, more or less."""
        spread = [start.position_m, start.speed_m_s, self.acceleration_m_s2]
        return _standing(start.places, spread)

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F x."""
        after: np.ndarray = means @ self.jacobian(means, dt).T
        return after

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F."""
        return both_axes([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return Q."""
        Q = [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
        return both_axes(Q) * self.acceleration_walk**2

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Leave the acceleration out."""
        return Gaussians(beliefs.means[:, :4], beliefs.covariances[:, :4, :4])


@dataclass(frozen=True, slots=True)
class CoordinatedTurn:
    """State x, y, yaw, v, yaw rate: constant turn rate and velocity, CTRV.

    Straight on is the same formula, since all of it is written with sin(h) / h, h half the angle
    turned through.

    speed_walk, turn_walk: m/s and rad/s per root second, by which speed and yaw rate wander.
    yaw_rad, turn_rad_s: standard deviations of heading and yaw rate at first.
    """

    dimensions: ClassVar[int] = 5
    speed_walk: float = 1.0
    turn_walk: float = 0.3
    yaw_rad: float = 0.3
    turn_rad_s: float = 0.3

    def started(self, start: Start) -> Gaussians:
        """Begin with the box's heading; a speed below 0 drives backwards."""
        n, place_m = len(start.places), start.position_m
        spread = _spreads(n, [place_m, place_m, self.yaw_rad, start.speed_m_s, self.turn_rad_s])
        covariances = np.eye(5) * spread[:, None] ** 2
        return Gaussians(np.column_stack([start.places, start.yaws, np.zeros((n, 2))]), covariances)

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Drive along the chord: half the turn, v dt sin(h) / h ahead, the other half."""
        _, _, yaw, v, turn = means.T
        half = turn * dt / 2
        chord, direction = v * dt * _sinc(half), yaw + half
        after = means.copy()
        after[:, 0] += chord * np.cos(direction)
        after[:, 1] += chord * np.sin(direction)
        after[:, 2] = wrap_angle(yaw + turn * dt)
        return after

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, 5, 5)."""
        _, _, yaw, v, turn = means.T
        half = turn * dt / 2
        ahead = np.stack([np.cos(yaw + half), np.sin(yaw + half)], axis=-1)
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
        chord = (v * dt * _sinc(half))[:, None]
        F = np.tile(np.eye(5), (len(means), 1, 1))
        F[:, :2, 2] = chord * aside
        F[:, :2, 3] = dt * _sinc(half)[:, None] * ahead
        F[:, :2, 4] = dt / 2 * ((v * dt * _sinc_slope(half))[:, None] * ahead + chord * aside)
        F[:, 2, 4] = dt
        return F

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, 5, 5): speed wanders along the heading, heading with the yaw rate."""
        ahead = np.stack([np.cos(means[:, 2]), np.sin(means[:, 2])], axis=-1)
        (a, b), (_, c) = walk_covariance(dt)
        Q = np.zeros((len(means), 5, 5))
        Q[:, :2, :2] = a * self.speed_walk**2 * ahead[:, :, None] * ahead[:, None, :]
        Q[:, :2, 3] = Q[:, 3, :2] = b * self.speed_walk**2 * ahead
        Q[:, 3, 3] = c * self.speed_walk**2
        Q[:, 2, 2], Q[:, 4, 4] = a * self.turn_walk**2, c * self.turn_walk**2
        Q[:, 2, 4] = Q[:, 4, 2] = b * self.turn_walk**2
        return Q

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Turn speed and heading into a velocity, to first order."""
        x, y, yaw, v, _ = beliefs.means.T
        c, s = np.cos(yaw), np.sin(yaw)
        J = np.zeros((len(x), 4, 5))
        J[:, 0, 0] = J[:, 1, 1] = 1
        J[:, 2, 2], J[:, 2, 3] = -v * s, c
        J[:, 3, 2], J[:, 3, 3] = v * c, s
        covariances = J @ beliefs.covariances @ J.transpose(0, 2, 1)
        return Gaussians(np.column_stack([x, y, v * c, v * s]), covariances)


def walk_covariance(dt: float) -> np.ndarray:
    """Return (2, 2) covariance of a quantity and its rate after dt seconds of white noise."""
    return np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])


def both_axes(block: list[list[float]] | np.ndarray) -> np.ndarray:
    """Use one axis' (K, K) matrix for x and y, in a state x, y, vx, vy and so on."""
    one = np.asarray(block, np.float64)
    both = np.zeros((2 * len(one), 2 * len(one)))
    both[::2, ::2] = both[1::2, 1::2] = one
    return both


def _standing(places: np.ndarray, spread: list[np.ndarray | float]) -> Gaussians:
    """Return x, y with derivatives of 0; spread: standard deviations of each order."""
    n, orders = len(places), len(spread)
    means = np.column_stack([places, np.zeros((n, 2 * orders - 2))])
    spreads = np.repeat(_spreads(n, spread), 2, axis=1)
    return Gaussians(means, np.eye(2 * orders) * spreads[:, None] ** 2)


def _spreads(n: int, spread: list[np.ndarray | float]) -> np.ndarray:
    """Return (N, D) standard deviations, each given for all or for each of N."""
    return np.column_stack([np.broadcast_to(np.asarray(each, np.float64), n) for each in spread])


def _sinc(h: np.ndarray) -> np.ndarray:
    """Return sin(h) / h."""
    value: np.ndarray = np.sinc(h / np.pi)
    return value


def _sinc_slope(h: np.ndarray) -> np.ndarray:
    """Return the derivative of sin(h) / h, by its series where the formula would cancel."""
    near = np.abs(h) < 1e-3
    safe = np.where(near, 1.0, h)
    slope: np.ndarray = np.where(near, -h / 3, (np.cos(safe) - np.sinc(safe / np.pi)) / safe)
    return slope
