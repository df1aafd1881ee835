"""Overlap of boxes: from above and in space, exact, with the generalised one."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

CORNERS = 16
"""Room for corners: 8 are left at most when one rectangle is cut by another, a few more when
rounding bends a side."""


@compiled()
def box_overlaps(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of (N, 5) and (M, 5) rectangles.

    Each rectangle is cut by the four sides of the other in the other's frame (Sutherland and
    Hodgman 1974), where the sides are x = +-l/2 and y = +-w/2; what is left is measured with
    the shoelace formula.
    """
    shares = np.zeros((len(one), len(other)))
    polygon, cut = np.empty((CORNERS, 2)), np.empty((CORNERS, 2))
    reach, other_reach = _half_diagonals(one[:, 2:4]), _half_diagonals(other[:, 2:4])
    for i in range(len(one)):
        for j in range(len(other)):
            dx, dy = one[i, 0] - other[j, 0], one[i, 1] - other[j, 1]
            if dx * dx + dy * dy >= (reach[i] + other_reach[j]) ** 2:
                continue
            _corners_within(one[i], other[j], polygon)
            common = _common_area(polygon, cut, other[j, 2] / 2, other[j, 3] / 2)
            whole = one[i, 2] * one[i, 3] + other[j, 2] * other[j, 3] - common
            shares[i, j] = min(common / whole, 1.0)
    return shares


