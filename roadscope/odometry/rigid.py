"""Rigid motions and their logarithms, as 4 x 4 matrices and six-vectors.

A twist is metres along x, y, z, then radians about them, or both per second; frames are those
of the matrix it stands for.
"""

from __future__ import annotations

import math

import numpy as np

SMALL = 1e-8
"""Angle below which its square is lost in rounding beside 1."""


def hat(vector: np.ndarray) -> np.ndarray:
    """Return the (3, 3) matrix that takes the cross product with a (3,) vector."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp_so3(turn: np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation of a (3,) rotation vector, radians."""
    angle = math.sqrt(float(turn @ turn))
    across = hat(turn)
    if angle < SMALL:
        return np.asarray(np.eye(3) + across)
    sine, cosine = math.sin(angle) / angle, (1 - math.cos(angle)) / angle**2
    turned: np.ndarray = np.eye(3) + sine * across + cosine * (across @ across)
    return turned


def log_so3(rotation: np.ndarray) -> np.ndarray:
    """Return the (3,) rotation vector, radians, up to half a turn."""
    rows: list[list[float]] = rotation.tolist()
    trace = rows[0][0] + rows[1][1] + rows[2][2]
    most = max(trace, rows[0][0], rows[1][1], rows[2][2])
    w = 1.0 + trace
    vector = [rows[2][1] - rows[1][2], rows[0][2] - rows[2][0], rows[1][0] - rows[0][1]]
    if most > trace:
        # Near half a turn the difference of the sides vanishes: the quaternion's largest part
        # is taken from the diagonal (Shepperd 1978).
        i = [rows[k][k] for k in range(3)].index(most)
        j, k = (i + 1) % 3, (i + 2) % 3
        w = vector[i]
        vector[i] = 1.0 + rows[i][i] - rows[j][j] - rows[k][k]
        vector[j], vector[k] = rows[j][i] + rows[i][j], rows[k][i] + rows[i][k]
    if w < 0:
        w, vector = -w, [-v for v in vector]
    sine = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    scale = 2 * math.atan2(sine, w) / sine if sine > 0 else 0.0
    return np.array([scale * v for v in vector])


def exp_se3(twist: np.ndarray) -> np.ndarray:
    """Return the (4, 4) motion at a constant (6,) twist over one unit of time."""
    matrix = np.eye(4)
    matrix[:3, :3] = exp_so3(twist[3:])
    matrix[:3, 3] = _left_jacobian(twist[3:]) @ twist[:3]
    return matrix


def log_se3(matrix: np.ndarray) -> np.ndarray:
    """Return the (6,) twist that makes a (4, 4) motion in one unit of time."""
    turn = log_so3(matrix[:3, :3])
    return np.concatenate([np.linalg.solve(_left_jacobian(turn), matrix[:3, 3]), turn])


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a (4, 4) rigid motion."""
    undone = np.eye(4)
    undone[:3, :3] = matrix[:3, :3].T
    undone[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return undone


def orthonormal(matrix: np.ndarray) -> np.ndarray:
    """Return the (4, 4) rigid motion nearest to a matrix that rounding has left a little askew."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    proper = np.eye(4)
    proper[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    proper[:3, 3] = matrix[:3, 3]
    return proper


def adjoint(matrix: np.ndarray) -> np.ndarray:
    """Return the (6, 6) matrix that takes twists of frame b to frame a; matrix: `a_from_b`."""
    rotation = matrix[:3, :3]
    whole = np.zeros((6, 6))
    whole[:3, :3] = whole[3:, 3:] = rotation
    whole[:3, 3:] = hat(matrix[:3, 3]) @ rotation
    return whole


def _left_jacobian(turn: np.ndarray) -> np.ndarray:
    """Return the left Jacobian of SO(3), (3, 3)."""
    angle = math.sqrt(float(turn @ turn))
    across = hat(turn)
    if angle < 1e-4:
        return np.asarray(np.eye(3) + across / 2 + across @ across / 6)
    once = (1 - math.cos(angle)) / angle**2
    twice = (angle - math.sin(angle)) / angle**3
    bent: np.ndarray = np.eye(3) + once * across + twice * (across @ across)
    return bent
