"""Bundle adjustment of camera and targets, from all that both sensors measured of the targets.

The errors of a target's three corners in a scan are correlated: if the target seems rotated in its
plane, all of them are displaced. Therefore the pose of every target is an unknown, as is that of
the camera. The residuals are those of the measurements: corners in pixels, the plane of the ranges,
and which beams hit the target and which missed it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.fusion.calibration import CalibrationError, decompose
from roadscope.fusion.calibration_target import (
    ScannedTarget,
    TriangularTarget,
    corners_of_targets,
    edge_errors,
    image_errors,
    range_errors,
    stacked_measurements,
)

EDGE_WIDTHS = (0.5, 0.25, 0.1)
"""Widths of edges in successive refinements, see `edge_errors`, as shares of the step between
columns: wide at first, so that beams far from the edge have an effect. The last stands for the
width of a thin beam; for beams as wide as a step it would be about 0.3. Chosen by hand."""
DIFFERENCE_STEP = 1e-6
"""Step of numerical derivatives, in radians, metres and `PIXELS_A_UNIT`."""
PIXELS_A_UNIT = 1000.0
"""Intrinsics are counted in thousands of pixels, so that all unknowns have similar scales."""
MOST_STEPS = 50
"""Greatest number of accepted steps. Chosen by hand."""
LEAST_GAIN = 1e-4
"""A step that reduces the sum of squares S by less than this share of 1 + S is the last. Chosen by
hand."""
FIRST_DAMPING, RAISED, LOWERED, MOST_TRIES = 1e-3, 4, 5, 8
"""First damping; its factor after a step that does not reduce the sum of squares, and its divisor
after one that does; greatest number of tries for one step. Chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Bundle:
    """The likeliest camera and targets.

    matrix: (3, 4), LiDAR frame to pixels. corners: (P, 3, 3) of the targets, LiDAR frame, metres.
    """

    matrix: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The unknowns.

    intrinsics: (4,) fx, fy, cx, cy, pixels. camera: (3, 4) `camera_from_lidar`. targets: (P, 3, 4)
    `lidar_from_target`; the axes of a target are right, up and towards the sensor, its origin is
    the middle of its base.
    """

    intrinsics: np.ndarray
    camera: np.ndarray
    targets: np.ndarray

    def moved(self, shared: np.ndarray, own: np.ndarray) -> State:
        """Return the state after a step.

        shared: (6,) of the camera, or (10,) with intrinsics in `PIXELS_A_UNIT`. own: (P, 6) of the
        targets. The six numbers of a pose are a rotation vector, radians, and a shift, metres.
        """
        intrinsics = self.intrinsics
        if len(shared) > 6:
            intrinsics = intrinsics + PIXELS_A_UNIT * shared[6:]
        return State(
            intrinsics, _moved(self.camera[None], shared[None, :6])[0], _moved(self.targets, own)
        )


Errors = Callable[[State], np.ndarray]
"""State -> (P, M) errors of P targets, in standard deviations."""


def refine(
    matrix: np.ndarray,
    corners: np.ndarray,
    pixels: np.ndarray,
    scanned: Sequence[ScannedTarget],
    target: TriangularTarget,
    *,
    free_intrinsics: bool = True,
) -> Bundle:
    """Return the likeliest camera and targets, from initial values nearby.

    matrix: (3, 4) LiDAR frame to pixels.
    corners: (P, 3, 3) left, right and top corner of each target, metres, LiDAR frame.
    pixels: (P, 3, 2) the same corners in the images.
    scanned: what the LiDAR measured of each target. target: the size of all targets.
    free_intrinsics: whether the intrinsics are unknown; otherwise they are those of the matrix.
    Raises `CalibrationError` if no camera has this matrix, or if the numbers of targets differ.
    """
    if not len(corners) == len(pixels) == len(scanned) > 0:
        raise CalibrationError(
            "expected corners, pixels and scans of as many targets, "
            f"got {len(corners)}, {len(pixels)} and {len(scanned)}"
        )
    inner, lidar_from_camera = decompose(matrix)
    state = State(
        np.array([inner[0, 0], inner[1, 1], inner[0, 2], inner[1, 2]]),
        lidar_from_camera.inverse().matrix[:3],
        np.stack([_pose_of_corners(target, one) for one in corners]),
    )
    measured = stacked_measurements(np.asarray(pixels, np.float64), scanned)

    def joint_errors(at: State) -> np.ndarray:
        return image_errors(at.intrinsics, at.camera, at.targets, measured, target)

    for edge_width in EDGE_WIDTHS:

        def target_errors(at: State, edge_width: float = edge_width) -> np.ndarray:
            edges = edge_errors(at.targets, measured, target, edge_width)
            return np.concatenate([range_errors(at.targets, measured), edges], axis=1)

        state = descend(joint_errors, target_errors, state, 10 if free_intrinsics else 6)
    fx, fy, cx, cy = state.intrinsics
    upper = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Bundle(upper @ state.camera, corners_of_targets(state.targets, target))


def descend(joint_errors: Errors, target_errors: Errors, state: State, shared: int) -> State:
    """Return the state of least squared errors, by the method of Levenberg and Marquardt.

    joint_errors: (P, M) errors that depend on each row's target and on the shared unknowns.
    target_errors: (P, L) errors that depend on the row's target only.
    shared: number of shared unknowns, 6 of the camera or 10 with its intrinsics.

    Targets are independent of each other, so they are eliminated one by one before the camera is
    solved for (Schur complement): time grows with the number of targets, not with its cube.
    """

    def errors(at: State) -> np.ndarray:
        return np.concatenate([joint_errors(at), target_errors(at)], axis=1)

    damping, now = FIRST_DAMPING, errors(state)
    for _ in range(MOST_STEPS):
        by_shared = _jacobian(joint_errors, state, np.eye(shared), np.zeros((shared, 6)))
        by_own = _jacobian(errors, state, np.zeros((6, shared)), np.eye(6))
        for _ in range(MOST_TRIES):
            tried = state.moved(*_step(by_shared, by_own, now, damping))
            after = errors(tried)
            gain = (now**2).sum() - (after**2).sum()
            if gain > 0:
                break
            damping *= RAISED
        else:
            return state
        state, now, damping = tried, after, damping / LOWERED
        if gain < LEAST_GAIN * (1 + (now**2).sum()):
            break
    return state


def _jacobian(errors: Errors, state: State, shared: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return the (P, M, K) derivatives of errors along K directions, by forward differences.

    shared: (K, 6 or 10) and own: (K, 6) parts of the directions; every target has the same ones.
    """
    now, no_step = errors(state), np.zeros((len(state.targets), 6))
    moved = [
        errors(state.moved(DIFFERENCE_STEP * of_shared, no_step + DIFFERENCE_STEP * of_own))
        for of_shared, of_own in zip(shared, own, strict=True)
    ]
    return (np.stack(moved, axis=-1) - now[..., None]) / DIFFERENCE_STEP


