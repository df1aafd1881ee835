"""Disjoint sets: which of N items are connected through links."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled(borrowing=True)
def root_of(parents: np.ndarray, item: int) -> int:
    """Return the root of an item's set, and shorten the path to it.

    parents: (N,) int64, for each item another item of its set; the root is its own parent. It is
    changed in place.
    """
    while parents[item] != item:
        parents[item] = parents[parents[item]]
        item = parents[item]
    return item


@compiled(borrowing=True)
def join(parents: np.ndarray, first: int, second: int) -> None:
    """Make one set of two items' sets; the lowest item of a set is its root.

    parents: as in `root_of`, changed in place.
    """
    a, b = root_of(parents, first), root_of(parents, second)
    parents[max(a, b)] = min(a, b)
