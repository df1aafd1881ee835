"""The pose of a scan on a map of surfaces: robust Gauss-Newton, point to surface."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, Index, slot_of
from roadscope.odometry.rigid import exp_so3, log_so3, orthonormal
from roadscope.odometry.voxels.surfaces import FLOOR_M, ROUGH_M, SIZES_M, VoxelMap, Voxels, key_of

# --------------------------------------------------------------------------------------------------
# How well points lie on the surfaces of a map, and which way is better.

TILT = 0.05
"""By so much, radians, the normal of a surface may err that was fitted to a few traces of beams."""

GRAZING = 0.06
"""Cosine of the angle between a beam that rises and the normal of the surface that it meets at
which the point counts for a half. One beam's trace over a tree's crown lies on the cone on which
that beam turns: it passes for a surface that contains the beams, and goes where the sensor goes."""

TRACED_RAD = 0.01
"""How far off in height, over the range, a beam that rises may meet a thing from where its surface
was seen: beams are up to two degrees apart, and a plane between their traces is as likely one way
as another (two degrees over the root of 12). Traces on what is ahead sink as one comes: planes
through them that lean would lift the sensor and turn it up."""

FIRM, FAR = 20.0, 5.0
"""A surface of so many points contradicts what is not on it: so many standard deviations off."""


@compiled()
def normal_equations(
    voxels: Voxels, points: np.ndarray, matrix: np.ndarray, scale: float, floor_m: float = FLOOR_M
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gauss-Newton's matrix (6, 6) and vector (6,), and what they rest on, (3,).

    points: (N, 3) metres, the sensor's frame. matrix: (4, 4) `map_from_sensor`. scale: standard
    deviations off its surface at which a point counts for a quarter (Geman and McClure 1985).
    floor_m: what points are off surfaces that are known perfectly.
    The unknowns are a shift, metres, and a turn about the sensor, radians, both along the map's
    axes. The last result: points that have a surface, the sum of their weights, and that of
    their squared distances, weighed, in standard deviations.

    A point is held by the largest voxel around it whose surface passes near, if none does by the
    largest that has one: small ones take over where large ones hold more than one.
    """
    H, b, told = np.zeros((6, 6)), np.zeros(6), np.zeros(3)
    q, j, off, weight = np.empty(3), np.empty(6), np.empty(3), np.empty(3)
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
        axes = voxels.axes[slot]
        _offsets(voxels, slot, (x, y, z), off)
        squared, traced = 0.0, _traced(matrix, q)
        for k in range(voxels.held[slot]):
            variance = _variance(voxels.spreads[slot], voxels.counts[slot], off, k, floor_m)
            weight[k] = 1.0 / (variance + traced * _rise(axes[k], matrix) ** 2)
            squared += weight[k] * off[k] * off[k]
        share = 1.0 / (1.0 + squared / (scale * scale)) ** 2
        told[0] += 1.0
        told[1] += share
        told[2] += share * squared
        if voxels.held[slot] == 1:
            share *= _met(axes[0], matrix, q)
        for k in range(voxels.held[slot]):
            _row(axes[k], matrix, q, j)
            _accumulate(H, b, j, share * weight[k], off[k])
    for r in range(6):
        for c in range(r):
            H[r, c] = H[c, r]
    return H, b, told


@compiled()
def _rise(vector: np.ndarray, matrix: np.ndarray) -> float:
    """Return how far a vector, (3,) along the map's axes, goes up as the sensor sees it."""
    up: float = matrix[0, 2] * vector[0] + matrix[1, 2] * vector[1] + matrix[2, 2] * vector[2]
    return up


@compiled()
def _traced(matrix: np.ndarray, q: np.ndarray) -> float:
    """Return the variance, m^2, of the height at which a beam along q, (3,) metres, met a thing.

    Beams that fall meet the ground, whose height they tell.
    """
    if _rise(q, matrix) <= 0.0:
        return 0.0
    square: float = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    return TRACED_RAD * TRACED_RAD * square


@compiled()
def _met(normal: np.ndarray, matrix: np.ndarray, q: np.ndarray) -> float:
    """Return how much a point counts that was met along q, (3,) metres, on a surface.

    Beams that fall meet the ground, which is what it seems to be.
    """
    if _rise(q, matrix) <= 0.0:
        return 1.0
    into = normal[0] * q[0] + normal[1] * q[1] + normal[2] * q[2]
    square = into * into / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    met: float = square / (square + GRAZING * GRAZING)
    return met


