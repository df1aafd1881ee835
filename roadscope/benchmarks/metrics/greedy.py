"""Greedy matching, detection by detection, compiled."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

HIT, FALSE_ALARM, IGNORED = 1, 0, -1


@compiled()
def outcomes(
    costs: np.ndarray, order: np.ndarray, eligible: np.ndarray, counted: np.ndarray
) -> np.ndarray:
    """Return (N,) the fate of each detection, taken in order; costs are written over.

    Each takes the cheapest eligible object that is still free; without one, the cheapest of the
    others excuses it, and so does lying outside the range band.
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
                fates[row] = HIT if group else IGNORED
                break
        if fates[row] == FALSE_ALARM and not counted[row]:
            fates[row] = IGNORED
    return fates