@compiled()
def box_overlaps_3d(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of upright (N, 7) and (M, 7) boxes.

    A box is its centre x, y, z, length, width, height (metres) and yaw (radians).
    """
    return _in_space(one, other, False, -1.0)


@compiled()
def generalised_overlaps_3d(one: np.ndarray, other: np.ndarray, least: float = -1.0) -> np.ndarray:
    """Return (N, M) generalised IoU of upright (N, 7) and (M, 7) boxes, -1 to 1.

    What the least upright prism around both leaves empty counts against them (Rezatofighi et al.
    2019), so that boxes apart are told from boxes further apart. Pairs that are seen to lie below
    `least` without working it out are given -1.
    """
    return _in_space(one, other, True, least)


@compiled()
def _in_space(one: np.ndarray, other: np.ndarray, generalised: bool, least: float) -> np.ndarray:
    shares = np.full((len(one), len(other)), -1.0 if generalised else 0.0)
    if len(other) == 0:
        return shares
    polygon, cut = np.empty((CORNERS, 2)), np.empty((CORNERS, 2))
    flat, others = np.empty((len(one), 5)), np.empty((len(other), 5))
    for k in range(5):
        column = (0, 1, 3, 4, 6)[k]
        flat[:, k], others[:, k] = one[:, column], other[:, column]
    reach, other_reach = _half_diagonals(flat[:, 2:4]), _half_diagonals(others[:, 2:4])
    sides, other_sides = _half_sides(flat), _half_sides(others)
    volumes, other_volumes = _volumes(one), _volumes(other)
    # Along x pairs that are far apart are passed over without a look.
    order = np.argsort(others[:, 0])
    ahead = others[order, 0]
    narrowest = np.minimum(others[:, 2], others[:, 3]).min()
    for i in range(len(one)):
        far = reach[i] + other_reach.max()
        if generalised:
            width = min(flat[i, 2], flat[i, 3]) + narrowest
            most = 2 * (volumes[i] + other_volumes.max())
            far = max(far, most / ((1 + least) * one[i, 5] * width))
        for at in range(np.searchsorted(ahead, flat[i, 0] - far), len(order)):
            if ahead[at] > flat[i, 0] + far:
                break
            j = order[at]
            dx, dy = flat[i, 0] - others[j, 0], flat[i, 1] - others[j, 1]
            near = dx * dx + dy * dy < (reach[i] + other_reach[j]) ** 2
            if not near and not generalised:
                continue
            whole = volumes[i] + other_volumes[j]
            if not near:
                # The hull holds the four corners that lie farthest off the line of centres, and
                # beyond them the outer half of each box.
                within = _band(sides[i], dx, dy) + _band(other_sides[j], dx, dy)
                within += (flat[i, 2] * flat[i, 3] + others[j, 2] * others[j, 3]) / 2
                if whole < (1 + least) * max(one[i, 5], other[j, 5]) * within:
                    continue
            low, high = _heights(one[i], other[j], True)
            common = 0.0
            if near and low < high:
                _corners_within(flat[i], others[j], polygon)
                area = _common_area(polygon, cut, others[j, 2] / 2, others[j, 3] / 2)
                common = area * (high - low)
            whole -= common
            shares[i, j] = min(common / whole, 1.0)
            if generalised:
                bottom, top = _heights(one[i], other[j], False)
                around = max(_hull_area(flat[i], others[j]) * (top - bottom), whole)
                shares[i, j] -= (around - whole) / around
    return shares


@compiled()
def _volumes(boxes: np.ndarray) -> np.ndarray:
    volumes: np.ndarray = boxes[:, 3] * boxes[:, 4] * boxes[:, 5]
    return volumes


@compiled()
def _half_diagonals(sizes: np.ndarray) -> np.ndarray:
    """Return (N,) how far the corners of rectangles of (N, 2) lengths and widths reach."""
    reach: np.ndarray = np.sqrt(sizes[:, 0] ** 2 + sizes[:, 1] ** 2) / 2
    return reach


@compiled()
def _half_sides(boxes: np.ndarray) -> np.ndarray:
    """Return (N, 4) half the length and half the width as vectors."""
    sides = np.empty((len(boxes), 4))
    c, s = np.cos(boxes[:, 4]) / 2, np.sin(boxes[:, 4]) / 2
    sides[:, 0], sides[:, 1] = c * boxes[:, 2], s * boxes[:, 2]
    sides[:, 2], sides[:, 3] = -s * boxes[:, 3], c * boxes[:, 3]
    return sides


@compiled()
def _band(sides: np.ndarray, dx: float, dy: float) -> float:
    """Return how far a box reaches to either side of a line, times the line's length."""
    return float(abs(sides[0] * dy - sides[1] * dx) + abs(sides[2] * dy - sides[3] * dx))


@compiled()
def _heights(one: np.ndarray, other: np.ndarray, common: bool) -> tuple[float, float]:
    """Return lowest and highest z that both boxes have, or that either has."""
    low, low_too = one[2] - one[5] / 2, other[2] - other[5] / 2
    high, high_too = one[2] + one[5] / 2, other[2] + other[5] / 2
    if common:
        return max(low, low_too), min(high, high_too)
    return min(low, low_too), max(high, high_too)


@compiled()
def _hull_area(one: np.ndarray, other: np.ndarray) -> float:
    """Return the area of the convex hull of two rectangles' corners (Andrew 1979)."""
    corners, hull = np.empty((8, 2)), np.empty((10, 2))
    corner = np.empty((4, 2))
    _corners_within(one, other, corner)
    corners[:4] = corner
    for k in range(4):
        corners[4 + k, 0] = other[2] / 2 * (1 if k in (0, 3) else -1)
        corners[4 + k, 1] = other[3] / 2 * (1 if k in (0, 1) else -1)
    for k in range(1, 8):
        x, y, at = corners[k, 0], corners[k, 1], k
        while at > 0 and (corners[at - 1, 0], corners[at - 1, 1]) > (x, y):
            corners[at, 0], corners[at, 1] = corners[at - 1, 0], corners[at - 1, 1]
            at -= 1
        corners[at, 0], corners[at, 1] = x, y
    n, lower = 0, 1
    for step in range(15):
        k = step if step < 8 else 14 - step
        least = lower + 1
        while n >= least and _turn(hull, n, corners[k, 0], corners[k, 1]) <= 0:
            n -= 1
        hull[n, 0], hull[n, 1] = corners[k, 0], corners[k, 1]
        n += 1
        if step == 7:
            lower = n
    return _area(hull, n - 1)


@compiled()
def _turn(hull: np.ndarray, n: int, x: float, y: float) -> float:
    """Return twice the area of the hull's last two corners and a point, positive to the left."""
    ax, ay, bx, by = hull[n - 2, 0], hull[n - 2, 1], hull[n - 1, 0], hull[n - 1, 1]
    return float((bx - ax) * (y - ay) - (by - ay) * (x - ax))


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
            for k in range(n):
                polygon[k, 0], polygon[k, 1] = cut[k, 0], cut[k, 1]
    return _area(polygon, n)


@compiled()
def _area(polygon: np.ndarray, n: int) -> float:
    """Return the area of a polygon of n corners, counter-clockwise (shoelace formula)."""
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
            for of in range(2):
                cut[kept, of] = polygon[before, of] + share * (polygon[k, of] - polygon[before, of])
            kept += 1
        if room >= 0:
            cut[kept, 0], cut[kept, 1] = polygon[k, 0], polygon[k, 1]
            kept += 1
    return kept
