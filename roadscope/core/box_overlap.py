"""Intersection over union of rectangles seen from above and of upright boxes in space.

For boxes it is plain or generalised (Rezatofighi et al. 2019).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from roadscope.core.jit import compiled


class _UprightBox(Protocol):
    """A record of an upright box in metres.

    x, y: its centre. half_length, half_width: half its sides. cos, sin: of its heading.
    bottom, top: its lowest and highest z. radius: the distance from its centre to a corner.
    """

    x: float
    y: float
    half_length: float
    half_width: float
    cos: float
    sin: float
    bottom: float
    top: float
    radius: float


BOX = np.dtype([(name, np.float64) for name in _UprightBox.__annotations__])
MOST_CORNERS = 16
"""A rectangle that is cut by another one has 8 corners at most, and a few more if rounding bends a
side."""
FIRST_CAPACITY = 256
"""Arrays of pairs have this length at first. They are doubled when they are full."""


def box_overlaps(rectangles: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of (N, 5) and (M, 5) rectangles.

    A rectangle is its centre x, y, length, width (metres) and yaw (radians). The first of two is
    cut by the four sides of the second (Sutherland and Hodgman 1974), in the frame of the second,
    where the sides are x = +-l/2 and y = +-w/2. The shoelace formula gives the area that is left.
    """
    overlaps: np.ndarray = _box_overlaps(
        np.ascontiguousarray(rectangles), np.ascontiguousarray(others)
    )
    return overlaps


