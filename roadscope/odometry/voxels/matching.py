"""Where a scan lies on a map of surfaces: robust Gauss-Newton, point to surface."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from roadscope.odometry.rigid import exp_so3, log_so3, orthonormal
from roadscope.odometry.voxels.match_kernels import normal_equations
from roadscope.odometry.voxels.surfaces import VoxelMap
from roadscope.odometry.voxels.voxel_kernels import Voxels

SCALES = (12.0, 8.0, 5.0, 4.0, 3.0)
"""Standard deviations that still count, from one step to the next (graduated non-convexity)."""
STEPS = 12
SHIFT_M, TURN_RAD = 1e-3, 2e-5
"""Steps below these end the search: they are far below what a scan tells."""
FLOOR = 1e-6
"""Keeps what nothing holds where it is, 1/m^2 and 1/rad^2."""


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is held of a pose before its scan is looked at.

    map_from_sensor: (4, 4). information: (6, 6), of a shift and a turn along the map's axes.
    """

    map_from_sensor: np.ndarray
    information: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Where a scan fits.

    map_from_sensor: (4, 4). information: (6, 6), of a shift, metres, and a turn about the sensor,
        radians, along the map's axes; from the scan alone.
    points: how many were looked at. held: how many of them met a surface. fits: sum of their
        weights, at most `held`.
    """

    map_from_sensor: np.ndarray
    information: np.ndarray
    points: int
    held: int
    fits: float

    @property
    def agreement(self) -> float:
        """Share of points on a surface that agree with it."""
        return self.fits / max(self.held, 1)


def match(
    voxels: Voxels, points: np.ndarray, belief: Belief, *, scales: tuple[float, ...] = SCALES,
    steps: int = STEPS,
) -> Match:  # fmt: skip
    """Move (N, 3) points, metres, sensor frame, onto the surfaces, beginning at what is held."""
    pose = belief.map_from_sensor.copy()
    for step in range(steps):
        scale = scales[min(step, len(scales) - 1)]
        H, b, _ = normal_equations(voxels, points, pose, scale)
        off = np.concatenate(
            [pose[:3, 3] - belief.map_from_sensor[:3, 3],
             log_so3(pose[:3, :3] @ belief.map_from_sensor[:3, :3].T)]
        )  # fmt: skip
        whole = H + belief.information + FLOOR * np.eye(6)
        move = -np.linalg.solve(whole, b + belief.information @ off)
        pose[:3, 3] += move[:3]
        pose[:3, :3] = exp_so3(move[3:]) @ pose[:3, :3]
        small = np.abs(move[:3]).max() < SHIFT_M and np.abs(move[3:]).max() < TURN_RAD
        if small and step + 1 >= len(scales):
            break
    pose = orthonormal(pose)
    H, _, told = normal_equations(voxels, points, pose, scales[-1])
    return Match(pose, H, len(points), int(told[0]), float(told[1]))


def best_match(surfaces: VoxelMap, points: np.ndarray, beliefs: Iterable[Belief]) -> Match:
    """Match (N, 3) points, metres, sensor frame, from each belief; return the best match.

    That is the one with which most points agree; of equals the first.
    """
    matches = (match(surfaces.voxels, points, belief) for belief in beliefs)
    return max(matches, key=lambda found: found.fits)
