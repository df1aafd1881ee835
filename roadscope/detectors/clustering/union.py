"""Disjoint sets: which of N things hang together through links."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled(borrowing=True)
def root_of(parents: np.ndarray, item: int) -> int:
    """Return the item that stands for the set of this one; shortens the way to it.

    parents: (N,) int64, an item of the same set for each item, itself for the one that stands for
    it; changed in place.
    """
    while parents[item] != item:
        parents[item] = parents[parents[item]]
        item = parents[item]
    return item


@compiled(borrowing=True)
def join(parents: np.ndarray, first: int, second: int) -> None:
    """Make one set of two items' sets; the lowest item stands for a set.

    parents: as in `root_of`, changed in place.
    """
    a, b = root_of(parents, first), root_of(parents, second)
    parents[max(a, b)] = min(a, b)


@compiled()
def components(size: int, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Label the connected components of `size` nodes, numbered by first appearance, (N,) int64.

    rows, columns: (P,) int64, the two ends of each link.
    """
    parents = np.arange(size)
    for pair in range(len(rows)):
        join(parents, rows[pair], columns[pair])
    labels, count = np.empty(size, np.int64), 0
    for item in range(size):
        root = root_of(parents, item)
        if root == item:
            labels[item] = count
            count += 1
        else:
            labels[item] = labels[root]
    return labels
