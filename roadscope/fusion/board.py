"""A triangular board's corners in both sensors (Li 2021, 2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.fusion.calibration import CalibrationError

LEAST_RINGS = 3
LEAST_ROWS_PX = 12
BLUR_PX = 4
"""Farther than this from an edge, smoothed values are those of inside and outside."""
TRIM = 0.12
"""Share of an edge at each of its ends that is left out: corners are rounded by pixels."""


@dataclass(frozen=True, slots=True)
class Board:
    """An isosceles triangle that stands on its base; all in metres."""

    base_m: float = 1.5
    height_m: float = 1.2

    @property
    def corners(self) -> np.ndarray:
        """(3, 2) left, right, top, in the board's plane about the middle of the base."""
        half = self.base_m / 2
        return np.array([[-half, 0.0], [half, 0.0], [0.0, self.height_m]])


def corners_in_scans(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, board: Board, step_rad: float
) -> np.ndarray:
    """Return (3, 3) left, right and top corner, LiDAR frame, from returns of the board alone.

    points: (N, 3) metres, of one or more scans of a board at rest. ring, column: (N,) of each.
    step_rad: between neighbouring columns. Beams are right in direction and wrong in range, so a
    plane gives the ranges; a ring ends half a step beyond its last beams, and the triangle of
    known size is laid on these ends by least squares.
    """
    if len(np.unique(ring)) < LEAST_RINGS:
        raise CalibrationError(
            f"the board was met by {len(np.unique(ring))} rings, {LEAST_RINGS} are needed"
        )
    normal, offset = _plane(points)
    across = np.cross([0.0, 0.0, 1.0], normal)
    across /= np.linalg.norm(across)
    up = np.cross(normal, across)
    ends, sides = _ends(points, ring, column, step_rad)
    rays = ends / np.linalg.norm(ends, axis=1, keepdims=True)
    on_plane = rays * (offset / (rays @ normal))[:, None]
    flat = np.column_stack([on_plane @ across, on_plane @ up])
    # Across runs to the left of the sight or to the right, by the sign of the normal.
    if flat[sides > 0, 0].mean() < flat[sides < 0, 0].mean():
        across, flat = -across, flat * [-1.0, 1.0]
    corners = _laid(board.corners, flat, sides)
    placed: np.ndarray = (
        corners[:, :1] * across + corners[:, 1:] * up + offset * normal
    )  # the plane's point nearest to the sensor is the origin of flat coordinates
    return placed


def corners_in_image(grey: np.ndarray) -> np.ndarray:
    """Return (3, 2) left, right and top corner in pixels of a bright triangle in a dark scene.

    grey: (H, W). The largest bright patch is the board; its edges are lines through where rows
    and columns cross the middle between bright and dark, to a part of a pixel.
    """
    from scipy.ndimage import gaussian_filter, label

    smooth = gaussian_filter(grey.astype(np.float64), 1.0)
    level = (np.percentile(smooth, 99.9) + np.median(smooth)) / 2
    patches, count = label(smooth > level)
    if not count:
        raise CalibrationError("no bright board in the image")
    largest = int(np.bincount(patches.ravel())[1:].argmax()) + 1
    rows, columns = np.nonzero(patches == largest)
    top, bottom = int(rows.min()), int(rows.max())
    if bottom - top < LEAST_ROWS_PX:
        raise CalibrationError(f"the board is {bottom - top} pixels high, {LEAST_ROWS_PX} needed")
    if top == 0 or bottom == grey.shape[0] - 1 or columns.min() == 0 or (
        columns.max() == grey.shape[1] - 1
    ):  # fmt: skip
        raise CalibrationError("the image cuts the board")
    inside = _within(top, bottom)
    lines = []
    for edge, step in ((np.min, -1), (np.max, 1)):
        found = [(int(edge(columns[rows == row])), row) for row in inside]
        lines.append(_line([(_crossing(smooth[row], c, step), row + 0.5) for c, row in found]))
    spread = _within(int(columns.min()), int(columns.max()))
    feet = [(c, rows[columns == c].max()) for c in spread]
    lines.append(_line([(c + 0.5, _crossing(smooth[:, c], int(r), 1)) for c, r in feet]))
    left, right, base = lines
    return np.array([_meet(left, base), _meet(right, base), _meet(left, right)])


