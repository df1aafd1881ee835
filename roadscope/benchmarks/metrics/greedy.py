"""Greedy matching, detection by detection, compiled."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

FALSE_ALARM, IGNORED = -1, -2
"""Fates of detections that take no eligible object."""


@compiled()
def outcomes(
    costs: np.ndarray, order: np.ndarray, eligible: np.ndarray, counted: np.ndarray
) -> np.ndarray:
    """Return (N,) the object that each detection takes or its fate; costs are written over.

    Objects are columns of costs. In order, each takes the cheapest eligible
    object that is still free; without one, the cheapest of the others excuses it, and so does
    lying outside the range band.
    """
    fates = np.full(len(order), FALSE_ALARM)
    for row in order:
        for group in (True, False):
            best, cost = -1, np.inf
            for column in range(len(eligible)):
                if eligible[column] == group and costs[row, column] < cost:
                    best, cost = column, costs[row, column]
            if best >= 0:
                costs[:, best] = np.inf
                fates[row] = best if group else IGNORED
                break
        if fates[row] == FALSE_ALARM and not counted[row]:
            fates[row] = IGNORED
    return fates
