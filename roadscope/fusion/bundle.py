"""Bundle adjustment of camera and targets, from all that both sensors measured of the targets.

The errors of a target's three corners in a scan are correlated: if the target seems turned in its
plane, all of them are displaced. Therefore the pose of every target is an unknown, like that of the
camera. The residuals are those of the measurements: corners in pixels, the plane of the ranges, and
which beams met the target and which passed beside it.
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
"""Widths of edges in successive refinements, as shares of the step between columns: wide at first,
so that beams far from the edge have an effect. The last stands for the width of a beam; for wide
beams it would be a third of a step."""
BUMP = 1e-6
"""Step of numerical derivatives."""
PIXELS_A_UNIT = 1000.0
"""Intrinsics are counted in thousands of pixels, so that all unknowns have similar scales."""
STEPS = 50
ENOUGH = 1e-4
"""A step that improves twice the negative log likelihood by less than this share is the last."""


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
        """Turn and move; shared: (6,) of the camera or (10,) with intrinsics. own: (P, 6)."""
        intrinsics = self.intrinsics
        if len(shared) > 6:
            intrinsics = intrinsics + PIXELS_A_UNIT * shared[6:]
        return State(
            intrinsics, _moved(self.camera[None], shared[None, :6])[0], _moved(self.targets, own)
        )


Errors = Callable[[State], np.ndarray]


def refine(
    matrix: np.ndarray,
    corners: np.ndarray,
    pixels: np.ndarray,
    scanned: Sequence[ScannedTarget],
    target: TriangularTarget,
    *,
    free_intrinsics: bool = True,
    edge_widths: Sequence[float] = EDGE_WIDTHS,
) -> Bundle:
    """Find the likeliest camera and targets, from a start nearby.

    matrix: (3, 4) LiDAR frame to pixels. corners: (P, 3, 3) left, right and top of each target,
    LiDAR frame. pixels: (P, 3, 2). free_intrinsics: whether the intrinsics are unknown; otherwise
    those of the matrix are kept. edge_widths: see `EDGE_WIDTHS`. Raises `CalibrationError` if no
    camera has this matrix, or if the numbers of targets differ.
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

    def image(at: State) -> np.ndarray:
        return image_errors(at.intrinsics, at.camera, at.targets, measured, target)

    for edge_width in edge_widths:

        def alone(at: State, edge_width: float = edge_width) -> np.ndarray:
            edges = edge_errors(at.targets, measured, target, edge_width)
            return np.concatenate([range_errors(at.targets, measured), edges], axis=1)

        state = descend(image, alone, state, 10 if free_intrinsics else 6)
    fx, fy, cx, cy = state.intrinsics
    upper = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Bundle(upper @ state.camera, corners_of_targets(state.targets, target))


def descend(image: Errors, alone: Errors, state: State, shared: int) -> State:
    """Levenberg and Marquardt; shared: 6 unknowns of the camera, or 10 with its intrinsics.

    image: (P, M) errors that depend on each row's target and on the shared unknowns. alone: (P, L)
    errors that depend on the row's target only. Targets are independent of each other, so they are
    eliminated one by one before the camera is solved for (Schur complement): time grows with the
    number of targets, not with its cube.
    """

    def errors(at: State) -> np.ndarray:
        return np.concatenate([image(at), alone(at)], axis=1)

    damping, now = 1e-3, errors(state)
    for _ in range(STEPS):
        ours = _slopes(image, state, np.eye(shared), np.zeros((shared, 6)))
        own = _slopes(errors, state, np.zeros((6, shared)), np.eye(6))
        for _ in range(8):
            tried = state.moved(*_step(ours, own, now, damping))
            after = errors(tried)
            gain = (now**2).sum() - (after**2).sum()
            if gain > 0:
                break
            damping *= 4
        else:
            return state
        state, now, damping = tried, after, damping / 5
        if gain < ENOUGH * (1 + (now**2).sum()):
            break
    return state


def _slopes(errors: Errors, state: State, shared: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(P, M, K) derivatives by differences along K directions, of all targets at once.

    shared: (K, 6 or 10), own: (K, 6), the same for every target.
    """
    now, still = errors(state), np.zeros((len(state.targets), 6))
    bumped = [
        errors(state.moved(BUMP * ours, still + BUMP * theirs))
        for ours, theirs in zip(shared, own, strict=True)
    ]
    return (np.stack(bumped, axis=-1) - now[..., None]) / BUMP


def _step(
    shared: np.ndarray, own: np.ndarray, errors: np.ndarray, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the step of the shared unknowns and of each target's.

    shared: (P, M, S) of the first M errors. own: (P, M + L, 6). errors: (P, M + L).
    """
    first = shared.shape[1]
    mixed = np.swapaxes(shared, 1, 2) @ own[:, :first]
    inner = _damped(np.swapaxes(own, 1, 2) @ own, damping)
    outer = _damped(np.einsum("pms,pmt->st", shared, shared), damping)
    pull, push = (
        np.einsum("pmo,pm->po", own, errors),
        np.einsum("pms,pm->s", shared, errors[:, :first]),
    )
    solved = np.linalg.solve(inner, np.concatenate([np.swapaxes(mixed, 1, 2), pull[..., None]], 2))
    left = outer - np.einsum("pso,pot->st", mixed, solved[..., :-1])
    step = -np.linalg.lstsq(left, push - np.einsum("pso,po->s", mixed, solved[..., -1]))[0]
    return step, -solved[..., -1] - solved[..., :-1] @ step


def _damped(squares: np.ndarray, damping: float) -> np.ndarray:
    size = squares.shape[-1]
    diagonal = np.einsum("...ii->...i", squares)
    damped: np.ndarray = squares + np.eye(size) * (damping * diagonal + 1e-9)[..., None, :]
    return damped


def _moved(poses: np.ndarray, six: np.ndarray) -> np.ndarray:
    """Turn (P, 3, 4) poses about their own origins by rotation vectors, then shift them."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(six[:, :3]).as_matrix()
    shifted = poses[..., 3] + six[:, 3:]
    return np.concatenate([turns @ poses[..., :3], shifted[..., None]], axis=-1)


def _pose_of_corners(target: TriangularTarget, corners: np.ndarray) -> np.ndarray:
    """(3, 4) pose of a target whose corners are nearest to given ones (Kabsch)."""
    flat = np.column_stack([target.corners, np.zeros(3)])
    middle, centre = corners.mean(axis=0), flat.mean(axis=0)
    left, _, right = np.linalg.svd((corners - middle).T @ (flat - centre))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.column_stack([turn, middle - turn @ centre])