@compiled()
def surface_at(voxels: Voxels, x: float, y: float, z: float) -> Index:
    """Return the slot of the largest voxel around a place whose surface passes near it.

    If none does, that of the largest that has a surface; -1 if none has.
    """
    largest: Index = -1
    for up in range(len(SIZES_M)):
        key = key_of(x, y, z, len(SIZES_M) - 1 - up)
        if key < 0:
            return -1
        slot = slot_of(voxels.keys, key)
        if voxels.keys[slot] == EMPTY or voxels.held[slot] == 0:
            continue
        if _passes(voxels, slot, x, y, z):
            return slot
        if largest < 0:
            largest = slot
    return largest


@compiled()
def _offsets(
    voxels: Voxels, slot: Index, place: tuple[float, float, float], off: np.ndarray
) -> None:
    """Fill how far a place is from the mean of a voxel along its axes, (3,) metres."""
    axes, means = voxels.axes[slot], voxels.means[slot]
    x, y, z = place[0] - means[0], place[1] - means[1], place[2] - means[2]
    for k in range(3):
        off[k] = axes[k, 0] * x + axes[k, 1] * y + axes[k, 2] * z


@compiled()
def _passes(voxels: Voxels, slot: Index, x: float, y: float, z: float) -> bool:
    """Say whether a place lies on the surface of a voxel."""
    means, squared = voxels.means[slot], 0.0
    for k in range(voxels.held[slot]):
        axis = voxels.axes[slot, k]
        off = axis[0] * (x - means[0]) + axis[1] * (y - means[1]) + axis[2] * (z - means[2])
        squared += off * off / (voxels.spreads[slot, k] + ROUGH_M * ROUGH_M)
    near: bool = squared < FAR * FAR
    return near


@compiled()
def _variance(spreads: np.ndarray, count: float, off: np.ndarray, k: int, floor_m: float) -> float:
    """Return the variance, m^2, with which a point is held along an axis.

    That of the points of the voxel, and what a plane fitted to so few of them errs at the place,
    more outside of them than among them. off: (3,) metres from their mean, along the axes.
    """
    lever = 1.0
    for i in range(k + 1, 3):
        lever += off[i] * off[i] / (spreads[i] + FLOOR_M * FLOOR_M)
    variance: float = spreads[k] * (1.0 + lever / (count - 3.0)) + floor_m * floor_m
    return variance


@compiled()
def _row(axis: np.ndarray, matrix: np.ndarray, q: np.ndarray, j: np.ndarray) -> None:
    """Fill how the distance along an axis changes with shift and turn.

    What of the axis lies along an axis of the sensor is shrunk where it is within the error of
    fitted normals: else hundreds of level surfaces, each tilted a little by noise, would together
    hold the sensor back along the road.
    """
    j[0] = j[1] = j[2] = 0.0
    for c in range(3):
        along = axis[0] * matrix[0, c] + axis[1] * matrix[1, c] + axis[2] * matrix[2, c]
        along *= along * along / (along * along + TILT * TILT)
        for i in range(3):
            j[i] += along * matrix[i, c]
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


@compiled()
def contradicts(voxels: Voxels, points: np.ndarray) -> np.ndarray:
    """Return (N,) bool, which points, (N, 3) in the map's frame, are off a surface around them."""
    marks, off = np.zeros(len(points), np.bool_), np.empty(3)
    for n in range(len(points)):
        x, y, z = points[n]
        slot = surface_at(voxels, x, y, z)
        if slot < 0 or voxels.counts[slot] < FIRM:
            continue
        _offsets(voxels, slot, (x, y, z), off)
        squared = 0.0
        for k in range(voxels.held[slot]):
            spread = _variance(voxels.spreads[slot], voxels.counts[slot], off, k, FLOOR_M)
            squared += off[k] ** 2 / (spread + ROUGH_M * ROUGH_M)
        marks[n] = squared > FAR * FAR
    return marks


# --------------------------------------------------------------------------------------------------
# Where a scan lies on a map of surfaces: robust Gauss-Newton, point to surface.

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
    voxels: Voxels,
    points: np.ndarray,
    belief: Belief,
    *,
    scales: tuple[float, ...] = SCALES,
    steps: int = STEPS,
) -> Match:
    """Move (N, 3) points, metres, sensor frame, onto the surfaces, beginning at what is held."""
    pose = belief.map_from_sensor.copy()
    for step in range(steps):
        scale = scales[min(step, len(scales) - 1)]
        H, b, _ = normal_equations(voxels, points, pose, scale)
        off = np.concatenate(
            [
                pose[:3, 3] - belief.map_from_sensor[:3, 3],
                log_so3(pose[:3, :3] @ belief.map_from_sensor[:3, :3].T),
            ]
        )
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
