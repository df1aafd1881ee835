"""The rest of a body of which a part was seen to move."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.shape.bodies import LONGEST_M, WIDEST_M

LINK_M = 1.0
"""Parts of one body come this near to each other; cars in a queue keep farther apart."""
CAR_M = (5.6, 2.7)
"""A car with noise at either end."""
TALL_M = 1.75
"""What is longer is higher than a car."""


def whole_body(points: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return the rows of the body that a part belongs to; the part's where that is no vehicle.

    points: (N, 3) metres, z from the ground. part: (K,) int64, rows of it. A slow vehicle still
    stands where its rear half was seen a second ago, and a lorry fills several boxes.
    """
    grown = linked(points, part, LINK_M, LONGEST_M)
    return grown if _fits(points[grown]) else part


def _fits(points: np.ndarray) -> bool:
    """Whether a vehicle along the longest way through (N, 3) points would hold them."""
    place = points[:, :2] - points[:, :2].mean(axis=0)
    axis = np.linalg.eigh(place.T @ place)[1][:, 1]
    along, across = np.ptp(place @ axis), np.ptp(place @ np.array([-axis[1], axis[0]]))
    sides = CAR_M if points[:, 2].max() < TALL_M else (LONGEST_M, WIDEST_M)
    return bool(along <= sides[0] and across <= sides[1])


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
