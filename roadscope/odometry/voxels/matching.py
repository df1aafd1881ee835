"""The pose of a scan on a map of surfaces: robust Gauss-Newton, point to surface."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, Index, slot_of
from roadscope.odometry.estimates import LEAST_POINTS
from roadscope.odometry.rigid import exp_so3, log_so3, orthonormal
from roadscope.odometry.voxels.surfaces import FLOOR_M, ROUGH_M, SIZES_M, VoxelMap, Voxels, key_of

# --------------------------------------------------------------------------------------------------
# Normal equations of points on the surfaces of a map.

TILT = 0.05
"""Error of a normal that was fitted to the traces of few beams, radians."""

GRAZING = 0.06
"""Cosine of the angle between a rising beam and the normal of the surface at which a point has half
its weight. The trace of one beam over a tree's crown lies on the cone of that beam: it looks like a
surface along the beams, and moves with the sensor."""

TRACED_RAD = 0.01
"""Standard deviation of the height, over range, of a rising beam's return on a surface: beams are
up to two degrees apart, and a plane between their traces has a uniform error (two degrees over the
root of 12). Traces on objects ahead sink as these come closer: tilted planes through them would
lift the sensor."""

FIRM, FAR = 20.0, 5.0
"""A surface with at least `FIRM` points contradicts points that are `FAR` standard deviations
off."""


@compiled()
def normal_equations(
    voxels: Voxels, points: np.ndarray, matrix: np.ndarray, scale: float, floor_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gauss-Newton's matrix (6, 6) and vector (6,), and sums over the points, (3,).

    points: (N, 3) metres, the sensor's frame. matrix: (4, 4) `map_from_sensor`. scale: standard
    deviations off its surface at which a point counts for a quarter (Geman and McClure 1985).
    floor_m: least standard deviation of a point from a surface.
    The unknowns are a shift, metres, and a turn about the sensor, radians, both along the map's
    axes. The sums: number of points with a surface, their weights, and their weighted squared
    distances in standard deviations.

    A point is matched with the largest voxel around it whose surface passes near, otherwise with
    the largest that has a surface: small voxels are used where large ones contain several.
    """
    H, b, sums = np.zeros((6, 6)), np.zeros(6), np.zeros(3)
    # q: from the sensor to the point, along the map's axes. j: row of the Jacobian.
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
        _offsets(voxels, slot, x, y, z, off)
        squared, traced = 0.0, _traced(matrix, q)
        for k in range(voxels.fixed_axes[slot]):
            variance = _variance(voxels.spreads[slot], voxels.counts[slot], off, k, floor_m)
            weight[k] = 1.0 / (variance + traced * _rise(axes[k], matrix) ** 2)
            squared += weight[k] * off[k] * off[k]
        share = 1.0 / (1.0 + squared / (scale * scale)) ** 2
        sums[0] += 1.0
        sums[1] += share
        sums[2] += share * squared
        if voxels.fixed_axes[slot] == 1:
            share *= _beam_weight(axes[0], matrix, q)
        for k in range(voxels.fixed_axes[slot]):
            _row(axes[k], matrix, q, j)
            _accumulate(H, b, j, share * weight[k], off[k])
    for r in range(6):
        for c in range(r):
            H[r, c] = H[c, r]
    return H, b, sums


@compiled()
def _rise(vector: np.ndarray, matrix: np.ndarray) -> float:
    """Return the component of a vector, (3,) along the map's axes, along the sensor's z axis."""
    up: float = matrix[0, 2] * vector[0] + matrix[1, 2] * vector[1] + matrix[2, 2] * vector[2]
    return up


@compiled()
def _traced(matrix: np.ndarray, q: np.ndarray) -> float:
    """Return the variance, m^2, of the height of a return along q, (3,) metres.

    Zero for falling beams: these hit the ground and measure its height.
    """
    if _rise(q, matrix) <= 0.0:
        return 0.0
    square: float = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    return TRACED_RAD * TRACED_RAD * square


