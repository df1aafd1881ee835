"""Marginal association probabilities: exact wherever that is affordable, else approximate.

A joint event gives each track one detection or none and each detection one track or none. Its
weight is the product over its pairs, its missed tracks and its free detections. Connected
components of possible pairs, clusters, are independent of each other.

The exact sum over all joint events of a cluster is computed row by row (rows are tracks, or
detections if that is less work). A column is open between two rows if both an earlier and a later
row may take it. The state is the set of open columns that are taken; each open column has a bit of
it. All events with the same state share one weight (Efficient Hypothesis Management 2, Horridge
and Maskell 2006), so the work doubles with each open column, not with each column.

The mean over joint events with the same tracks and the same detections, which differ in the pairs,
moves near tracks together until they coincide (coalescence). With JPDA* only the likeliest of such
events counts (Blom and Bloem 2000). This takes more work than the sum: up to 9 tracks and 9
detections, 8 and 10, or 2 and 18 are within the limit. In larger clusters all events count.

Beyond a limit of work marginals are approximated by loopy belief propagation (Williams and Lau
2014). In crowds of eight tracks and eight detections along a line the largest error of a marginal
is 0.05 on average and 0.3 at most.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers._assignment import components, sorted_by

EXACT_LIMIT = 2.0**21
"""Most multiplications for the exact marginals of a cluster. 12 tracks and 12 detections, all pairs
possible, take 0.6 million; about 500 million take one second."""
CONVERGED = 1e-9
"""Belief propagation ends when no message changes by a greater share of itself."""
MOST_ROUNDS = 2000
"""Most rounds of belief propagation. Both are chosen by hand."""


@compiled()
def association_marginals(
    rows: np.ndarray,
    columns: np.ndarray,
    weights: np.ndarray,
    missed: np.ndarray,
    free: np.ndarray,
    limit: float,
    pruned: bool,
) -> np.ndarray:
    """Return (P,) probabilities that track `rows` has detection `columns`.

    rows, columns, weights: (P,) the possible pairs and their weights.
    missed: (N,) weights of tracks without a detection. free: (M,) of detections without a track.
    limit: multiplications for a cluster, such as `EXACT_LIMIT`; inf is always exact, 0.0 never.
    pruned: whether of the joint events with the same tracks and the same detections, which differ
        in the pairs, only the likeliest counts. In a cluster where this takes more than the
        limit, all events count: with `EXACT_LIMIT` from 10 tracks and 9 detections on.
    At least one joint event must be possible.
    """
    n, m = len(missed), len(free)
    component, count = components(rows, columns, n, m)
    row_order, first_row = sorted_by(component[:n], count)
    column_order, first_column = sorted_by(component[n:], count)
    pair_order, first_pair = sorted_by(component[:n][rows], count)
    marginals, index = np.empty(len(rows)), np.empty(n + m, np.int64)
    for c in range(count):
        pairs = pair_order[first_pair[c] : first_pair[c + 1]]
        if len(pairs) == 1:
            k = pairs[0]
            marginals[k] = weights[k] / (weights[k] + missed[rows[k]] * free[columns[k]])
            continue
        own_rows = row_order[first_row[c] : first_row[c + 1]]
        own_columns = column_order[first_column[c] : first_column[c + 1]]
        for i in range(len(own_rows)):
            index[own_rows[i]] = i
        for j in range(len(own_columns)):
            index[n + own_columns[j]] = j
        matrix = np.zeros((len(own_rows), len(own_columns)))
        for k in pairs:
            matrix[index[rows[k]], index[n + columns[k]]] = weights[k]
        of_cluster = _cluster_marginals(matrix, missed[own_rows], free[own_columns], limit, pruned)
        for k in pairs:
            marginals[k] = of_cluster[index[rows[k]], index[n + columns[k]]]
    return marginals


@compiled()
def _cluster_marginals(
    pairs: np.ndarray, missed: np.ndarray, free: np.ndarray, limit: float, pruned: bool
) -> np.ndarray:
    """Return (N, M) marginals of one cluster, by the method of least work within the limit."""
    permuted = min(pairs.shape) > 1
    if pruned and permuted and _pruned_work(pairs.shape[0], pairs.shape[1]) <= limit:
        return _pruned_marginals(pairs, missed, free)
    transposed = np.ascontiguousarray(pairs.T)
    by_rows, by_columns = _plan(pairs), _plan(transposed)
    possible = (pairs > 0).sum()
    row_work, column_work = 2.0**by_rows.bits * possible, 2.0**by_columns.bits * possible
    if min(row_work, column_work) > limit:
        return loopy_marginals(pairs, missed, free)
    if row_work <= column_work:
        return _exact_marginals(pairs, missed, free, by_rows)
    marginals = _exact_marginals(transposed, free, missed, by_columns)
    return np.ascontiguousarray(marginals.T)


@compiled()
def _pruned_work(n: int, m: int) -> float:
    """Return how many steps `_pruned_marginals` takes if all pairs are possible.

    It checks each set of rows with each set of columns, 2^(n + m) of them. Two sets of equal size
    have events: binomial (n + m over n) of them do, and each takes n + 2 m steps.
    """
    events = 1.0
    for k in range(1, n + 1):
        events *= (m + k) / k
    return 2.0 ** (n + m) + events * (n + 2 * m)


@compiled()
def _pruned_marginals(pairs: np.ndarray, missed: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return (N, M) marginals over the likeliest event for each set of rows and set of columns.

    A set is an integer with one bit for each member. The likeliest event of a set of rows extends
    that of the set without its last row by a column for this row.
    """
    n, m = pairs.shape
    best = np.zeros((1 << n, 1 << m))
    last = np.zeros((1 << n, 1 << m), np.int8)
    best[0, 0] = 1.0
    marginals, total, row = np.zeros((n, m)), 0.0, -1
    for rows in range(1 << n):
        if rows == 1 << (row + 1):
            row += 1
        if rows > 0:
            before = best[rows ^ (1 << row)]
            for columns in range(1 << m):
                if before[columns] == 0:
                    continue
                for j in range(m):
                    bit = 1 << j
                    if not columns & bit:
                        weight = before[columns] * pairs[row, j]
                        if weight > best[rows, columns | bit]:
                            best[rows, columns | bit] = weight
                            last[rows, columns | bit] = j
        missed_weight = 1.0
        for i in range(n):
            missed_weight *= 1.0 if rows >> i & 1 else missed[i]
        for columns in range(1 << m):
            weight = best[rows, columns] * missed_weight
            if weight == 0:
                continue
            for j in range(m):
                weight *= 1.0 if columns >> j & 1 else free[j]
            total += weight
            remaining = columns
            for i in range(n - 1, -1, -1):
                if rows >> i & 1:
                    chosen = last[rows & ((1 << (i + 1)) - 1), remaining]
                    marginals[i, chosen] += weight
                    remaining ^= 1 << chosen
    return marginals / total