@compiled()
def _box_overlaps(rectangles: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return `box_overlaps` of arrays in C order."""
    overlaps = np.zeros((len(rectangles), len(others)))
    boxes, other_boxes = _boxes(rectangles), _boxes(others)
    for i in range(len(boxes)):
        for j in range(len(other_boxes)):
            box, other = boxes[i], other_boxes[j]
            if _circles_meet(box, other):
                common = _common_area(box, other)
                union = _area(box) + _area(other) - common
                overlaps[i, j] = min(common / union, 1.0)
    return overlaps


def box_overlaps_3d(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union in space of upright (N, 7) and (M, 7) boxes.

    A box is its centre x, y, z, length, width, height (metres) and yaw (radians).
    """
    overlaps = np.zeros((len(boxes), len(others)))
    rows, columns, values = overlapping_pairs(boxes, others, generalised=False, least=0.0)
    overlaps[rows, columns] = values
    return overlaps


def overlapping_pairs(
    boxes: np.ndarray, others: np.ndarray, *, generalised: bool, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (P,) rows, columns and overlaps above `least` of upright (N, 7) and (M, 7) boxes.

    Pairs are sorted by row, then by column. A box is its centre x, y, z, length, width, height
    (metres) and yaw (radians).

    generalised: whether the overlap is generalised IoU (Rezatofighi et al. 2019), which falls with
        the distance of boxes that do not meet, or plain intersection over union.
    least: 0 or more for plain, -1 to 1 for generalised IoU.

    Only pairs that are near each other along x are examined: the work grows with their number.
    """
    if len(boxes) == 0 or len(others) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    order = np.argsort(others[:, 0], kind="stable")
    rows, columns, overlaps = _overlapping_pairs(boxes, others[order], generalised, least)
    columns = order[columns]
    by_row_and_column = np.argsort(rows * len(others) + columns)
    return rows[by_row_and_column], columns[by_row_and_column], overlaps[by_row_and_column]


@compiled()
def pair_overlaps(
    boxes: np.ndarray,
    others: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    generalised: bool,
    least: float,
) -> np.ndarray:
    """Return (P,) overlaps of the pairs (rows, columns) of upright (N, 7) and (M, 7) boxes.

    The overlap is the one of `overlapping_pairs`. Where a bound shows that it is below `least`, it
    is not computed, and is -1.
    """
    records, other_records = _boxes(boxes), _boxes(others)
    overlaps = np.empty(len(rows))
    for k in range(len(rows)):
        overlaps[k] = _overlap(records[rows[k]], other_records[columns[k]], generalised, least)
    return overlaps


@compiled()
def _overlapping_pairs(
    boxes: np.ndarray, others: np.ndarray, generalised: bool, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pairs by row as `overlapping_pairs` does; `others` are sorted by x."""
    rows, columns = np.empty(FIRST_CAPACITY, np.int64), np.empty(FIRST_CAPACITY, np.int64)
    overlaps = np.empty(FIRST_CAPACITY)
    count = 0
    records, other_records = _boxes(boxes), _boxes(others)
    reach = _reach(records, other_records, generalised, least)
    for i in range(len(records)):
        box = records[i]
        for j in range(np.searchsorted(others[:, 0], box.x - reach[i]), len(other_records)):
            other = other_records[j]
            if other.x > box.x + reach[i]:
                break
            if abs(other.y - box.y) > reach[i]:
                continue
            overlap = _overlap(box, other, generalised, least)
            if overlap > least:
                if count == len(rows):
                    rows = np.concatenate((rows, rows))
                    columns = np.concatenate((columns, columns))
                    overlaps = np.concatenate((overlaps, overlaps))
                rows[count], columns[count], overlaps[count] = i, j, overlap
                count += 1
    return rows[:count], columns[:count], overlaps[:count]


@compiled()
def _boxes(values: np.ndarray) -> np.ndarray:
    """Return (N,) records of (N, 7) boxes or (N, 5) rectangles, which have no height."""
    boxes = np.zeros(len(values), BOX)
    upright = values.shape[1] == 7
    size_column = 3 if upright else 2
    for i in range(len(values)):
        length, width = values[i, size_column], values[i, size_column + 1]
        yaw = values[i, 6 if upright else 4]
        boxes[i].x, boxes[i].y = values[i, 0], values[i, 1]
        boxes[i].half_length, boxes[i].half_width = length / 2, width / 2
        boxes[i].cos, boxes[i].sin = np.cos(yaw), np.sin(yaw)
        boxes[i].radius = np.sqrt(length**2 + width**2) / 2
        if upright:
            boxes[i].bottom = values[i, 2] - values[i, 5] / 2
            boxes[i].top = values[i, 2] + values[i, 5] / 2
    return boxes


@compiled()
def _reach(boxes: np.ndarray, others: np.ndarray, generalised: bool, least: float) -> np.ndarray:
    """Return (N,) distances in x and y beyond which no box overlaps another by more than `least`.

    Generalised IoU of boxes that do not meet is the sum of their volumes over that of their hull,
    minus 1. The hull is at least the height of one times their mean width times their distance.
    """
    reach: np.ndarray = boxes["radius"] + others["radius"].max()
    if generalised:
        largest, narrowest = 0.0, np.inf
        for other in others:
            largest = max(largest, _area(other) * (other.top - other.bottom))
            narrowest = min(narrowest, 2 * min(other.half_length, other.half_width))
        for i in range(len(boxes)):
            box = boxes[i]
            height = box.top - box.bottom
            width = 2 * min(box.half_length, box.half_width) + narrowest
            twice_volume = 2 * (_area(box) * height + largest)
            reach[i] = max(reach[i], twice_volume / ((1 + least) * height * width))
    return reach


@compiled()
def _overlap(box: _UprightBox, other: _UprightBox, generalised: bool, least: float) -> float:
    """Return the overlap in space; a generalised one is -1 if a bound shows it is below `least`."""
    meeting = _circles_meet(box, other)
    volumes = _area(box) * (box.top - box.bottom) + _area(other) * (other.top - other.bottom)
    if generalised and not meeting and _is_below(box, other, volumes, least):
        return -1.0
    overlap = 0.0
    common_height = min(box.top, other.top) - max(box.bottom, other.bottom)
    if meeting and common_height > 0:
        common = common_height * _common_area(box, other)
        overlap = min(common / (volumes - common), 1.0)
    if not generalised:
        return overlap
    union = volumes / (1 + overlap)
    height = max(box.top, other.top) - min(box.bottom, other.bottom)
    hull = max(_hull_area(box, other) * height, union)
    return overlap - (hull - union) / hull


@compiled()
def _is_below(box: _UprightBox, other: _UprightBox, volumes: float, least: float) -> bool:
    """Return whether generalised IoU of two boxes that do not meet is below `least` for certain.

    The convex hull from above holds the four corners that lie farthest from the line of centres
    and, beyond them, the outer half of each box.
    """
    dx, dy = box.x - other.x, box.y - other.y
    area = (_area(box) + _area(other)) / 2
    between = 0.0
    for each in (box, other):
        between += each.half_length * abs(each.cos * dy - each.sin * dx) + each.half_width * abs(
            each.cos * dx + each.sin * dy
        )
    height = max(box.top - box.bottom, other.top - other.bottom)
    return volumes < (1 + least) * height * (between + area)


@compiled()
def _circles_meet(box: _UprightBox, other: _UprightBox) -> bool:
    """Return whether the circles through the boxes' corners meet; if not, the boxes do not meet."""
    dx, dy = box.x - other.x, box.y - other.y
    return dx * dx + dy * dy - (box.radius + other.radius) ** 2 < 0


@compiled()
def _area(box: _UprightBox) -> float:
    return 4 * box.half_length * box.half_width


@compiled()
def _corners(box: _UprightBox, other: _UprightBox) -> np.ndarray:
    """Return the corners of a box in the frame of the other, counter-clockwise.

    They are the first 4 rows of a polygon of (`MOST_CORNERS`, 2).
    """
    dx, dy = box.x - other.x, box.y - other.y
    x, y = other.cos * dx + other.sin * dy, other.cos * dy - other.sin * dx
    cos = other.cos * box.cos + other.sin * box.sin
    sin = other.cos * box.sin - other.sin * box.cos
    corners = np.empty((MOST_CORNERS, 2))
    for k in range(4):
        along = box.half_length if k in (0, 3) else -box.half_length
        across = box.half_width if k in (0, 1) else -box.half_width
        corners[k, 0] = x + cos * along - sin * across
        corners[k, 1] = y + sin * along + cos * across
    return corners


@compiled()
def _common_area(box: _UprightBox, other: _UprightBox) -> float:
    """Return the area from above that two boxes share."""
    polygon, count = _corners(box, other), 4
    cut = np.empty_like(polygon)
    for axis, limit in ((0, other.half_length), (1, other.half_width)):
        for side in (1.0, -1.0):
            count = _cut(polygon, count, axis, side, limit, cut)
            polygon, cut = cut, polygon
    return _polygon_area(polygon, count)


@compiled()
def _cut(
    polygon: np.ndarray, count: int, axis: int, side: float, limit: float, cut: np.ndarray
) -> int:
    """Write the part of a polygon where `side * coordinate <= limit` to `cut`.

    Returns its number of corners.
    """
    size = 0
    before = count - 1
    for k in range(count):
        inside_by = limit - side * polygon[k, axis]
        before_inside_by = limit - side * polygon[before, axis]
        if (inside_by >= 0) != (before_inside_by >= 0):
            share = before_inside_by / (before_inside_by - inside_by)
            for i in range(2):
                start = polygon[before, i]
                cut[size, i] = start + share * (polygon[k, i] - start)
            size += 1
        if inside_by >= 0:
            cut[size, 0], cut[size, 1] = polygon[k, 0], polygon[k, 1]
            size += 1
        before = k
    return size


@compiled()
def _polygon_area(polygon: np.ndarray, count: int) -> float:
    """Return the area of a polygon, whose corners are counter-clockwise (shoelace formula)."""
    twice = 0.0
    before = count - 1
    for k in range(count):
        twice += polygon[before, 0] * polygon[k, 1] - polygon[k, 0] * polygon[before, 1]
        before = k
    return max(twice / 2, 0.0)


@compiled()
def _hull_area(box: _UprightBox, other: _UprightBox) -> float:
    """Return the area of the convex hull of the corners of two boxes from above (Andrew 1979)."""
    corners = _corners(box, other)
    for k in range(4):
        corners[4 + k, 0] = other.half_length if k in (0, 3) else -other.half_length
        corners[4 + k, 1] = other.half_width if k in (0, 1) else -other.half_width
    # Sort the corners by x, then y.
    for k in range(1, 8):
        x, y, place = corners[k, 0], corners[k, 1], k
        while place > 0 and (corners[place - 1, 0], corners[place - 1, 1]) > (x, y):
            corners[place, 0], corners[place, 1] = corners[place - 1, 0], corners[place - 1, 1]
            place -= 1
        corners[place, 0], corners[place, 1] = x, y
    hull = np.empty((MOST_CORNERS, 2))
    count, lower_count = 0, 1
    # The lower side of the hull from left to right, then the upper side back to the first corner.
    for step in range(15):
        k = step if step < 8 else 14 - step
        x, y = corners[k, 0], corners[k, 1]
        while count > lower_count:
            ax, ay = hull[count - 2, 0], hull[count - 2, 1]
            bx, by = hull[count - 1, 0], hull[count - 1, 1]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            count -= 1
        hull[count, 0], hull[count, 1] = x, y
        count += 1
        if step == 7:
            lower_count = count
    return _polygon_area(hull, count - 1)
