"""Assignment of detections to tracks for any costs: greedy or optimal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from roadscope.core.disjoint_sets import join
from roadscope.core.jit import compiled
from roadscope.trackers._gating import CandidatePairs

Pairs = tuple[np.ndarray, np.ndarray]
"""Rows and columns of the assigned pairs, (K,) int64 each; functions of this file sort by row."""


def unassigned(count: int, assigned: np.ndarray) -> np.ndarray:
    """Return the numbers from 0 to `count` - 1 that are not in an index array, rising."""
    free = np.ones(count, bool)
    free[assigned] = False
    return np.flatnonzero(free)


def assign_greedily(costs: np.ndarray, gate: float) -> Pairs:
    """Return pairs of rows and columns, chosen one after the other, the cheapest first.

    costs: (N, M). gate: pairs that cost this much or more are impossible. Of pairs of equal cost
    that of the earlier row, then of the earlier column is chosen.
    """
    rows, columns = np.nonzero(costs < gate)
    order = np.argsort(costs[rows, columns], kind="stable")
    return _first_of_each(rows[order], columns[order], len(costs))


def assign_in_turn(candidates: CandidatePairs, turns: np.ndarray) -> Pairs:
    """Return pairs in which the rows, one after the other, take their cheapest free column.

    turns: (N,) rows in this order. Of equal costs the earlier column is chosen.
    """
    turn_of_row = np.argsort(turns)
    order = np.lexsort([candidates.costs, turn_of_row[candidates.rows]])
    return _first_of_each(candidates.rows[order], candidates.columns[order], len(turns))


def _first_of_each(rows: np.ndarray, columns: np.ndarray, count: int) -> Pairs:
    """Return those of sorted pairs whose row and column are in no earlier chosen pair.

    count: number of rows.
    """
    column_of_row = np.full(count, -1)
    taken: set[int] = set()
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if column_of_row[row] < 0 and column not in taken:
            column_of_row[row] = column
            taken.add(column)
    return _pairs(column_of_row)


def _pairs(column_of_row: np.ndarray) -> Pairs:
    """Return the pairs of (N,) columns, -1 for none."""
    rows = np.flatnonzero(column_of_row >= 0)
    return rows, column_of_row[rows]


def assign_optimally(candidates: CandidatePairs, gate: float) -> Pairs:
    """Return the pairs with the least total cost, where an unassigned row costs the gate.

    Pairs that cost as much as the gate or more are impossible.
    """
    near = candidates.where(candidates.costs < gate)
    rows, columns = np.ascontiguousarray(near.rows), np.ascontiguousarray(near.columns)
    return _pairs(_optimal_columns(rows, columns, near.costs - gate, *near.shape))


class AssignmentStage(NamedTuple):
    """One stage of an assignment in several stages.

    rows, columns: (N,) and (M,) bool, which take part in it.
    gate: as in `assign_optimally`.
    """

    rows: np.ndarray
    columns: np.ndarray
    gate: float


def assign_in_stages(candidates: CandidatePairs, stages: Iterable[AssignmentStage]) -> Pairs:
    """Return optimal pairs of several stages, each among what those before have left."""
    free_rows, free_columns = (np.ones(n, bool) for n in candidates.shape)
    column_of_row = np.full(candidates.shape[0], -1)
    for stage in stages:
        takes_part = (stage.rows & free_rows)[candidates.rows]
        takes_part &= (stage.columns & free_columns)[candidates.columns]
        rows, columns = assign_optimally(candidates.where(takes_part), stage.gate)
        column_of_row[rows] = columns
        free_rows[rows], free_columns[columns] = False, False
    return _pairs(column_of_row)


@compiled()
def _optimal_columns(
    rows: np.ndarray, columns: np.ndarray, costs: np.ndarray, n: int, m: int
) -> np.ndarray:
    """Return for each of n rows its column, or -1, for the least total cost.

    costs: (P,) of pairs, minus that of an unassigned row: all are negative. Connected components
        of pairs are solved one by one.
    """
    component, count = components(rows, columns, n, m)
    row_order, first_row = sorted_by(component[:n], count)
    column_order, first_column = sorted_by(component[n:], count)
    pair_order, first_pair = sorted_by(component[:n][rows], count)
    index = np.empty(n + m, np.int64)
    column_of_row = np.full(n, -1)
    for c in range(count):
        pairs = pair_order[first_pair[c] : first_pair[c + 1]]
        if len(pairs) == 1:
            column_of_row[rows[pairs[0]]] = columns[pairs[0]]
            continue
        own_rows = row_order[first_row[c] : first_row[c + 1]]
        own_columns = column_order[first_column[c] : first_column[c + 1]]
        for i in range(len(own_rows)):
            index[own_rows[i]] = i
        for j in range(len(own_columns)):
            index[n + own_columns[j]] = j
        matrix = np.zeros((len(own_rows), len(own_columns)))
        for k in pairs:
            matrix[index[rows[k]], index[n + columns[k]]] = costs[k]
        # `least_total` needs at least as many columns as rows.
        transposed = len(own_rows) > len(own_columns)
        if transposed:
            matrix = np.ascontiguousarray(matrix.T)
        chosen = least_total(matrix)
        for k in range(len(chosen)):
            if matrix[k, chosen[k]] < 0:
                i, j = (chosen[k], k) if transposed else (k, chosen[k])
                column_of_row[own_rows[i]] = own_columns[j]
    return column_of_row


@compiled()
def least_total(costs: np.ndarray) -> np.ndarray:
    """Return for each row of (N, M) costs, N at most M, its column in the cheapest assignment.

    Rows are added one by one along the shortest augmenting path (Jonker and Volgenant 1987). Prices
    are the dual variables.
    """
    n, m = costs.shape
    row_price, column_price = np.zeros(n), np.zeros(m)
    row_of_column, previous_row = np.full(m, -1), np.empty(m, np.int64)
    column_of_row = np.full(n, -1)
    for new in range(n):
        least_path_cost = np.full(m, np.inf)
        visited = np.zeros(m, np.bool_)
        row, end, reached = new, -1, 0.0
        while end < 0:
            nearest = -1
            for j in range(m):
                if visited[j]:
                    continue
                path_cost = reached + costs[row, j] - row_price[row] - column_price[j]
                if path_cost < least_path_cost[j]:
                    least_path_cost[j], previous_row[j] = path_cost, row
                if nearest < 0 or least_path_cost[j] < least_path_cost[nearest]:
                    nearest = j
            reached = least_path_cost[nearest]
            visited[nearest] = True
            if row_of_column[nearest] < 0:
                end = nearest
            else:
                row = row_of_column[nearest]
        row_price[new] += reached
        for j in range(m):
            if visited[j] and j != end:
                row_price[row_of_column[j]] += reached - least_path_cost[j]
                column_price[j] -= reached - least_path_cost[j]
        row = -1
        while row != new:
            row = previous_row[end]
            row_of_column[end] = row
            end, column_of_row[row] = column_of_row[row], end
    return column_of_row


@compiled()
def components(rows: np.ndarray, columns: np.ndarray, n: int, m: int) -> tuple[np.ndarray, int]:
    """Return (n + m,) the connected component of each row and column, and how many there are.

    rows, columns: (P,) the pairs. Components count from 0 by first row; a row or column without
    a pair has -1.
    """
    parents = np.arange(n + m)
    paired = np.zeros(n + m, np.bool_)
    for k in range(len(rows)):
        a, b = rows[k], n + columns[k]
        paired[a] = paired[b] = True
        join(parents, a, b)
    component = np.full(n + m, -1)
    count = 0
    # A parent always comes before its children, and the first row of a component before all.
    for k in range(n + m):
        if not paired[k]:
            continue
        if parents[k] == k:
            component[k] = count
            count += 1
        else:
            component[k] = component[parents[k]]
    return component, count


@compiled()
def sorted_by(labels: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return an index that sorts (K,) labels, and (count + 1,) where in it each label starts.

    Labels are 0 to count - 1; rows with the label -1 are left out.
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
