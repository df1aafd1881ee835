"""How well points lie on the surfaces of a map, and which way is better."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.voxel_kernels import EMPTY, SIZES_M, Index, Voxels, key_of, slot_of


@compiled()
def normal_equations(
    voxels: Voxels, points: np.ndarray, matrix: np.ndarray, scale: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gauss-Newton's matrix (6, 6) and vector (6,), and what they rest on, (3,).

    points: (N, 3) metres, the sensor's frame. matrix: (4, 4) `map_from_sensor`. scale: standard
    deviations off its surface at which a point counts for a quarter (Geman and McClure 1985).
    The unknowns are a shift, metres, and a turn about the sensor, radians, both along the map's
    axes. The last result: points that have a surface, the sum of their weights, and that of
    their squared distances, weighed, in standard deviations.

    A point is held by the largest voxel around it that has a surface: small ones take over where
    large ones hold more than one.
    """
    H, b, told = np.zeros((6, 6)), np.zeros(6), np.zeros(3)
    q, j = np.empty(3), np.empty(6)
    for n in range(len(points)):
        for i in range(3):
            q[i] = (
                matrix[i, 0] * points[n, 0]
                + matrix[i, 1] * points[n, 1]
                + matrix[i, 2] * points[n, 2]
            )
        x, y, z = q[0] + matrix[0, 3], q[1] + matrix[1, 3], q[2] + matrix[2, 3]
        slot = surface_at(voxels, x, y, z)
        if slot < 0:
            continue
        rx, ry, rz = (
            x - voxels.means[slot, 0], y - voxels.means[slot, 1], z - voxels.means[slot, 2]
        )  # fmt: skip
        axes, weights = voxels.axes[slot], voxels.weights[slot]
        squared = 0.0
        for k in range(2):
            if weights[k] > 0.0:
                off = axes[k, 0] * rx + axes[k, 1] * ry + axes[k, 2] * rz
                squared += weights[k] * off * off
        share = 1.0 / (1.0 + squared / (scale * scale)) ** 2
        told[0] += 1.0
        told[1] += share
        told[2] += share * squared
        for k in range(2):
            if weights[k] > 0.0:
                _row(axes[k], q, j)
                off = axes[k, 0] * rx + axes[k, 1] * ry + axes[k, 2] * rz
                _accumulate(H, b, j, share * weights[k], off)
    for r in range(6):
        for c in range(r):
            H[r, c] = H[c, r]
    return H, b, told


@compiled()
def surface_at(voxels: Voxels, x: float, y: float, z: float) -> Index:
    """Return the slot of the largest voxel around a place that has a surface; -1 if none has."""
    for up in range(len(SIZES_M)):
        key = key_of(x, y, z, len(SIZES_M) - 1 - up)
        if key < 0:
            return -1
        slot = slot_of(voxels.keys, key)
        if voxels.keys[slot] != EMPTY and voxels.weights[slot, 0] > 0.0:
            return slot
    return -1


@compiled()
def _row(axis: np.ndarray, q: np.ndarray, j: np.ndarray) -> None:
    """Fill how the distance along an axis changes with shift and turn."""
    for i in range(3):
        j[i] = axis[i]
    j[3] = q[1] * axis[2] - q[2] * axis[1]
    j[4] = q[2] * axis[0] - q[0] * axis[2]
    j[5] = q[0] * axis[1] - q[1] * axis[0]


@compiled()
def _accumulate(H: np.ndarray, b: np.ndarray, j: np.ndarray, weight: float, off: float) -> None:
    for r in range(6):
        scaled = weight * j[r]
        b[r] += scaled * off
        for c in range(r, 6):
            H[r, c] += scaled * j[c]
