"""Camera and boards found together from all that both sensors saw of the boards.

Corners out of returns are wrong in ways that belong together: a board that seems turned in its
plane has all three beside their places. So every board's pose is an unknown beside the camera's,
and what is compared is what was measured: corners in pixels, the plane of the ranges, and which
beams met the board and which passed beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.fusion.calibration import CalibrationError, decompose
from roadscope.fusion.calibration_target import (
    Board,
    BoardSight,
    corners_of_boards,
    edge_errors,
    image_errors,
    range_errors,
    stacked,
)

SPOTS = (0.5, 0.25, 0.1)
"""Softness of edges, as shares of the step between columns: first soft, so that far beams pull.

The last is taken for the width of a beam: a third of a step for a wide one, hence the setting."""
BUMP = 1e-6
PIXELS_A_UNIT = 1000.0
"""Intrinsics are counted in thousands of pixels, so that all unknowns move on like scales."""
STEPS = 50
ENOUGH = 1e-4
"""A step that betters twice the negative log likelihood by less than this share is the last."""


@dataclass(frozen=True, slots=True, eq=False)
class Bundle:
    """matrix: (3, 4), LiDAR frame to pixels. corners: (P, 3, 3) of the boards, LiDAR frame."""

    matrix: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Unknowns. inner: (4,) fx, fy, cx, cy. camera: (3, 4) camera_from_lidar. boards: (P, 3, 4).

    A board's axes are right, up and towards the sensor; its origin is the middle of its base.
    """

    inner: np.ndarray
    camera: np.ndarray
    boards: np.ndarray

    def moved(self, shared: np.ndarray, own: np.ndarray) -> State:
        """Turn and move; shared: (6,) of the camera or (10,) with intrinsics. own: (P, 6)."""
        inner = self.inner
        if len(shared) > 6:
            inner = inner + PIXELS_A_UNIT * shared[6:]
        return State(
            inner, _moved(self.camera[None], shared[None, :6])[0], _moved(self.boards, own)
        )


Errors = Callable[[State], np.ndarray]


def refine(
    matrix: np.ndarray,
    corners: np.ndarray,
    pixels: np.ndarray,
    sights: Sequence[BoardSight],
    board: Board,
    *,
    free: bool = True,
    spots: Sequence[float] = SPOTS,
) -> Bundle:
    """Find the likeliest camera and boards, from a start nearby.

    matrix: (3, 4) LiDAR frame to pixels. corners: (P, 3, 3) left, right and top of each board,
    LiDAR frame. pixels: (P, 3, 2). free: whether the intrinsics are unknown; otherwise those of
    the matrix are kept. spots: softness of edges from first to last, as shares of the step between
    columns. `CalibrationError` where the matrix is no camera's or numbers of boards differ.
    """
    if not len(corners) == len(pixels) == len(sights) > 0:
        raise CalibrationError(
            "expected corners, pixels and sights of as many boards, "
            f"got {len(corners)}, {len(pixels)} and {len(sights)}"
        )
    inner, lidar_from_camera = decompose(matrix)
    state = State(
        np.array([inner[0, 0], inner[1, 1], inner[0, 2], inner[1, 2]]),
        lidar_from_camera.inverse().matrix[:3],
        np.stack([_laid(board, one) for one in corners]),
    )
    seen = stacked(np.asarray(pixels, np.float64), sights)

    def image(at: State) -> np.ndarray:
        return image_errors(at.inner, at.camera, at.boards, seen, board)

    for spot in spots:

        def alone(at: State, spot: float = spot) -> np.ndarray:
            edges = edge_errors(at.boards, seen, board, spot)
            return np.concatenate([range_errors(at.boards, seen), edges], axis=1)

        state = descend(image, alone, state, 10 if free else 6)
    fx, fy, cx, cy = state.inner
    upper = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Bundle(upper @ state.camera, corners_of_boards(state.boards, board))


def descend(image: Errors, alone: Errors, state: State, shared: int) -> State:
    """Levenberg and Marquardt; shared: 6 unknowns of the camera, or 10 with its intrinsics.

    image: (P, M) errors that depend on each row's board and on the shared unknowns. alone: (P, L)
    errors that depend on the row's board only. Boards do not know of each other, so that each is
    solved for alone and the camera from what they leave (Schur complement): time grows with the
    number of boards, not with its cube.
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
    """(P, M, K) derivatives by differences along K directions, of all boards at once.

    shared: (K, 6 or 10), own: (K, 6), the same for every board.
    """
    now, still = errors(state), np.zeros((len(state.boards), 6))
    bumped = [
        errors(state.moved(BUMP * ours, still + BUMP * theirs))
        for ours, theirs in zip(shared, own, strict=True)
    ]
    return (np.stack(bumped, axis=-1) - now[..., None]) / BUMP


def _step(
    shared: np.ndarray, own: np.ndarray, errors: np.ndarray, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the step of the shared unknowns and of each board's.

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


def _laid(board: Board, corners: np.ndarray) -> np.ndarray:
    """(3, 4) pose of a board whose corners are nearest to given ones (Kabsch)."""
    flat = np.column_stack([board.corners, np.zeros(3)])
    middle, centre = corners.mean(axis=0), flat.mean(axis=0)
    left, _, right = np.linalg.svd((corners - middle).T @ (flat - centre))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.column_stack([turn, middle - turn @ centre])
