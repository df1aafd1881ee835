"""What both sensors should have seen of boards that stand in given poses, against what they saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.fusion.board import Board
from roadscope.fusion.board_sight import BoardSight

PIXEL_SIGMA = 0.2
"""Standard deviation of a corner in the image, pixels."""
STRAY = 0.01
"""Share of beams that meet something else or get lost."""
ROBUST = 3.0
"""From so many standard deviations on, errors count by their amount rather than their square."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Measurements of P boards, the beams of each filled up to the same N.

    pixels: (P, 3, 2). planes: (P, 3), roots: (P, 3, 3), as in `BoardSight`. rays: (P, N, 3).
    met: (P, N). real: (P, N) bool, false where filled up. steps: (P, 1), radians.
    """

    pixels: np.ndarray
    planes: np.ndarray
    roots: np.ndarray
    rays: np.ndarray
    met: np.ndarray
    real: np.ndarray
    steps: np.ndarray


def stacked(pixels: np.ndarray, sights: Sequence[BoardSight]) -> Seen:
    """Put what was seen of the boards beside each other; pixels: (P, 3, 2)."""
    most = max(len(sight.rays) for sight in sights)
    rays = np.stack([np.resize(sight.rays, (most, 3)) for sight in sights])
    met = np.stack([np.resize(sight.met, most) for sight in sights])
    real = np.arange(most) < np.array([[len(sight.rays)] for sight in sights])
    planes, roots = np.stack([s.plane for s in sights]), np.stack([s.plane_root for s in sights])
    return Seen(pixels, planes, roots, rays, met, real, np.array([[s.step_rad] for s in sights]))


def corners_of_boards(boards: np.ndarray, board: Board) -> np.ndarray:
    """(P, 3, 3) corners of boards in poses (P, 3, 4): right, up, towards the sensor, middle."""
    corners: np.ndarray = np.einsum("pij,kj->pki", boards[:, :, :2], board.corners)
    return np.asarray(corners + boards[:, None, :, 3])


def image_errors(
    inner: np.ndarray, camera: np.ndarray, boards: np.ndarray, seen: Seen, board: Board
) -> np.ndarray:
    """(P, 6) errors of corners in pixels, in standard deviations.

    inner: (4,) fx, fy, cx, cy. camera: (3, 4) camera_from_lidar.
    """
    placed = corners_of_boards(boards, board) @ camera[:, :3].T + camera[:, 3]
    pixels = inner[:2] * placed[..., :2] / np.maximum(placed[..., 2:], 1e-3) + inner[2:]
    return _softened(((pixels - seen.pixels) / PIXEL_SIGMA).reshape(len(boards), 6))


def range_errors(boards: np.ndarray, seen: Seen) -> np.ndarray:
    """(P, 3) errors of the planes, in standard deviations."""
    return _softened(np.einsum("pij,pj->pi", seen.roots, planes_of(boards) - seen.planes))


def edge_errors(boards: np.ndarray, seen: Seen, board: Board, spot: float) -> np.ndarray:
    """(P, N) roots of twice the lost log likelihood of beams that met the board or passed it.

    spot: standard deviation of where a beam ends, as share of the step between columns.
    """
    from scipy.special import ndtr

    inside, reach = _inside(boards, seen, board)
    chance = STRAY + (1 - 2 * STRAY) * ndtr(inside / (spot * seen.steps * reach))
    lost = -seen.met * np.log(chance) - (1 - seen.met) * np.log(1 - chance)
    # The floor keeps the root's slope finite.
    return np.where(seen.real, np.sqrt(2 * np.maximum(lost + np.log(1 - STRAY), 1e-12)), 0.0)


def planes_of(boards: np.ndarray) -> np.ndarray:
    """(P, 3) q of the boards' planes q . p = 1."""
    normals, middles = boards[:, :, 2], boards[:, :, 3]
    planes: np.ndarray = normals / (normals * middles).sum(axis=1, keepdims=True)
    return planes


def _inside(boards: np.ndarray, seen: Seen, board: Board) -> tuple[np.ndarray, np.ndarray]:
    """(P, N) metres of each beam from the nearest edge, positive inside, and its range."""
    along = np.einsum("pni,pi->pn", seen.rays, planes_of(boards))
    reach = 1 / np.maximum(along, 1e-3)
    from_middle = seen.rays * reach[..., None] - boards[:, None, :, 3]
    flat = from_middle @ boards[:, :, :2]
    inside = np.full(reach.shape, np.inf)
    for start, end in zip(board.corners, np.roll(board.corners, -1, axis=0), strict=True):
        way = (end - start) / np.linalg.norm(end - start)
        off = flat - start
        inside = np.minimum(inside, off[..., 1] * way[0] - off[..., 0] * way[1])
    return inside, reach


def _softened(errors: np.ndarray) -> np.ndarray:
    """Errors whose squares are the robust loss 2 c^2 (sqrt(1 + (e / c)^2) - 1)."""
    # 2 c^2 (sqrt(1 + x) - 1) = 2 e^2 / (sqrt(1 + x) + 1), which does not cancel.
    softer: np.ndarray = errors * np.sqrt(2 / (np.sqrt(1 + (errors / ROBUST) ** 2) + 1))
    return softer