def _plane(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return unit normal away from the sensor and distance of the plane whose ranges fit best.

    For n . p = d and p = range * ray, 1 / range = (n / d) . ray: linear in n / d, and noise
    stays along the ray. Twice, the second time without what lies far off.
    """
    ranges = np.linalg.norm(points, axis=1)
    rays = points / ranges[:, None]
    kept = np.ones(len(points), bool)
    for _ in range(2):
        solved = np.linalg.lstsq(rays[kept] * ranges[kept, None], np.ones(kept.sum()), rcond=None)[
            0
        ]
        off = np.abs(1 / np.maximum(rays @ solved, 1e-9) - ranges)
        kept = off < 3 * max(1.5 * float(np.median(off)), 1e-6)
    length = float(np.linalg.norm(solved))
    return solved / length, 1 / length


def _ends(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, step_rad: float
) -> tuple[np.ndarray, np.ndarray]:
    """Directions half a step beyond each ring's ends, and on which side: -1 right, 1 left."""
    found, sides = [], []
    for one in np.unique(ring):
        members = np.flatnonzero(ring == one)
        azimuths = np.arctan2(points[members, 1], points[members, 0])
        for side in (-1.0, 1.0):
            last = members[(side * azimuths).argmax()]
            same = points[members[column[members] == column[last]]].mean(axis=0)
            turn = side * step_rad / 2
            c, s = np.cos(turn), np.sin(turn)
            x, y, z = same
            found.append([c * x - s * y, s * x + c * y, z])
            sides.append(side)
    return np.array(found), np.array(sides)


def _laid(corners: np.ndarray, ends: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Move and turn a triangle so that ends lie on its slopes; left has greater first values."""
    from scipy.optimize import least_squares

    mirrored = corners * [-1.0, 1.0]
    left, right, top = mirrored

    def moved(numbers: np.ndarray) -> np.ndarray:
        c, s = np.cos(numbers[2]), np.sin(numbers[2])
        result: np.ndarray = mirrored @ np.array([[c, s], [-s, c]]) + numbers[:2]
        return result

    def off(numbers: np.ndarray) -> np.ndarray:
        a, b, peak = moved(numbers)
        return np.where(sides > 0, _beside(ends, a, peak), _beside(ends, b, peak))

    widths = ends[sides > 0, 0].mean() - ends[sides < 0, 0].mean()
    share = np.clip(widths / np.linalg.norm(left - right), 0.0, 1.0)
    start = [ends[:, 0].mean(), ends[:, 1].mean() - (1 - share) * top[1], 0.0]
    found = least_squares(off, start, loss="soft_l1", f_scale=0.02)
    return moved(found.x)


def _beside(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    way = (end - start) / np.linalg.norm(end - start)
    apart = points - start
    result: np.ndarray = apart[:, 0] * way[1] - apart[:, 1] * way[0]
    return result


def _within(low: int, high: int) -> np.ndarray:
    trim = TRIM * (high - low)
    return np.arange(int(np.ceil(low + trim)), int(high - trim) + 1)


def _crossing(values: np.ndarray, near: int, step: int) -> float:
    """Where values fall through the middle between inside and outside, in pixel edges.

    near: an index at the edge; step: 1 or -1, the way out. What lies outside differs along the
    edge, road here and sky there, so each crossing has a middle of its own.
    """
    reach = [k for k in near + step * np.arange(-BLUR_PX, BLUR_PX + 1) if 0 <= k < len(values)]
    level = (values[reach[0]] + values[reach[-1]]) / 2
    for k, after in pairwise(reach):
        if values[k] > level >= values[after]:
            share = (values[k] - level) / (values[k] - values[after])
            return k + 0.5 + step * float(share)
    return near + 0.5


def _line(points: list[tuple[float, float]]) -> np.ndarray:
    """(3,) a x + b y = c of unit normal, least squares, then without the farthest."""
    kept = np.array(points)
    line = np.zeros(3)
    for _ in range(8):
        middle = kept.mean(axis=0)
        normal = np.linalg.svd(kept - middle)[2][1]
        line = np.append(normal, normal @ middle)
        off = np.abs(kept @ normal - line[2])
        kept = kept[off <= max(2.5 * float(np.median(off)), 0.2)]
    return line


def _meet(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    matrix = np.stack([first[:2], second[:2]])
    if abs(np.linalg.det(matrix)) < 1e-6:
        raise CalibrationError("two edges of the board are parallel in the image")
    solved: np.ndarray = np.linalg.solve(matrix, [first[2], second[2]])
    return solved
