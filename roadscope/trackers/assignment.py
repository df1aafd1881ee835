"""Which detection belongs to which track, by any cost: greedy or optimal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.components import components, sorted_by
from roadscope.trackers.gating import Candidates

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


def assign_in_turn(candidates: Candidates, turns: np.ndarray) -> Pairs:
    """Let the rows take their cheapest free column, one after another.

    turns: (N,) rows in the order of their turns. Equal costs go to the earlier column.
    """
    starts = np.searchsorted(candidates.rows, np.arange(len(turns) + 1))
    free = np.ones(candidates.shape[1], bool)
    return _in_turn(candidates.columns, candidates.costs, starts, turns, free)


@compiled()
def _in_turn(
    columns: np.ndarray, costs: np.ndarray, starts: np.ndarray, turns: np.ndarray, free: np.ndarray
) -> Pairs:
    """Do so; starts: (N + 1,) where each row's pairs start; free: overwritten."""
    partner = np.full(len(turns), -1)
    for row in turns:
        least = np.inf
        for k in range(starts[row], starts[row + 1]):
            if free[columns[k]] and costs[k] < least:
                partner[row], least = columns[k], costs[k]
        if partner[row] >= 0:
            free[partner[row]] = False
    rows = np.flatnonzero(partner >= 0)
    return rows, partner[rows]


def assign_optimally(candidates: Candidates, gate: float) -> Pairs:
    """Pair rows and columns for the least total, where being alone costs the gate.

    Costs must lie below the gate, so a pair is worth what it saves. Rows and columns that no
    pair within the gate connects are solved apart.
    """
    near = candidates.where(candidates.costs < gate)
    return _optimally(near.rows, near.columns, near.costs - gate, near.shape)


@compiled()
def _optimally(
    rows: np.ndarray, columns: np.ndarray, gains: np.ndarray, shape: tuple[int, int]
) -> Pairs:
    """Pair for the least sum of gains, which are negative."""
    n, m = shape
    group, count = components(rows, columns, shape)
    some, first_row = sorted_by(group[:n], count)
    others, first_column = sorted_by(group[n:], count)
    pairs, first_pair = sorted_by(group[:n][rows], count)
    place = np.empty(n + m, np.int64)
    partner = np.full(n, -1)
    for c in range(count):
        within = pairs[first_pair[c] : first_pair[c + 1]]
        if len(within) == 1:
            partner[rows[within[0]]] = columns[within[0]]
            continue
        mine = some[first_row[c] : first_row[c + 1]]
        theirs = others[first_column[c] : first_column[c + 1]]
        place[mine], place[n + theirs] = np.arange(len(mine)), np.arange(len(theirs))
        saved = np.zeros((len(mine), len(theirs)))
        for k in within:
            saved[place[rows[k]], place[n + columns[k]]] = gains[k]
        chosen = _solved(saved)
        for i in range(len(mine)):
            if chosen[i] >= 0:
                partner[mine[i]] = theirs[chosen[i]]
    found = np.flatnonzero(partner >= 0)
    return found, partner[found]


def assign_in_stages(
    candidates: Candidates, stages: Iterable[tuple[np.ndarray, np.ndarray, float]]
) -> Pairs:
    """Pair optimally in stages, each among what the ones before have left.

    stages: of each the rows that take part, (N,) bool, the columns, (M,) bool, and the gate.
    """
    free_rows, free_columns = (np.ones(n, bool) for n in candidates.shape)
    partner = np.full(candidates.shape[0], -1)
    for some, others, gate in stages:
        taking_part = (some & free_rows)[candidates.rows]
        taking_part &= (others & free_columns)[candidates.columns]
        rows, columns = assign_optimally(candidates.where(taking_part), gate)
        partner[rows] = columns
        free_rows[rows], free_columns[columns] = False, False
    rows = np.flatnonzero(partner >= 0)
    return rows, partner[rows]


@compiled()
def _solved(saved: np.ndarray) -> np.ndarray:
    """Return for each row of (N, M) gains, 0 where there is none, its column, or -1."""
    n, m = saved.shape
    partner = np.full(n, -1)
    if n > m:
        for column, row in enumerate(least_total(saved.T.copy())):
            if saved[row, column] < 0:
                partner[row] = column
        return partner
    for row, column in enumerate(least_total(saved)):
        if saved[row, column] < 0:
            partner[row] = column
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