@compiled()
def _beam_weight(normal: np.ndarray, matrix: np.ndarray, q: np.ndarray) -> float:
    """Return the weight of a return along q, (3,) metres, on a surface.

    One for falling beams: these hit the ground.
    """
    if _rise(q, matrix) <= 0.0:
        return 1.0
    into = normal[0] * q[0] + normal[1] * q[1] + normal[2] * q[2]
    square = into * into / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    weight: float = square / (square + GRAZING * GRAZING)
    return weight


@compiled()
def surface_at(voxels: Voxels, x: float, y: float, z: float) -> Index:
    """Return the slot of the largest voxel around a place whose surface passes near it.

    If none does, that of the largest that has a surface; -1 if none has.
    """
    largest: Index = -1
    for level in range(len(SIZES_M) - 1, -1, -1):
        key = key_of(x, y, z, level)
        if key < 0:
            return -1
        slot = slot_of(voxels.keys, key)
        if voxels.keys[slot] == EMPTY or voxels.fixed_axes[slot] == 0:
            continue
        if _passes(voxels, slot, x, y, z):
            return slot
        if largest < 0:
            largest = slot
    return largest


@compiled()
def _offsets(voxels: Voxels, slot: Index, x: float, y: float, z: float, off: np.ndarray) -> None:
    """Write the offset of a place from the mean of a voxel along its axes, (3,) metres."""
    axes, means = voxels.axes[slot], voxels.means[slot]
    x, y, z = x - means[0], y - means[1], z - means[2]
    for k in range(3):
        off[k] = axes[k, 0] * x + axes[k, 1] * y + axes[k, 2] * z


@compiled()
def _passes(voxels: Voxels, slot: Index, x: float, y: float, z: float) -> bool:
    """Return whether a place lies on the surface of a voxel."""
    means, squared = voxels.means[slot], 0.0
    for k in range(voxels.fixed_axes[slot]):
        axis = voxels.axes[slot, k]
        off = axis[0] * (x - means[0]) + axis[1] * (y - means[1]) + axis[2] * (z - means[2])
        squared += off * off / (voxels.spreads[slot, k] + ROUGH_M * ROUGH_M)
    near: bool = squared < FAR * FAR
    return near


@compiled()
def _variance(spreads: np.ndarray, count: float, off: np.ndarray, k: int, floor_m: float) -> float:
    """Return the variance, m^2, of a point's distance along an axis of a voxel.

    It is that of the points of the voxel plus the error of a plane fitted to them, which is larger
    outside of them. off: (3,) metres from their mean, along the axes.
    """
    lever = 1.0
    for i in range(k + 1, 3):
        lever += off[i] * off[i] / (spreads[i] + FLOOR_M * FLOOR_M)
    variance: float = spreads[k] * (1.0 + lever / (count - 3.0)) + floor_m * floor_m
    return variance


@compiled()
def _row(axis: np.ndarray, matrix: np.ndarray, q: np.ndarray, j: np.ndarray) -> None:
    """Write the derivative of the distance along an axis by shift and turn.

    Components of the axis along an axis of the sensor are reduced where they are within the error
    of fitted normals: otherwise hundreds of level surfaces, each slightly tilted by noise, would
    together hold the sensor back along the road.
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
    """Return (N,) whether points, (N, 3) in the map's frame, contradict a surface around them."""
    marks, off = np.zeros(len(points), np.bool_), np.empty(3)
    for n in range(len(points)):
        x, y, z = points[n]
        slot = surface_at(voxels, x, y, z)
        if slot < 0 or voxels.counts[slot] < FIRM:
            continue
        _offsets(voxels, slot, x, y, z, off)
        squared = 0.0
        for k in range(voxels.fixed_axes[slot]):
            spread = _variance(voxels.spreads[slot], voxels.counts[slot], off, k, FLOOR_M)
            squared += off[k] ** 2 / (spread + ROUGH_M * ROUGH_M)
        marks[n] = squared > FAR * FAR
    return marks


