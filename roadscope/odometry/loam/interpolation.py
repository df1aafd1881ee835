"""Deskew by interpolation (Zhang 2022, eq. 5)."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.rigid import log_so3


def deskewed_between(
    points: np.ndarray, times_s: np.ndarray, before_from_now: np.ndarray, elapsed_s: float
) -> np.ndarray:
    """Return (N, 3) points as seen from the sensor at the stamp.

    points: (N, 3) metres, at (N,) seconds after the stamp. before_from_now: (4, 4), motion over
    the time elapsed up to the stamp, which goes on evenly.

    Reading taken: eq. 5 scales the whole matrix by the share of time, which leaves no rotation;
    here the turn's angle and the way are scaled. Points go to the scan's stamp, not its start.
    """
    share = times_s / elapsed_s
    turn = log_so3(before_from_now[:3, :3])
    way = before_from_now[:3, :3].T @ before_from_now[:3, 3]
    return _interpolated(points, share, turn, way)


@compiled()
def _interpolated(
    points: np.ndarray, share: np.ndarray, turn: np.ndarray, way: np.ndarray
) -> np.ndarray:
    """Return (N, 3) points turned and shifted by their share of a turn, (3,), and a way, (3,)."""
    whole = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    axis = turn / whole if whole > 0.0 else np.zeros(3)
    moved = np.empty((len(points), 3))
    for n in range(len(points)):
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        s, c = np.sin(share[n] * whole), np.cos(share[n] * whole)
        # Rodrigues' formula: v cos + (k x v) sin + k (k.v)(1 - cos).
        along = (axis[0] * x + axis[1] * y + axis[2] * z) * (1.0 - c)
        moved[n, 0] = x * c + (axis[1] * z - axis[2] * y) * s + axis[0] * along
        moved[n, 1] = y * c + (axis[2] * x - axis[0] * z) * s + axis[1] * along
        moved[n, 2] = z * c + (axis[0] * y - axis[1] * x) * s + axis[2] * along
        for i in range(3):
            moved[n, i] += share[n] * way[i]
    return moved