def _step(
    by_shared: np.ndarray, by_own: np.ndarray, errors: np.ndarray, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the step of the S shared unknowns, (S,), and of each target's, (P, 6).

    by_shared: (P, M, S) derivatives of the first M errors. by_own: (P, M + L, 6) derivatives of all
    errors. errors: (P, M + L).
    """
    joint = by_shared.shape[1]
    mixed = np.swapaxes(by_shared, 1, 2) @ by_own[:, :joint]
    own_normal = _damped(np.swapaxes(by_own, 1, 2) @ by_own, damping)
    shared_normal = _damped(np.einsum("pms,pmt->st", by_shared, by_shared), damping)
    own_gradient, shared_gradient = (
        np.einsum("pmo,pm->po", by_own, errors),
        np.einsum("pms,pm->s", by_shared, errors[:, :joint]),
    )
    solved = np.linalg.solve(
        own_normal, np.concatenate([np.swapaxes(mixed, 1, 2), own_gradient[..., None]], 2)
    )
    schur = shared_normal - np.einsum("pso,pot->st", mixed, solved[..., :-1])
    reduced_gradient = shared_gradient - np.einsum("pso,po->s", mixed, solved[..., -1])
    step = -np.linalg.lstsq(schur, reduced_gradient)[0]
    return step, -solved[..., -1] - solved[..., :-1] @ step


def _damped(normal: np.ndarray, damping: float) -> np.ndarray:
    """Return (..., K, K) normal matrices with their diagonals raised by the share `damping`."""
    size = normal.shape[-1]
    diagonal = np.einsum("...ii->...i", normal)
    damped: np.ndarray = normal + np.eye(size) * (damping * diagonal + 1e-9)[..., None, :]
    return damped


def _moved(poses: np.ndarray, six: np.ndarray) -> np.ndarray:
    """Turn (P, 3, 4) poses about their own origins by rotation vectors, then shift them."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(six[:, :3]).as_matrix()
    shifted = poses[..., 3] + six[:, 3:]
    return np.concatenate([turns @ poses[..., :3], shifted[..., None]], axis=-1)


def _pose_of_corners(target: TriangularTarget, corners: np.ndarray) -> np.ndarray:
    """Return the (3, 4) pose of a target whose corners fit (3, 3) corners best (Kabsch 1976)."""
    flat = np.column_stack([target.corners, np.zeros(3)])
    middle, centre = corners.mean(axis=0), flat.mean(axis=0)
    left, _, right = np.linalg.svd((corners - middle).T @ (flat - centre))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.column_stack([turn, middle - turn @ centre])