# --------------------------------------------------------------------------------------------------
# The pose of a scan.

SCALES = (12.0, 8.0, 5.0, 4.0, 3.0)
"""Robust scale in standard deviations, from step to step (graduated non-convexity)."""
STEPS = 12
"""Most Gauss-Newton steps."""
SHIFT_M, TURN_RAD = 1e-3, 2e-5
"""Smaller steps end the search: they are far below the accuracy of a scan."""
FLOOR = 1e-6
"""Added to the diagonal, so that unobservable unknowns stay unchanged, 1/m^2 and 1/rad^2."""
LEAST_AGREEMENT = 0.3
"""Least share of the points on surfaces that must agree with them. Chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """Prior of a pose before its scan is matched.

    map_from_sensor: (4, 4). information: (6, 6), of a shift and a turn along the map's axes.
    """

    map_from_sensor: np.ndarray
    information: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ScanMatch:
    """The pose of a scan on a map.

    map_from_sensor: (4, 4). information: (6, 6), of a shift, metres, and a turn about the sensor,
        radians, along the map's axes; from the scan alone.
    points: number of points. matched_points: number of points with a surface.
    fits: sum of their weights, at most `matched_points`.
    """

    map_from_sensor: np.ndarray
    information: np.ndarray
    points: int
    matched_points: int
    fits: float

    @property
    def agreement(self) -> float:
        """Share of points on a surface that agree with it."""
        return self.fits / max(self.matched_points, 1)


def take_gauss_newton_step(
    pose: np.ndarray, prior: PosePrior, H: np.ndarray, b: np.ndarray
) -> bool:
    """Move a (4, 4) pose by a Gauss-Newton step; return whether the step was small.

    H: (6, 6) information of points and prior. b: (6,) gradient of the points alone.
    """
    start = prior.map_from_sensor
    off = np.concatenate([pose[:3, 3] - start[:3, 3], log_so3(pose[:3, :3] @ start[:3, :3].T)])
    move = -np.linalg.solve(H, b + prior.information @ off)
    pose[:3, 3] += move[:3]
    pose[:3, :3] = exp_so3(move[3:]) @ pose[:3, :3]
    return bool(np.abs(move[:3]).max() < SHIFT_M and np.abs(move[3:]).max() < TURN_RAD)


def misfit_of(scan_match: ScanMatch) -> str:
    """Return why a match is rejected; empty if it is accepted."""
    if scan_match.matched_points < LEAST_POINTS:
        return f"only {scan_match.matched_points} points lie on known surfaces"
    if scan_match.agreement < LEAST_AGREEMENT:
        return f"only {scan_match.agreement:.0%} of the points agree with the map"
    return ""


def match(
    voxels: Voxels,
    points: np.ndarray,
    prior: PosePrior,
    *,
    scales: tuple[float, ...] = SCALES,
    steps: int = STEPS,
) -> ScanMatch:
    """Return the pose that moves (N, 3) points, metres, sensor frame, onto the surfaces."""
    pose = prior.map_from_sensor.copy()
    for step in range(steps):
        scale = scales[min(step, len(scales) - 1)]
        H, b, _ = normal_equations(voxels, points, pose, scale, FLOOR_M)
        small = take_gauss_newton_step(pose, prior, H + prior.information + FLOOR * np.eye(6), b)
        if small and step + 1 >= len(scales):
            break
    pose = orthonormal(pose)
    H, _, sums = normal_equations(voxels, points, pose, scales[-1], FLOOR_M)
    return ScanMatch(pose, H, len(points), int(sums[0]), float(sums[1]))


def best_match(surfaces: VoxelMap, points: np.ndarray, priors: Iterable[PosePrior]) -> ScanMatch:
    """Return the best match of (N, 3) points, metres, sensor frame, from several priors.

    It is the one with the largest `fits`; the first of equal ones.
    """
    matches = (match(surfaces.voxels, points, prior) for prior in priors)
    return max(matches, key=lambda each: each.fits)
