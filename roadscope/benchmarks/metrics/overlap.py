"""Intersection over union of rotated boxes seen from above, exact."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Truth
from roadscope.envs.raycast.jit import compiled

CORNERS = 16
"""Room for corners: 8 are left at most when one rectangle is cut by another, a few more when
rounding bends a side."""


def overlaps(found: Detections, truth: Truth) -> np.ndarray:
    """Return (N, M) intersection over union of boxes of one frame, seen from above, 0 to 1."""
    return box_overlaps(rectangles(found), rectangles(truth))


def rectangles(boxes: Detections | Truth) -> np.ndarray:
    """Return (N, 5) centre x, y, length, width (metres) and yaw (radians)."""
    return np.column_stack([boxes.centres[:, :2], boxes.sizes[:, :2], boxes.yaws])


@compiled()
def box_overlaps(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of (N, 5) and (M, 5) rectangles.

    Each rectangle is cut by the four sides of the other in the other's frame (Sutherland and
    Hodgman 1974), where the sides are x = +-l/2 and y = +-w/2; what is left is measured with
    the shoelace formula.
    """
    shares = np.zeros((len(one), len(other)))
    polygon, cut = np.empty((CORNERS, 2)), np.empty((CORNERS, 2))
    for i in range(len(one)):
        for j in range(len(other)):
            reach = np.hypot(one[i, 2], one[i, 3]) + np.hypot(other[j, 2], other[j, 3])
            if 2 * np.hypot(one[i, 0] - other[j, 0], one[i, 1] - other[j, 1]) >= reach:
                continue
            _corners_within(one[i], other[j], polygon)
            common = _common_area(polygon, cut, other[j, 2] / 2, other[j, 3] / 2)
            whole = one[i, 2] * one[i, 3] + other[j, 2] * other[j, 3] - common
            shares[i, j] = min(common / whole, 1.0)
    return shares


@compiled()
def _corners_within(one: np.ndarray, other: np.ndarray, polygon: np.ndarray) -> None:
    """Write the four corners of one rectangle in the frame of the other, counter-clockwise."""
    dx, dy = one[0] - other[0], one[1] - other[1]
    c, s = np.cos(other[4]), np.sin(other[4])
    x, y = c * dx + s * dy, c * dy - s * dx
    turn = one[4] - other[4]
    c, s = np.cos(turn), np.sin(turn)
    for k in range(4):
        along = one[2] / 2 * (1 if k in (0, 3) else -1)
        across = one[3] / 2 * (1 if k in (0, 1) else -1)
        polygon[k, 0] = x + c * along - s * across
        polygon[k, 1] = y + s * along + c * across


@compiled()
def _common_area(
    polygon: np.ndarray, cut: np.ndarray, half_length: float, half_width: float
) -> float:
    """Return the area of a convex polygon of four corners within |x|, |y| of the halves."""
    n = 4
    for axis in range(2):
        limit = half_length if axis == 0 else half_width
        for side in (1.0, -1.0):
            n = _cut(polygon, n, cut, axis, side, limit)
            polygon[:n] = cut[:n]
    twice = 0.0
    for k in range(n):
        after = k + 1 if k + 1 < n else 0
        twice += polygon[k, 0] * polygon[after, 1] - polygon[after, 0] * polygon[k, 1]
    return float(max(twice / 2, 0.0))


@compiled()
def _cut(polygon: np.ndarray, n: int, cut: np.ndarray, axis: int, side: float, limit: float) -> int:
    """Write the part of a polygon where side * axis <= limit; return its number of corners."""
    kept = 0
    for k in range(n):
        before = k - 1 if k > 0 else n - 1
        room, room_before = limit - side * polygon[k, axis], limit - side * polygon[before, axis]
        if (room >= 0) != (room_before >= 0):
            share = room_before / (room_before - room)
            cut[kept] = polygon[before] + share * (polygon[k] - polygon[before])
            kept += 1
        if room >= 0:
            cut[kept] = polygon[k]
            kept += 1
    return kept
