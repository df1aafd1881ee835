"""Sorting inside compiled kernels."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

SHORT = 16
"""Runs of this length are sorted by insertion; chosen by hand."""


@compiled()
def stable_order(values: np.ndarray) -> np.ndarray:
    """Return the order, (N,) int64, that sorts (N,) numbers and keeps equal ones in their order.

    The result is that of `np.argsort(values, kind="stable")`, which Numba compiles for seconds.
    This is a merge sort from short runs to long ones.
    """
    size = len(values)
    order, merged = np.empty(size, np.int64), np.empty(size, np.int64)
    for row in range(size):
        place = row
        while place % SHORT > 0 and values[order[place - 1]] > values[row]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = row
    width = SHORT
    while width < size:
        for start in range(0, size, 2 * width):
            middle, end = min(start + width, size), min(start + 2 * width, size)
            left, right = start, middle
            for place in range(start, end):
                from_right = left == middle
                if not from_right and right < end:
                    from_right = values[order[right]] < values[order[left]]
                if from_right:
                    merged[place] = order[right]
                    right += 1
                else:
                    merged[place] = order[left]
                    left += 1
        order, merged = merged, order
        width *= 2
    return order
