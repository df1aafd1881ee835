"""Motion models and the filter of positions that uses one of them.

All states begin with x, y, vx, vy, in metres and metres per second, in a frame that stands still
or is assumed to. Process noise is that of a white acceleration (or jerk, or yaw acceleration) in
continuous time, so two short steps add as much variance as one long step, whatever the period of
the sensor. Its strength is called a walk: the standard deviation that a velocity (an acceleration,
a yaw rate) gains in one second, which grows with the square root of time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from roadscope.core import Category, Detections, Family
from roadscope.core.arguments import check_positive
from roadscope.core.jit import compiled
from roadscope.trackers import _kalman as kalman
from roadscope.trackers._kalman import Gaussians

PLANAR = 4
"""Length of the part x, y, vx, vy that all states have in common."""


class NewTracks(NamedTuple):
    """What the first detections of N tracks say.

    positions: (N, 2) x and y, metres.
    position_m: standard deviation of a detected position along each axis.
    speed_m_s: standard deviation of the velocity along each axis, of all tracks or (N,) of each.
    """

    positions: np.ndarray
    position_m: float
    speed_m_s: np.ndarray | float


class MotionModel(Protocol):
    """How N tracks move in a time step of dt seconds."""

    @property
    def dimensions(self) -> int:
        """Length D of the state."""

    def started(self, new: NewTracks) -> Gaussians:
        """Return estimates of N tracks that were detected once: at rest, with a wide spread."""

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, D) states after dt seconds."""

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F, the derivative of `moved`: (D, D) for all tracks or (N, D, D)."""

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return Q, the covariance that dt seconds add: (D, D) for all tracks or (N, D, D)."""


def predicted_by_model(motion: MotionModel, estimates: Gaussians, dt: float) -> Gaussians:
    """Return estimates after dt seconds: f(x) and F P F' + Q (extended Kalman filter)."""
    F, Q = motion.jacobian(estimates.means, dt), motion.noise(estimates.means, dt)
    after = kalman.predicted(estimates, F, Q)
    if F.ndim == 2:
        return after
    return Gaussians(motion.moved(estimates.means, dt), after.covariances)