class EliminationPlan(NamedTuple):
    """The order of the rows of an (N, M) cluster, and the bits of its columns in the state.

    order: (N,) rows.
    bit: (M,) the bit of each column while it is open.
    last: (M,) the step of the last row that may take it.
    bits: the number of bits of the state.
    """

    order: np.ndarray
    bit: np.ndarray
    last: np.ndarray
    bits: int


@compiled()
def _plan(pairs: np.ndarray) -> EliminationPlan:
    """Return a plan with few open columns: each next row is the one that adds fewest of them."""
    n, m = pairs.shape
    order, done = np.empty(n, np.int64), np.zeros(n, np.bool_)
    bit, last = np.full(m, -1), np.full(m, -1)
    rows_left, bit_in_use = np.zeros(m, np.int64), np.zeros(m, np.bool_)
    for j in range(m):
        for i in range(n):
            rows_left[j] += 1 if pairs[i, j] > 0 else 0
    bits = 0
    for k in range(n):
        best, least = -1, 0
        for i in range(n):
            if done[i]:
                continue
            growth = 0
            for j in range(m):
                if pairs[i, j] > 0:
                    growth += 1 if bit[j] < 0 else 0
                    growth -= 1 if rows_left[j] == 1 else 0
            if best < 0 or growth < least:
                best, least = i, growth
        order[k], done[best] = best, True
        for j in range(m):
            if pairs[best, j] > 0:
                rows_left[j] -= 1
                last[j] = k
                if bit[j] < 0:
                    bit[j] = 0
                    while bit_in_use[bit[j]]:
                        bit[j] += 1
                    bit_in_use[bit[j]] = True
                    bits = max(bits, bit[j] + 1)
        for j in range(m):
            if last[j] == k and rows_left[j] == 0:
                bit_in_use[bit[j]] = False
    return EliminationPlan(order, bit, last, bits)


