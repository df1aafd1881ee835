"""Where inertial samples lead, and how that depends on what is known badly."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled()
def integrated(
    lengths: np.ndarray, rates: np.ndarray, forces: np.ndarray,
    rotation: np.ndarray, velocity: np.ndarray, gravity: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Integrate samples that are freed of biases, over a stretch (Forster 2017, eq. 32).

    lengths: (K,) s. rates, forces: (K, 3) rad/s and m/s^2, the unit's frame. rotation: (3, 3)
    `map_from_imu` at the start. velocity, gravity: (3,) m/s and m/s^2, the map's frame; gravity
    points down.

    Returns way (3,) and velocity (3,), the map's frame, rotation (3, 3), and blocks (7, 3, 3): how
    turn, velocity and way answer to an error of, in this order: turn to the gyro's bias; velocity
    to turn, the gyro's bias, the accelerometer's bias; way to the same three. Turns are about the
    map's axes.
    """
    turned, speed, way = rotation.copy(), velocity.copy(), np.zeros(3)
    blocks = np.zeros((7, 3, 3))
    step, across, felt, bent = np.empty((3, 3)), np.zeros((3, 3)), np.empty(3), np.empty((3, 3))
    for k in range(len(lengths)):
        dt = lengths[k]
        _fill_turn(rates[k] * dt, step)
        _force(turned, forces[k], rates[k] * (0.5 * dt), felt)
        _fill_hat(felt, across)
        for i in range(3):
            for j in range(3):
                bent[i, j] = (
                    across[i, 0] * blocks[0, 0, j]
                    + across[i, 1] * blocks[0, 1, j]
                    + across[i, 2] * blocks[0, 2, j]
                )
        half = 0.5 * dt * dt
        for i in range(3):
            for j in range(3):
                blocks[4, i, j] += dt * blocks[1, i, j] - half * across[i, j]
                blocks[5, i, j] += dt * blocks[2, i, j] - half * bent[i, j]
                blocks[6, i, j] += dt * blocks[3, i, j] - half * turned[i, j]
                blocks[1, i, j] -= dt * across[i, j]
                blocks[2, i, j] -= dt * bent[i, j]
                blocks[3, i, j] -= dt * turned[i, j]
                blocks[0, i, j] -= dt * turned[i, j]
            gained = felt[i] + gravity[i]
            way[i] += dt * speed[i] + half * gained
            speed[i] += dt * gained
        turned = _product(turned, step)
    return way, speed, turned, blocks


@compiled()
def _force(turned: np.ndarray, force: np.ndarray, half_turn: np.ndarray, felt: np.ndarray) -> None:
    """Fill a force along the map's axes, halfway through a step's turn."""
    x = force[0] + half_turn[1] * force[2] - half_turn[2] * force[1]
    y = force[1] + half_turn[2] * force[0] - half_turn[0] * force[2]
    z = force[2] + half_turn[0] * force[1] - half_turn[1] * force[0]
    for i in range(3):
        felt[i] = turned[i, 0] * x + turned[i, 1] * y + turned[i, 2] * z


@compiled()
def _fill_hat(vector: np.ndarray, across: np.ndarray) -> None:
    across[0, 1], across[0, 2], across[1, 2] = -vector[2], vector[1], -vector[0]
    across[1, 0], across[2, 0], across[2, 1] = vector[2], -vector[1], vector[0]


@compiled()
def _fill_turn(turn: np.ndarray, matrix: np.ndarray) -> None:
    """Fill the rotation of a turn within a sample, radians: small, so a series is exact."""
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
