"""Kernels on points of a scan: thinning, deskewing, rigid motion."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, cube_of, slot_of


@compiled()
def thinned(points: np.ndarray, size_m: float, least_m: float, most_m: float) -> np.ndarray:
    """Return the rows, (K,) int64, of the first point in each cube of a size.

    points: (N, 3) metres. Points nearer than `least_m` or farther than `most_m` from the origin are
    left out, as are points that are not finite.
    """
    rows, _ = cubed(points, size_m, least_m, most_m)
    return rows


@compiled()
def cubed(
    points: np.ndarray, size_m: float, least_m: float, most_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of `thinned`, and (N,) int64 the number of each point's cube or -1."""
    slots = 1024
    while slots < 2 * len(points):
        slots *= 2
    keys = np.full(slots, EMPTY, np.int64)
    # For each slot of the hash table and for each point the number of its cube.
    cubes = np.empty(slots, np.int64)
    members = np.full(len(points), -1, np.int64)
    rows, count = np.empty(len(points), np.int64), 0
    least, most = least_m**2, most_m**2
    for n in range(len(points)):
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        if not least <= x * x + y * y + z * z <= most:
            continue
        key = cube_of(x, y, z, size_m)
        if key == EMPTY:
            continue
        slot = slot_of(keys, key)
        if keys[slot] == EMPTY:
            keys[slot], cubes[slot] = key, count
            rows[count] = n
            count += 1
        members[n] = cubes[slot]
    return rows[:count], members


@compiled()
def deskewed(points: np.ndarray, times_s: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Return (N, 3) points, float64, in the sensor's frame at the stamp.

    points: (N, 3), the sensor's frame at each point's own time. times_s: (N,) after the stamp.
    twist: (6,) m/s and rad/s, constant through the sweep, the sensor's frame.
    """
    vx, vy, vz, wx, wy, wz = twist
    rate2 = wx * wx + wy * wy + wz * wz
    moved = np.empty((len(points), 3))
    for n in range(len(points)):
        t = np.float64(times_s[n])
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        # Series of sin(a) / a, (1 - cos(a)) / a^2 and (a - sin(a)) / a^3: a sweep turns by little.
        a2 = rate2 * t * t
        once = t * (1.0 - a2 / 6.0 * (1.0 - a2 / 20.0))
        twice = t * t * (0.5 - a2 / 24.0 * (1.0 - a2 / 30.0))
        thrice = t * t * t * (1.0 / 6.0 - a2 / 120.0)
        # Rotated points and the displacement, both by I + a [w] + b [w]^2 with different factors.
        cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        dx, dy, dz = wy * cz - wz * cy, wz * cx - wx * cz, wx * cy - wy * cx
        ex, ey, ez = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
        fx, fy, fz = wy * ez - wz * ey, wz * ex - wx * ez, wx * ey - wy * ex
        moved[n, 0] = x + once * cx + twice * dx + t * vx + twice * ex + thrice * fx
        moved[n, 1] = y + once * cy + twice * dy + t * vy + twice * ey + thrice * fy
        moved[n, 2] = z + once * cz + twice * dz + t * vz + twice * ez + thrice * fz
    return moved


@compiled()
def placed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return (N, 3) points mapped by a (4, 4) rigid motion."""
    mapped = np.empty((len(points), 3))
    for n in range(len(points)):
        x, y, z = points[n]
        for i in range(3):
            mapped[n, i] = matrix[i, 0] * x + matrix[i, 1] * y + matrix[i, 2] * z + matrix[i, 3]
    return mapped
