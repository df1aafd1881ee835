"""A scan and an inertial prediction together: the pose that fits both best."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.rigid import exp_so3, log_so3, orthonormal
from roadscope.odometry.voxels.match_kernels import normal_equations
from roadscope.odometry.voxels.matching import SHIFT_M, TURN_RAD, Match
from roadscope.odometry.voxels.voxel_kernels import FLOOR_M, Voxels

STEPS = 8
SIMILAR = 20.0
"""So many returns are worth one: neighbours err alike, by the same misfit surface."""
NARROW, WIDEST = 3.0, 12.0
"""Standard deviations off its surface at which a return counts for a quarter, in the end and at
first where the prediction is vague."""
SURFACE_M = 0.04
OPEN = 400.0
"""Information, 1/m^2, about a shift that clutter and the pattern of the beams feign: what there is
counts by how far it is above this."""


def settled_on(
    voxels: Voxels, points: np.ndarray, pose: np.ndarray, covariance: np.ndarray, *,
    doubt_m: float = 0.0, floor_m: float = FLOOR_M,
) -> Match:  # fmt: skip
    """Move (N, 3) points, metres, onto the surfaces, held by a prediction.

    pose: (4, 4), predicted. covariance: (6, 6) of its place and turn, map's axes. doubt_m: how far
    the surfaces may have moved together over the ground. floor_m: what points are off surfaces that
    are known perfectly. The match's information has nothing in directions in which the surfaces
    leave the scan free.
    """
    held = np.linalg.inv(covariance + 1e-12 * np.eye(6)) * SIMILAR
    vague_m = float(np.sqrt(np.trace(covariance[:3, :3])))
    scale = min(NARROW + vague_m / SURFACE_M, WIDEST)
    at = pose.copy()
    for _ in range(STEPS):
        H, b, _ = normal_equations(voxels, points, at, scale, floor_m)
        H, b = _doubted(*_without_open(H, b), doubt_m)
        off = np.concatenate([at[:3, 3] - pose[:3, 3], log_so3(at[:3, :3] @ pose[:3, :3].T)])
        move = -np.linalg.solve(H + held, b + held @ off)
        at[:3, 3] += move[:3]
        at[:3, :3] = exp_so3(move[3:]) @ at[:3, :3]
        small = np.abs(move[:3]).max() < SHIFT_M and np.abs(move[3:]).max() < TURN_RAD
        if small and scale == NARROW:
            break
        scale = max(NARROW, 0.6 * scale)
    at = orthonormal(at)
    H, b, told = normal_equations(voxels, points, at, NARROW, floor_m)
    H, _ = _doubted(*_without_open(H, b), doubt_m)
    return Match(at, H / SIMILAR, len(points), int(told[0]), float(told[1]))


def _without_open(H: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations with less of what they say of shifts in directions that are open."""
    values, axes = np.linalg.eigh(H[:3, :3])
    values = np.maximum(values, 0.0)
    shares = values / (values + OPEN)
    half, whole = np.eye(6), np.eye(6)
    half[:3, :3] = (axes * np.sqrt(shares)) @ axes.T
    whole[:3, :3] = (axes * shares) @ axes.T
    return half @ H @ half, whole @ b


def _doubted(H: np.ndarray, b: np.ndarray, doubt_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations with that error added which the surfaces have in common."""
    if not doubt_m:
        return H, b
    error = np.zeros((6, 6))
    error[0, 0] = error[1, 1] = doubt_m**2 / SIMILAR
    shares = np.linalg.inv(np.eye(6) + H @ error)
    return shares @ H, shares @ b
