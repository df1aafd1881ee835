"""The rest of a body of which a part was seen to move."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.moving.box_kernels import gathered
from roadscope.detectors.shape.bodies import LONGEST_M, WIDEST_M

LINK_M = 1.0
"""Parts of one body come this near to each other; cars in a queue keep farther apart."""
CAR_M = (5.6, 2.7)
"""A car with noise at either end."""
TALL_M = 1.75
"""What is longer is higher than a car."""


@compiled()
def bodies(
    points: np.ndarray, boxes: np.ndarray, origin: np.ndarray, sides: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which body each point belongs to, (N,), -1 for none, and each body's box, (K,).

    points: (N, 3) metres. boxes (B, 8), origin and sides: of `box_kernels`, best box first. What
    is mostly of a body that was found already is found once.
    """
    owner, found, count = np.full(len(points), -1), np.empty(len(boxes), np.int64), 0
    for b in range(len(boxes)):
        part = gathered(points, boxes[b], origin, sides)
        free = part[owner[part] < 0]
        if 2 * len(free) <= len(part):
            continue
        for row in whole_body(points, free):
            if owner[row] < 0:
                owner[row] = count
        found[count] = b
        count += 1
    return owner, found[:count]


@compiled()
def whole_body(points: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return the rows of the body that a part belongs to; the part's where that is no vehicle.

    points: (N, 3) metres, z from the ground. part: (K,) int64, rows of it. A slow vehicle still
    stands where its rear half was seen a second ago, and a lorry fills several boxes.
    """
    grown = linked(points, part, LINK_M, LONGEST_M)
    return grown if _fits(points[grown]) else part


@compiled()
def _fits(points: np.ndarray) -> bool:
    """Whether a vehicle along the longest way through (N, 3) points would hold them."""
    x, y = points[:, 0] - points[:, 0].mean(), points[:, 1] - points[:, 1].mean()
    axis = 0.5 * np.arctan2(2.0 * (x * y).sum(), (x * x).sum() - (y * y).sum())
    along, across = np.cos(axis) * x + np.sin(axis) * y, np.cos(axis) * y - np.sin(axis) * x
    length, width = along.max() - along.min(), across.max() - across.min()
    if points[:, 2].max() < TALL_M:
        return bool(length <= CAR_M[0] and width <= CAR_M[1])
    return bool(length <= LONGEST_M and width <= WIDEST_M)


@compiled()
def linked(points: np.ndarray, part: np.ndarray, link_m: float, reach_m: float) -> np.ndarray:
    """Return, rising, the rows (M,) int64 that hang together with a part.

    points: (N, 3) metres, any frame. part: (K,) int64, rows of it, K at least 1. Seen from above,
    each is within `link_m` of another one, and those beside the part are less than `reach_m` away
    in x and in y from its first row.
    """
    x, y = points[part[0], 0], points[part[0], 1]
    near = np.empty(len(points), np.int64)
    count = 0
    for row in range(len(points)):
        if abs(points[row, 0] - x) < reach_m and abs(points[row, 1] - y) < reach_m:
            near[count] = row
            count += 1
    near = near[:count]
    inside, queue = np.zeros(len(points), np.bool_), np.empty(len(points), np.int64)
    done, size = 0, len(part)
    queue[:size] = part
    for row in part:
        inside[row] = True
    while done < size:
        row = queue[done]
        done += 1
        for other in near:
            dx, dy = points[other, 0] - points[row, 0], points[other, 1] - points[row, 1]
            if not inside[other] and dx * dx + dy * dy <= link_m * link_m:
                inside[other] = True
                queue[size] = other
                size += 1
    return np.flatnonzero(inside)
