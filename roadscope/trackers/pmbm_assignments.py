"""The best assignments of tracks and detections, not one but many: Murty 1968."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.assignment import least_total


@compiled()
def best_assignments(costs: np.ndarray, count: int, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the `count` cheapest assignments of (N, M) costs, of those near the least.

    gap: by how much they may exceed it. Being alone costs 0, for rows and columns alike; pairs may
    cost less or more, inf where impossible.
    Returns (K, N) int64 columns, -1 where a row is alone, and (K,) totals, rising.
    """
    n, m = costs.shape
    if n == 1:
        return _best_of_one(costs[0], count, gap)
    wide, dear = _with_own_columns(costs)
    chosen = np.empty((1 + count * n, n), np.int64)
    barred = np.zeros((1 + count * n, m + n), np.bool_)
    fixed = np.zeros(1 + count * n, np.int64)
    totals = np.full(1 + count * n, np.inf)
    totals[0] = _complete(wide, dear, chosen[0], 0, barred[0])
    size, worst = 1, totals[0] + gap
    found, prices = np.empty((count, n), np.int64), np.empty(count)
    k = 0
    while k < count:
        best = np.argmin(totals[:size])
        if not totals[best] <= worst or totals[best] == np.inf:
            break
        found[k], prices[k] = chosen[best], totals[best]
        k += 1
        # All others of this node differ first at one of its rows: a node for each.
        for row in range(fixed[best], n):
            chosen[size] = chosen[best]
            barred[size] = barred[best] & (row == fixed[best])
            barred[size, chosen[best, row]] = True
            fixed[size] = row
            totals[size] = _complete(wide, dear, chosen[size], row, barred[size])
            if totals[size] <= worst:
                size += 1
            else:
                totals[size] = np.inf
        totals[best] = np.inf
    return np.where(found[:k] < m, found[:k], -1), prices[:k]


@compiled()
def _best_of_one(costs: np.ndarray, count: int, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Do so for one row of (M,) costs."""
    totals = np.append(costs, 0.0)
    order = np.argsort(totals, kind="mergesort")[:count]
    size = 0
    while size < len(order) and totals[order[size]] <= totals[order[0]] + gap:
        if totals[order[size]] == np.inf:
            break
        size += 1
    found = order[:size].reshape(-1, 1)
    return np.where(found < len(costs), found, -1), totals[order[:size]]


@compiled()
def _with_own_columns(costs: np.ndarray) -> tuple[np.ndarray, float]:
    """Give each row a column of its own, where it is alone, and each impossible pair a price.

    Returns (N, M + N) costs and that price, more than any possible assignments differ by.
    """
    n, m = costs.shape
    dear = 1.0
    for i in range(n):
        for j in range(m):
            if costs[i, j] < np.inf:
                dear += abs(costs[i, j])
    wide = np.full((n, m + n), dear)
    for i in range(n):
        wide[i, m + i] = 0.0
        for j in range(m):
            if costs[i, j] < np.inf:
                wide[i, j] = costs[i, j]
    return wide, dear


@compiled()
def _complete(
    wide: np.ndarray, dear: float, chosen: np.ndarray, fixed: int, barred: np.ndarray
) -> float:
    """Choose columns for the rows from `fixed` on, the first of them none that is barred.

    Returns the total, inf where there is no way.
    """
    n, m = wide.shape
    left = wide[fixed:].copy()
    total = 0.0
    for i in range(fixed):
        left[:, chosen[i]] = dear
        total += wide[i, chosen[i]]
    for j in range(m):
        if barred[j]:
            left[0, j] = dear
    rest = least_total(left)
    for i in range(n - fixed):
        if left[i, rest[i]] >= dear:
            return np.inf
        chosen[fixed + i] = rest[i]
        total += left[i, rest[i]]
    return total