@compiled()
def _exact_marginals(
    pairs: np.ndarray, missed: np.ndarray, free: np.ndarray, plan: EliminationPlan
) -> np.ndarray:
    """Return (N, M) marginals by sums over all joint events, forwards and backwards in the rows.

    Arrays over states are handled in blocks of twice 2^bit: the first half of a block has the
    states in which the column of this bit is free, the second half the same ones with it taken.
    """
    (n, m), states = pairs.shape, 1 << plan.bits
    forward = np.empty((n + 1, states))
    forward[0] = 0.0
    forward[0, 0] = 1.0
    for k in range(n):
        row = plan.order[k]
        after = forward[k + 1]
        _add_row(forward[k], after, pairs[row], missed[row], plan.bit, True)
        for j in range(m):
            if plan.last[j] == k:
                # No later row may take column j: events with and without it have the same state.
                half = 1 << plan.bit[j]
                for block in range(0, states, 2 * half):
                    for state in range(block, block + half):
                        after[state] = free[j] * after[state] + after[state + half]
                        after[state + half] = 0.0
        # Only ratios within a step matter; without the division products of many rows overflow.
        after /= after.max()
    backward, before = np.zeros(states), np.empty(states)
    backward[0] = 1.0
    marginals = np.zeros(pairs.shape)
    for k in range(n - 1, -1, -1):
        row = plan.order[k]
        for j in range(m):
            if plan.last[j] == k:
                half = 1 << plan.bit[j]
                for block in range(0, states, 2 * half):
                    for state in range(block, block + half):
                        backward[state + half] = backward[state]
                        backward[state] *= free[j]
        total = missed[row] * (forward[k] * backward).sum()
        for j in range(m):
            if pairs[row, j] > 0:
                weight, half = 0.0, 1 << plan.bit[j]
                for block in range(0, states, 2 * half):
                    for state in range(block, block + half):
                        weight += forward[k, state] * backward[state + half]
                marginals[row, j] = pairs[row, j] * weight
                total += marginals[row, j]
        marginals[row] /= total
        _add_row(backward, before, pairs[row], missed[row], plan.bit, False)
        backward[:] = before / before.max()
    return marginals


@compiled()
def _add_row(
    weights: np.ndarray,
    after: np.ndarray,
    row: np.ndarray,
    missed: float,
    bit: np.ndarray,
    forwards: bool,
) -> None:
    """Write into `after` the weights (S,) of states after one more row took a free column or none.

    weights: (S,) of states before. row: (M,) weights of the row's pairs. missed: its weight without
    a column. bit: as in `EliminationPlan`. forwards: False to go back to the states before the row.
    """
    after[:] = missed * weights
    for j in range(len(row)):
        if row[j] > 0:
            half = 1 << bit[j]
            source, target = (0, half) if forwards else (half, 0)
            for block in range(0, len(weights), 2 * half):
                for state in range(block, block + half):
                    after[state + target] += row[j] * weights[state + source]


@compiled()
def loopy_marginals(pairs: np.ndarray, missed: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return (N, M) approximate probabilities that track i has detection j.

    pairs: (N, M) weights. missed, free: as in `association_marginals`, but positive.
    Exact where pairs form no loop. Messages always converge, as Williams and Lau prove.
    """
    n, m = pairs.shape
    psi = np.empty((n, m))
    for i in range(n):
        for j in range(m):
            psi[i, j] = pairs[i, j] / (missed[i] * free[j])
    mu, nu = np.zeros((n, m)), np.ones((n, m))
    for _ in range(MOST_ROUNDS):
        change = 0.0
        for i in range(n):
            others = _sums_of_others(psi[i] * nu[i])
            for j in range(m):
                mu[i, j] = psi[i, j] / (1 + others[j])
        for j in range(m):
            others = _sums_of_others(np.ascontiguousarray(mu[:, j]))
            for i in range(n):
                message = 1 / (1 + others[i])
                if psi[i, j] > 0:
                    change = max(change, abs(message / nu[i, j] - 1))
                nu[i, j] = message
        if change < CONVERGED:
            break
    marginals = psi * nu
    for i in range(n):
        marginals[i] /= 1 + marginals[i].sum()
    return marginals


@compiled()
def _sums_of_others(values: np.ndarray) -> np.ndarray:
    """Return for each of (N,) values the sum of all others.

    No value is subtracted from the total, because that would lose digits.
    """
    others = np.zeros(len(values))
    total = 0.0
    for k in range(len(values)):
        others[k] = total
        total += values[k]
    total = 0.0
    for k in range(len(values) - 1, -1, -1):
        others[k] += total
        total += values[k]
    return others
