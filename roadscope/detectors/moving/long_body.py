"""A lorry fills several boxes of a car's size: which boxes hold one body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

GAP_M = 1.0
"""Parts of one body come this near to each other; cars in a queue keep farther apart."""
LENGTH_M, WIDTH_M = 18.0, 3.0
"""The longest lorry, and the widest with mirrors and noise."""


def one_body(parts: Sequence[np.ndarray]) -> list[list[int]]:
    """Return groups of rows of `parts` that one body can explain, each in rising order.

    parts: the returns (N, 2 or more) that each box holds, best box first.
    """
    groups: list[list[int]] = []
    for row, part in enumerate(parts):
        for group in groups:
            held = np.concatenate([parts[k] for k in group])
            if _near(held, part) and _fits(np.concatenate([held, part])):
                group.append(row)
                break
        else:
            groups.append([row])
    return groups


def _near(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether the least distance between two parts, seen from above, is within `GAP_M`."""
    if not len(first) or not len(second):
        return False
    reach = first[:, :2].min(axis=0) - GAP_M, first[:, :2].max(axis=0) + GAP_M
    close = second[((second[:, :2] >= reach[0]) & (second[:, :2] <= reach[1])).all(axis=1), :2]
    if not len(close):
        return False
    apart = first[:, None, :2] - close
    return bool((np.hypot(apart[..., 0], apart[..., 1]) <= GAP_M).any())


def _fits(points: np.ndarray) -> bool:
    """Whether a body along the longest way through the points would hold them."""
    place = points[:, :2] - points[:, :2].mean(axis=0)
    axis = np.linalg.eigh(place.T @ place)[1][:, 1]
    along, across = place @ axis, place @ np.array([-axis[1], axis[0]])
    return bool(np.ptp(along) <= LENGTH_M and np.ptp(across) <= WIDTH_M)
