"""The error-state Kalman filter of a LiDAR with an inertial unit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.rigid import exp_so3, log_so3, orthonormal

if TYPE_CHECKING:
    from roadscope.envs.sensors.imu_spec import ImuSpec


# --------------------------------------------------------------------------------------------------
# Integration of inertial samples, and its derivatives.


@compiled()
def integrated(
    lengths: np.ndarray,
    rates: np.ndarray,
    forces: np.ndarray,
    rotation: np.ndarray,
    velocity: np.ndarray,
    gravity: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Integrate samples without their biases over an interval (Forster 2017, eq. 32).

    lengths: (K,) s. rates, forces: (K, 3) rad/s and m/s^2, the unit's frame. rotation: (3, 3)
    `map_from_imu` at the start. velocity, gravity: (3,) m/s and m/s^2, the map's frame; gravity
    points down.

    Returns displacement (3,) and velocity (3,), the map's frame, rotation (3, 3), and blocks
    (7, 3, 3), the derivatives of: rotation by the gyro's bias; velocity by rotation, the gyro's
    bias, the accelerometer's bias; displacement by the same three. Rotations are about the map's
    axes.
    """
    turned, speed, displacement = rotation.copy(), velocity.copy(), np.zeros(3)
    blocks = np.zeros((7, 3, 3))
    step, hat_force, turned_force, coupled = (
        np.empty((3, 3)),
        np.zeros((3, 3)),
        np.empty(3),
        np.empty((3, 3)),
    )
    for k in range(len(lengths)):
        dt = lengths[k]
        _fill_turn(rates[k] * dt, step)
        _force(turned, forces[k], rates[k] * (0.5 * dt), turned_force)
        _fill_hat(turned_force, hat_force)
        for i in range(3):
            for j in range(3):
                coupled[i, j] = (
                    hat_force[i, 0] * blocks[0, 0, j]
                    + hat_force[i, 1] * blocks[0, 1, j]
                    + hat_force[i, 2] * blocks[0, 2, j]
                )
        half = 0.5 * dt * dt
        for i in range(3):
            for j in range(3):
                blocks[4, i, j] += dt * blocks[1, i, j] - half * hat_force[i, j]
                blocks[5, i, j] += dt * blocks[2, i, j] - half * coupled[i, j]
                blocks[6, i, j] += dt * blocks[3, i, j] - half * turned[i, j]
                blocks[1, i, j] -= dt * hat_force[i, j]
                blocks[2, i, j] -= dt * coupled[i, j]
                blocks[3, i, j] -= dt * turned[i, j]
                blocks[0, i, j] -= dt * turned[i, j]
            gained = turned_force[i] + gravity[i]
            displacement[i] += dt * speed[i] + half * gained
            speed[i] += dt * gained
        turned = _product(turned, step)
    return displacement, speed, turned, blocks


@compiled()
def _force(
    turned: np.ndarray, force: np.ndarray, half_turn: np.ndarray, result: np.ndarray
) -> None:
    """Write a force along the map's axes, halfway through a step's turn."""
    x = force[0] + half_turn[1] * force[2] - half_turn[2] * force[1]
    y = force[1] + half_turn[2] * force[0] - half_turn[0] * force[2]
    z = force[2] + half_turn[0] * force[1] - half_turn[1] * force[0]
    for i in range(3):
        result[i] = turned[i, 0] * x + turned[i, 1] * y + turned[i, 2] * z


@compiled()
def _fill_hat(vector: np.ndarray, matrix: np.ndarray) -> None:
    """Write the matrix of the cross product with a vector; its diagonal stays as it is."""
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = -vector[2], vector[1], -vector[0]
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = vector[2], -vector[1], vector[0]


