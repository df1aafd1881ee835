"""Which detection belongs to which track, by any cost: greedy or optimal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from roadscope.core.jit import compiled

Pairs = tuple[np.ndarray, np.ndarray]
"""Rows and columns of the pairs, (K,) int64 each, rows increasing."""


def left_over(count: int, taken: np.ndarray) -> np.ndarray:
    """Return which of `count` rows or columns an index array does not name."""
    free = np.ones(count, bool)
    free[taken] = False
    return np.flatnonzero(free)


@compiled()
def assign_greedily(costs: np.ndarray, gate: float) -> Pairs:
    """Pair rows and columns of (N, M) costs, the cheapest pair of all first.

    Costs must lie below the gate. Equal costs go to the earlier row, then the earlier column.
    """
    n, m = costs.shape
    flat = costs.ravel()
    within = np.flatnonzero(flat < gate)
    partner = np.full(n, -1)
    taken = np.zeros(m, np.bool_)
    for k in within[np.argsort(flat[within], kind="mergesort")]:
        row, column = k // m, k % m
        if partner[row] < 0 and not taken[column]:
            partner[row], taken[column] = column, True
    rows = np.flatnonzero(partner >= 0)
    return rows, partner[rows]


@compiled()
def assign_in_turn(costs: np.ndarray, gate: float) -> Pairs:
    """Let the rows of (N, M) costs take their cheapest free column, one after another.

    Costs must lie below the gate. Equal costs go to the earlier column.
    """
    n, m = costs.shape
    partner = np.full(n, -1)
    taken = np.zeros(m, np.bool_)
    for row in range(n):
        least = gate
        for column in range(m):
            if not taken[column] and costs[row, column] < least:
                partner[row], least = column, costs[row, column]
        if partner[row] >= 0:
            taken[partner[row]] = True
    rows = np.flatnonzero(partner >= 0)
    return rows, partner[rows]


@compiled()
def assign_optimally(costs: np.ndarray, gate: float) -> Pairs:
    """Pair rows and columns of (N, M) costs for the least total, where being alone costs the gate.

    Costs must lie below the gate, so a pair is worth what it saves. Rows and columns that no
    pair within the gate connects are solved apart.
    """
    rows, columns = np.arange(costs.shape[0]), np.arange(costs.shape[1])
    return _assign_among(costs, rows, columns, gate)


@compiled()
def _assign_among(costs: np.ndarray, rows: np.ndarray, columns: np.ndarray, gate: float) -> Pairs:
    """Do so for some rows and columns only; return which of these are pairs."""
    n = len(rows)
    group = _groups_among(costs, rows, columns, gate)
    partner = np.full(n, -1)
    by_row = np.argsort(group[:n], kind="mergesort")
    by_column = np.argsort(group[n:], kind="mergesort")
    i = j = 0
    while i < n:
        this = group[by_row[i]]
        last = i
        while last < n and group[by_row[last]] == this:
            last += 1
        some, i = by_row[i:last], last
        if this < 0:
            continue
        while group[n + by_column[j]] < this:
            j += 1
        last = j
        while last < len(columns) and group[n + by_column[last]] == this:
            last += 1
        others, j = by_column[j:last], last
        chosen = _solved(costs, rows[some], columns[others], gate)
        for k in range(len(some)):
            if chosen[k] >= 0:
                partner[some[k]] = others[chosen[k]]
    found = np.flatnonzero(partner >= 0)
    return found, partner[found]


def assign_in_stages(
    costs: np.ndarray, stages: Iterable[tuple[np.ndarray, np.ndarray, float]]
) -> Pairs:
    """Pair optimally in stages, each among what the ones before have left.

    stages: of each the rows that take part, (N,) bool, the columns, (M,) bool, and the gate.
    """
    free_rows, free_columns = (np.ones(n, bool) for n in costs.shape)
    partner = np.full(len(costs), -1)
    for some, others, gate in stages:
        rows, columns = np.flatnonzero(some & free_rows), np.flatnonzero(others & free_columns)
        if not (len(rows) and len(columns)):
            continue
        i, j = _assign_among(costs, rows, columns, gate)
        partner[rows[i]] = columns[j]
        free_rows[rows[i]], free_columns[columns[j]] = False, False
    rows = np.flatnonzero(partner >= 0)
    return rows, partner[rows]


@compiled()
def _groups(costs: np.ndarray, gate: float) -> np.ndarray:
    """Return (N + M,) a number for each row and column, the same where pairs connect them.

    A row or column without a pair has -1.
    """
    return _groups_among(costs, np.arange(costs.shape[0]), np.arange(costs.shape[1]), gate)


@compiled()
def _groups_among(
    costs: np.ndarray, rows: np.ndarray, columns: np.ndarray, gate: float
) -> np.ndarray:
    n, m = len(rows), len(columns)
    parent = np.arange(n + m)
    paired = np.zeros(n + m, np.bool_)
    for i in range(n):
        for j in range(m):
            if costs[rows[i], columns[j]] < gate:
                paired[i] = paired[n + j] = True
                a, b = _root(parent, i), _root(parent, n + j)
                parent[max(a, b)] = min(a, b)
    group = np.full(n + m, -1)
    for k in range(n + m):
        if paired[k]:
            group[k] = _root(parent, k)
    return group


@compiled()
def _root(parent: np.ndarray, k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@compiled()
def _solved(costs: np.ndarray, rows: np.ndarray, columns: np.ndarray, gate: float) -> np.ndarray:
    """Return for each of the rows which of the columns is its, or -1."""
    tall = len(rows) > len(columns)
    saved = np.empty((len(columns), len(rows))) if tall else np.empty((len(rows), len(columns)))
    for i in range(len(rows)):
        for j in range(len(columns)):
            value = min(costs[rows[i], columns[j]] - gate, 0.0)
            if tall:
                saved[j, i] = value
            else:
                saved[i, j] = value
    chosen = least_total(saved)
    partner = np.full(len(rows), -1)
    for k in range(len(chosen)):
        if saved[k, chosen[k]] < 0:
            if tall:
                partner[chosen[k]] = k
            else:
                partner[k] = chosen[k]
    return partner


@compiled()
def least_total(costs: np.ndarray) -> np.ndarray:
    """Return for each row of (N, M) costs, N at most M, its column in the cheapest assignment.

    Rows join one by one along the shortest augmenting path (Jonker and Volgenant 1987).
    """
    n, m = costs.shape
    row_price, column_price = np.zeros(n), np.zeros(m)
    owner, previous = np.full(m, -1), np.empty(m, np.int64)
    for new in range(n):
        length = np.full(m, np.inf)
        seen = np.zeros(m, np.bool_)
        row, sink, reached = new, -1, 0.0
        while sink < 0:
            nearest = -1
            for j in range(m):
                if seen[j]:
                    continue
                detour = reached + costs[row, j] - row_price[row] - column_price[j]
                if detour < length[j]:
                    length[j], previous[j] = detour, row
                if nearest < 0 or length[j] < length[nearest]:
                    nearest = j
            reached = length[nearest]
            seen[nearest] = True
            if owner[nearest] < 0:
                sink = nearest
            else:
                row = owner[nearest]
        row_price[new] += reached
        for j in range(m):
            if seen[j] and j != sink:
                row_price[owner[j]] += reached - length[j]
                column_price[j] -= reached - length[j]
        while True:
            row = previous[sink]
            owner[sink] = row
            sink = _column_of(owner, row, sink)
            if row == new:
                break
    chosen = np.empty(n, np.int64)
    for j in range(m):
        if owner[j] >= 0:
            chosen[owner[j]] = j
    return chosen


@compiled()
def _column_of(owner: np.ndarray, row: int, but: int) -> int:
    """Return the column that a row owned before it took another."""
    for j in range(len(owner)):
        if owner[j] == row and j != but:
            return j
    return -1