def planar(estimates: Gaussians) -> Gaussians:
    """Return estimates of x, y, vx, vy alone."""
    if estimates.means.shape[1] == PLANAR:
        return estimates
    return Gaussians(estimates.means[:, :PLANAR], estimates.covariances[:, :PLANAR, :PLANAR])


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """State x, y, vx, vy.

    velocity_walk: m/s per root second, of each component of the velocity.
    """

    dimensions: ClassVar[int] = 4
    velocity_walk: float = 1.0

    def started(self, new: NewTracks) -> Gaussians:
        """Return estimates with velocity 0 and the standard deviation `speed_m_s`."""
        return _at_rest(new.positions, [new.position_m, new.speed_m_s])

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F x."""
        after: np.ndarray = means @ self.jacobian(means, dt).T
        return after

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F."""
        return _for_both_axes([[1, dt], [0, 1]])

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return Q."""
        Q = [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]
        return _for_both_axes(Q) * self.velocity_walk**2


@dataclass(frozen=True, slots=True)
class ConstantAcceleration:
    """State x, y, vx, vy, ax, ay.

    acceleration_walk: m/s2 per root second, of each component of the acceleration.
    acceleration_m_s2: standard deviation of the first acceleration along each axis.
    """

    dimensions: ClassVar[int] = 6
    acceleration_walk: float = 1.0
    acceleration_m_s2: float = 2.0

    def started(self, new: NewTracks) -> Gaussians:
        """Return estimates with velocity 0 and acceleration 0."""
        deviations = [new.position_m, new.speed_m_s, self.acceleration_m_s2]
        return _at_rest(new.positions, deviations)

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F x."""
        after: np.ndarray = means @ self.jacobian(means, dt).T
        return after

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return F."""
        return _for_both_axes([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return Q."""
        Q = [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
        return _for_both_axes(Q) * self.acceleration_walk**2


@dataclass(frozen=True, slots=True)
class CoordinatedTurn:
    """State x, y, vx, vy, yaw rate: constant yaw rate and speed.

    The heading is that of the velocity, so a track at rest needs none.

    velocity_walk, turn_walk: m/s and rad/s per root second, of velocity and yaw rate.
    turn_rad_s: standard deviation of the first yaw rate.
    """

    dimensions: ClassVar[int] = 5
    velocity_walk: float = 0.5
    turn_walk: float = 0.3
    turn_rad_s: float = 0.3

    def started(self, new: NewTracks) -> Gaussians:
        """Return estimates with velocity 0 and yaw rate 0."""
        straight = ConstantVelocity().started(new)
        covariances = np.zeros((len(new.positions), 5, 5))
        covariances[:, :4, :4] = straight.covariances
        covariances[:, 4, 4] = self.turn_rad_s**2
        return Gaussians(np.pad(straight.means, ((0, 0), (0, 1))), covariances)

    def moved(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return states moved along the chord, which is half the turn away from the velocity."""
        return _turned(np.ascontiguousarray(means), dt)[0]

    def jacobian(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (N, 5, 5) F."""
        return _turned(np.ascontiguousarray(means), dt)[1]

    def noise(self, means: np.ndarray, dt: float) -> np.ndarray:
        """Return (5, 5) Q."""
        Q = np.zeros((5, 5))
        Q[:4, :4] = ConstantVelocity(self.velocity_walk).noise(means, dt)
        Q[4, 4] = dt * self.turn_walk**2
        return Q


@compiled()
def _turned(means: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 5) states after dt seconds and their (N, 5, 5) derivatives.

    h is half the angle of the turn; the chord is dt sin(h) / h long for each m/s.
    """
    after, F = means.copy(), np.zeros((len(means), 5, 5))
    for n in range(len(means)):
        vx, vy, yaw_rate = means[n, 2], means[n, 3], means[n, 4]
        h = yaw_rate * dt / 2
        # Near 0 the formula would cancel: the next term of its series is below 1e-10 there.
        is_small = abs(h) < 1e-3
        sinc = 1 - h * h / 6 if is_small else np.sin(h) / h
        sinc_slope = -h / 3 if is_small else (np.cos(h) - sinc) / h
        c, s = np.cos(h), np.sin(h)
        along, across = dt * sinc * c, dt * sinc * s
        along_slope = dt / 2 * (dt * sinc_slope * c - across)
        across_slope = dt / 2 * (dt * sinc_slope * s + along)
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
        F[n, 0, 4] = along_slope * vx - across_slope * vy
        F[n, 1, 4] = across_slope * vx + along_slope * vy
        F[n, 2, 4], F[n, 3, 4] = -dt * after[n, 3], dt * after[n, 2]
    return after, F


def _for_both_axes(block: list[list[float]]) -> np.ndarray:
    """Return a matrix over x, y, vx, vy, ... from the (K, K) matrix of one axis."""
    one = np.asarray(block, np.float64)
    both = np.zeros((2 * len(one), 2 * len(one)))
    both[::2, ::2] = both[1::2, 1::2] = one
    return both


def _at_rest(positions: np.ndarray, deviations: list[np.ndarray | float]) -> Gaussians:
    """Return states at (N, 2) positions whose derivatives are 0.

    deviations: standard deviations of the position and of each derivative, of all or (N,) of each.
    """
    n, orders = len(positions), len(deviations)
    means = np.column_stack([positions, np.zeros((n, 2 * orders - 2))])
    columns = [np.broadcast_to(np.asarray(each, np.float64), n) for each in deviations]
    spread = np.repeat(np.column_stack(columns), 2, axis=1)
    return Gaussians(means, np.eye(2 * orders) * spread[:, None] ** 2)


RELATIVE_SPEEDS = {Family.VEHICLE: 1.0, Family.CYCLIST: 0.4, Family.PEDESTRIAN: 0.15}
"""How fast road users of each family are, relative to vehicles; chosen by hand."""
_RELATIVE_SPEED_OF_CATEGORY = np.array([RELATIVE_SPEEDS[category.family] for category in Category])


@dataclass(frozen=True, slots=True)
class PositionFilter:
    """Kalman filter that measures x and y of a detection's centre, with any motion model.

    position_m: standard deviation of the measurement along each axis.
    speed_m_s: standard deviation of the velocity of a new vehicle along each axis; that of
        cyclists and pedestrians is smaller by `RELATIVE_SPEEDS`.
    """

    position_m: float = 0.3
    speed_m_s: float = 15.0
    motion: MotionModel = field(default_factory=ConstantVelocity)

    def __post_init__(self) -> None:
        check_positive(position_m=self.position_m, speed_m_s=self.speed_m_s)

    @property
    def H(self) -> np.ndarray:  # noqa: N802
        """(2, D): the measurement is x and y of the state."""
        return np.eye(2, self.motion.dimensions)

    @property
    def R(self) -> np.ndarray:  # noqa: N802
        """(2, 2) covariance of a measurement."""
        return self.position_m**2 * np.eye(2)

    def started(self, detections: Detections) -> Gaussians:
        """Return estimates of N new tracks from one detection each."""
        speeds = self.speed_m_s * _RELATIVE_SPEED_OF_CATEGORY[detections.categories]
        return self.motion.started(NewTracks(detections.centres[:, :2], self.position_m, speeds))

    def predicted(self, estimates: Gaussians, dt: float) -> Gaussians:
        """Return estimates after dt seconds."""
        return predicted_by_model(self.motion, estimates, dt)

    def innovation_covariances(self, estimates: Gaussians) -> np.ndarray:
        """Return (N, 2, 2) covariances S of detected around expected positions."""
        S: np.ndarray = estimates.covariances[:, :2, :2] + self.R
        return S

    def corrected(self, estimates: Gaussians, positions: np.ndarray) -> Gaussians:
        """Return estimates after one measured position of each track, (N, 2)."""
        return kalman.corrected(estimates, positions, self.H, self.R)
