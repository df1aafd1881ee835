"""What is connected with what: rows and columns that no chain of pairs joins are solved apart."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled()
def components(
    rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, int]:
    """Return (N + M,) a number for each row and column, the same where pairs connect them.

    rows, columns: (P,) the pairs. Numbers count from 0, by first row; a row or column without a
    pair has -1. Also returns how many components there are.
    """
    n, m = shape
    parent = np.arange(n + m)
    paired = np.zeros(n + m, np.bool_)
    for k in range(len(rows)):
        paired[rows[k]] = paired[n + columns[k]] = True
        a, b = _root(parent, rows[k]), _root(parent, n + columns[k])
        parent[max(a, b)] = min(a, b)
    group = np.full(n + m, -1)
    count = 0
    # The root of a component is its first row, so it comes before all others.
    for k in range(n + m):
        if paired[k]:
            root = _root(parent, k)
            if root == k:
                group[k] = count
                count += 1
            group[k] = group[root]
    return group, count


@compiled()
def _root(parent: np.ndarray, k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@compiled()
def sorted_by(labels: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return an index that sorts (K,) labels, and (count + 1,) where in it each label starts.

    Labels are 0 to count - 1; what has -1 is left out.
    """
    starts = np.zeros(count + 1, np.int64)
    for label in labels:
        if label >= 0:
            starts[label + 1] += 1
    for c in range(count):
        starts[c + 1] += starts[c]
    order, at = np.empty(starts[count], np.int64), starts[:-1].copy()
    for k in range(len(labels)):
        if labels[k] >= 0:
            order[at[labels[k]]] = k
            at[labels[k]] += 1
    return order, starts