@compiled()
def _fill_turn(turn: np.ndarray, matrix: np.ndarray) -> None:
    """Write the rotation of a turn within a sample, radians; it is small, so a series is exact."""
    x, y, z = turn
    angle2 = x * x + y * y + z * z
    once = 1.0 - angle2 / 6.0 * (1.0 - angle2 / 20.0)
    twice = 0.5 - angle2 / 24.0 * (1.0 - angle2 / 30.0)
    matrix[0, 0] = 1.0 - twice * (y * y + z * z)
    matrix[1, 1] = 1.0 - twice * (x * x + z * z)
    matrix[2, 2] = 1.0 - twice * (x * x + y * y)
    matrix[0, 1], matrix[1, 0] = twice * x * y - once * z, twice * x * y + once * z
    matrix[0, 2], matrix[2, 0] = twice * x * z + once * y, twice * x * z - once * y
    matrix[1, 2], matrix[2, 1] = twice * y * z - once * x, twice * y * z + once * x


@compiled()
def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    c = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            c[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return c


# --------------------------------------------------------------------------------------------------
# The filter.

POSITION, TURN, SPEED = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO, FORCE, GRAVITY = slice(9, 12), slice(12, 15), slice(15, 18)
WHEELS = 18
POSE = slice(0, 6)
SIZE = 19
"""Rows of the errors in the state's covariance, and their number."""
GRAVITY_M_S2 = 9.81
TILTED_M_S2 = 0.2
"""Standard deviation of each component of the learned gravity after a restart."""
MARGIN = 1.1
"""Factor of the noise of a data sheet."""
WHEEL_SCALE = 0.02
"""Standard deviation of the radius of tyres, as a share."""


@dataclass(frozen=True, slots=True)
class InertialNoise:
    """Noise of an inertial unit; the defaults are those of an ADIS16448.

    rate, force: densities, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz). rate_walk, force_walk: random walks
    of their biases, rad/s and m/s^2 per root second. rate_bias, force_bias: standard deviations of
    the biases at the start, rad/s and m/s^2. accelerating: standard deviation of the vehicle's
    acceleration at the start, m/s^2.
    """

    rate: float = 2.5e-4
    force: float = 2.5e-3
    rate_walk: float = 2e-5
    force_walk: float = 3e-3
    rate_bias: float = 0.01
    force_bias: float = 0.2
    accelerating: float = 1.0

    @staticmethod
    def of(unit: ImuSpec) -> InertialNoise:
        """Return the noise of a data sheet plus a tenth, but at least a tenth of the defaults."""
        least = InertialNoise()
        return InertialNoise(
            *(
                max(MARGIN * stated, default / 10)
                for stated, default in (
                    (unit.gyro_noise, least.rate),
                    (unit.accelerometer_noise, least.force),
                    (unit.gyro_walk, least.rate_walk),
                    (unit.accelerometer_walk, least.force_walk),
                    (unit.gyro_turn_on, least.rate_bias),
                    (unit.accelerometer_turn_on, least.force_bias),
                )
            )
        )


@dataclass(slots=True)
class InertialState:
    """Pose, motion and biases with their covariance.

    pose: (4, 4) `map_from_imu`, the unit's frame turned to the LiDAR's axes. velocity: (3,) m/s of
        the unit, gravity: (3,) m/s^2, down; both the map's frame. rate_bias, force_bias: (3,).
        wheel_scale: relative error of the speed of wheels. covariance: (19, 19) of errors of
        position, rotation, velocity, biases of gyro and accelerometer, gravity, wheel scale. All
        except the biases are along the map's axes; the rotation turns about the unit.
    """

    pose: np.ndarray
    velocity: np.ndarray
    rate_bias: np.ndarray
    force_bias: np.ndarray
    gravity: np.ndarray
    covariance: np.ndarray = field(repr=False)
    wheel_scale: float = 0.0

    def copied(self) -> InertialState:
        """Return a copy of the state with its own arrays."""
        return InertialState(
            self.pose.copy(),
            self.velocity.copy(),
            self.rate_bias.copy(),
            self.force_bias.copy(),
            self.gravity.copy(),
            self.covariance.copy(),
            self.wheel_scale,
        )


class SpeedDeviations(NamedTuple):
    """Standard deviations of a velocity along the LiDAR's axes, m/s."""

    ahead: float
    left: float
    up: float


def started(
    force: np.ndarray, velocity: np.ndarray, speed_deviations: SpeedDeviations, noise: InertialNoise
) -> InertialState:
    """Return the state at the first scan.

    force: (3,) mean specific force, m/s^2: gravity and the vehicle's acceleration.
    velocity: (3,) m/s along the LiDAR's axes, with its standard deviations.
    """
    up = force / max(float(np.linalg.norm(force)), 1e-9)
    covariance = np.zeros((SIZE, SIZE))
    covariance[SPEED, SPEED] = np.diag(np.square(speed_deviations))
    covariance[GYRO, GYRO] = noise.rate_bias**2 * np.eye(3)
    covariance[FORCE, FORCE] = noise.force_bias**2 * np.eye(3)
    covariance[WHEELS, WHEELS] = WHEEL_SCALE**2
    horizontal = np.eye(3) - np.outer(up, up)
    # The bias is part of the specific force, so errors of both are correlated. The magnitude of
    # gravity is known to 0.01 m/s^2.
    covariance[GRAVITY, GRAVITY] = (
        noise.accelerating**2 + noise.force_bias**2
    ) * horizontal + 1e-4 * np.outer(up, up)
    covariance[GRAVITY, FORCE] = noise.force_bias**2 * horizontal
    covariance[FORCE, GRAVITY] = noise.force_bias**2 * horizontal
    return InertialState(
        np.eye(4),
        np.array(velocity, float),
        np.zeros(3),
        np.zeros(3),
        -GRAVITY_M_S2 * up,
        covariance,
    )


def resume(state: InertialState, earlier: InertialState, *, with_gravity: bool = True) -> None:
    """Copy what an earlier state has learned to a state at a new start: biases and gravity.

    The axes of the new map are those of the sensor at the earlier state. Other parts of the earlier
    state may be wrong and are not copied; gravity is copied only `with_gravity`. The standard
    deviation of the gyro's bias is doubled.
    """
    state.rate_bias = earlier.rate_bias.copy()
    state.covariance[GYRO, GYRO] = 4 * earlier.covariance[GYRO, GYRO]
    state.wheel_scale = earlier.wheel_scale
    state.covariance[WHEELS, WHEELS] = earlier.covariance[WHEELS, WHEELS]
    if not with_gravity:
        return
    down = earlier.pose[:3, :3].T @ earlier.gravity
    state.gravity = down * (GRAVITY_M_S2 / max(float(np.linalg.norm(down)), 1e-9))
    state.covariance[GRAVITY, GRAVITY] = TILTED_M_S2**2 * np.eye(3)
    state.covariance[GRAVITY, FORCE] = state.covariance[FORCE, GRAVITY] = 0.0


def propagate(
    state: InertialState,
    lengths: np.ndarray,
    rates: np.ndarray,
    forces: np.ndarray,
    noise: InertialNoise,
) -> None:
    """Predict a state over (K,) time steps, s, with (K, 3) rates and forces."""
    elapsed_s = float(lengths.sum())
    displacement, velocity, rotation, blocks = integrated(
        lengths,
        rates - state.rate_bias,
        forces - state.force_bias,
        np.ascontiguousarray(state.pose[:3, :3]),
        state.velocity,
        state.gravity,
    )
    state.pose[:3, 3] += displacement
    state.pose[:3, :3] = rotation
    state.velocity = velocity
    F = transition(blocks, elapsed_s)
    state.covariance = F @ state.covariance @ F.T + diffusion(elapsed_s, noise)


def transition(blocks: np.ndarray, elapsed_s: float) -> np.ndarray:
    """Return the (19, 19) transition matrix of errors over an interval."""
    F, unit = np.eye(SIZE), np.eye(3)
    F[TURN, GYRO] = blocks[0]
    F[SPEED, TURN], F[SPEED, GYRO], F[SPEED, FORCE] = blocks[1], blocks[2], blocks[3]
    F[POSITION, TURN], F[POSITION, GYRO], F[POSITION, FORCE] = blocks[4], blocks[5], blocks[6]
    F[POSITION, SPEED] = elapsed_s * unit
    F[SPEED, GRAVITY], F[POSITION, GRAVITY] = elapsed_s * unit, elapsed_s**2 / 2 * unit
    return F


def diffusion(elapsed_s: float, noise: InertialNoise) -> np.ndarray:
    """Return the (19, 19) process noise of an interval."""
    Q, unit, t = np.zeros((SIZE, SIZE)), np.eye(3), elapsed_s
    Q[TURN, TURN] = noise.rate**2 * t * unit
    Q[SPEED, SPEED] = noise.force**2 * t * unit
    Q[POSITION, POSITION] = noise.force**2 * t**3 / 3 * unit
    Q[POSITION, SPEED] = Q[SPEED, POSITION] = noise.force**2 * t**2 / 2 * unit
    Q[GYRO, GYRO] = noise.rate_walk**2 * t * unit
    Q[FORCE, FORCE] = noise.force_walk**2 * t * unit
    return Q


def coast(
    state: InertialState,
    rate: np.ndarray,
    elapsed_s: float,
    *,
    acceleration_m_s2: float,
    rotation_rad_s2: float,
) -> None:
    """Predict a state without samples, at constant velocity along the sensor's axes.

    rate: (3,) rad/s. acceleration_m_s2, rotation_rad_s2: standard deviations of the acceleration
    and of the change of rate.
    """
    turn = exp_so3(rate * elapsed_s)
    rotation = state.pose[:3, :3]
    body = rotation.T @ state.velocity
    state.pose[:3, 3] += (rotation @ exp_so3(rate * elapsed_s / 2) @ body) * elapsed_s
    state.pose[:3, :3] = rotation @ turn
    state.velocity = state.pose[:3, :3] @ body
    F, Q, unit, t = np.eye(SIZE), np.zeros((SIZE, SIZE)), np.eye(3), elapsed_s
    F[POSITION, SPEED] = t * unit
    Q[POSITION, POSITION] = (acceleration_m_s2 * t**2 / 2) ** 2 * unit
    Q[SPEED, SPEED] = (acceleration_m_s2 * t) ** 2 * unit
    Q[POSITION, SPEED] = Q[SPEED, POSITION] = acceleration_m_s2**2 * t**3 / 2 * unit
    Q[TURN, TURN] = (rotation_rad_s2 * t**2) ** 2 * unit
    state.covariance = F @ state.covariance @ F.T + Q


def update_pose(state: InertialState, pose: np.ndarray, information: np.ndarray) -> None:
    """Update a state with a (4, 4) pose: the likeliest one by measurement and prediction together.

    information: (6, 6) of the measurement alone, along the same axes as the covariance. The rest of
    the state is corrected by its correlation with the pose.
    """
    P = state.covariance
    prior = np.linalg.inv(P[POSE, POSE] + 1e-12 * np.eye(6))
    moved = np.concatenate(
        [pose[:3, 3] - state.pose[:3, 3], log_so3(pose[:3, :3] @ state.pose[:3, :3].T)]
    )
    posterior = np.linalg.inv(prior + information)
    gain = P[:, POSE] @ prior
    change = gain @ moved
    P = P - gain @ (P[POSE, POSE] - posterior) @ gain.T
    state.covariance = (P + P.T) / 2
    state.pose = orthonormal(pose)
    _shift(state, change)


def update_linear(
    state: InertialState, J: np.ndarray, residual: np.ndarray, variance: np.ndarray
) -> None:
    """Update a state with a linear measurement: residual = J error + noise.

    J: (K, 19). residual, variance: (K,).
    """
    P = state.covariance
    gain = P @ J.T @ np.linalg.inv(J @ P @ J.T + np.diag(variance))
    change = gain @ residual
    P = P - gain @ J @ P
    state.covariance = (P + P.T) / 2
    state.pose[:3, 3] += change[POSITION]
    state.pose[:3, :3] = exp_so3(change[TURN]) @ state.pose[:3, :3]
    state.pose = orthonormal(state.pose)
    _shift(state, change)


def _shift(state: InertialState, change: np.ndarray) -> None:
    """Correct all parts of the state except the pose."""
    state.velocity = state.velocity + change[SPEED]
    state.rate_bias = state.rate_bias + change[GYRO]
    state.force_bias = state.force_bias + change[FORCE]
    state.gravity = state.gravity + change[GRAVITY]
    state.wheel_scale += float(change[WHEELS])
