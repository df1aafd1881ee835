"""Marginal association probabilities, exact wherever that is affordable.

A joint event gives each track one detection or none and each detection one track or none. Its
weight is the product over its pairs, its missed tracks and its free detections. Rows and columns
that no chain of possible pairs connects are solved apart.

Within such a cluster one side is gone through item by item; of the other side only those items
are remembered, as taken or free, that earlier and later items compete for. All events that agree
on these share one number (Efficient Hypothesis Management 2, Horridge and Maskell 2006). So the
work doubles with each item in dispute at once, not with each in the cluster. Where it exceeds a
limit, loopy belief propagation answers instead.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.components import components, sorted_by
from roadscope.trackers.jpda_loopy import loopy_marginals

EXACT_LIMIT = 2.0**21
"""Multiplications a cluster may take before belief propagation: 12 tracks and 12 detections, all
possible, take 0.6 million, one second has about 500 million."""


@compiled()
def association_marginals(
    rows: np.ndarray,
    columns: np.ndarray,
    weights: np.ndarray,
    alone: tuple[np.ndarray, np.ndarray],
    limit: float,
) -> np.ndarray:
    """Return (P,) probabilities that track `rows` has detection `columns`.

    rows, columns: (P,) the pairs that are possible; weights: (P,) theirs.
    alone: (N,) weights of tracks without a detection, (M,) of detections without a track.
    limit: such as `EXACT_LIMIT`; inf is always exact, 0.0 always loopy.
    At least one joint event must be possible.
    """
    missed, free = alone
    n, m = len(missed), len(free)
    group, count = components(rows, columns, (n, m))
    some, first_row = sorted_by(group[:n], count)
    others, first_column = sorted_by(group[n:], count)
    pairs, first_pair = sorted_by(group[:n][rows], count)
    found, place = np.empty(len(rows)), np.empty(n + m, np.int64)
    for c in range(count):
        within = pairs[first_pair[c] : first_pair[c + 1]]
        if len(within) == 1:
            k = within[0]
            found[k] = weights[k] / (weights[k] + missed[rows[k]] * free[columns[k]])
            continue
        mine = some[first_row[c] : first_row[c + 1]]
        theirs = others[first_column[c] : first_column[c + 1]]
        place[mine], place[n + theirs] = np.arange(len(mine)), np.arange(len(theirs))
        inside = np.zeros((len(mine), len(theirs)))
        for k in within:
            inside[place[rows[k]], place[n + columns[k]]] = weights[k]
        shares = _cluster(inside, missed[mine], free[theirs], limit)
        for k in within:
            found[k] = shares[place[rows[k]], place[n + columns[k]]]
    return found


@compiled()
def _cluster(pairs: np.ndarray, missed: np.ndarray, free: np.ndarray, limit: float) -> np.ndarray:
    """Go through rows or columns, whichever is less work."""
    across = np.ascontiguousarray(pairs.T)
    down_order, across_order = _order(pairs), _order(across)
    down, sideways = _work(pairs, down_order), _work(across, across_order)
    if min(down, sideways) > limit:
        return loopy_marginals(pairs, missed, free)
    if down <= sideways:
        return _exact(pairs, missed, free, down_order)
    return np.ascontiguousarray(_exact(across, free, missed, across_order).T)


@compiled()
def _order(pairs: np.ndarray) -> np.ndarray:
    """Return an order of the rows that keeps few columns in dispute: fewest new ones next."""
    n, m = pairs.shape
    order, done = np.empty(n, np.int64), np.zeros(n, np.bool_)
    waiting, known = np.zeros(m, np.int64), np.zeros(m, np.bool_)
    for j in range(m):
        waiting[j] = (pairs[:, j] > 0).sum()
    for k in range(n):
        best, least = -1, 0
        for i in range(n):
            if done[i]:
                continue
            grown = 0
            for j in range(m):
                if pairs[i, j] > 0:
                    grown += 0 if known[j] else 1
                    grown -= 1 if waiting[j] == 1 else 0
            if best < 0 or grown < least:
                best, least = i, grown
        order[k], done[best] = best, True
        for j in range(m):
            if pairs[best, j] > 0:
                known[j] = True
                waiting[j] -= 1
    return order


@compiled()
def _slots(pairs: np.ndarray, order: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Give each column a bit for as long as it is in dispute.

    Returns (M,) the bit, (M,) the last step of each column, and how many bits there are.
    """
    m = pairs.shape[1]
    first, last, slot = np.full(m, -1), np.full(m, -1), np.full(m, -1)
    for k in range(len(order)):
        for j in range(m):
            if pairs[order[k], j] > 0:
                last[j] = k
                if first[j] < 0:
                    first[j] = k
    busy = np.zeros(m, np.bool_)
    width = 0
    for k in range(len(order)):
        for j in range(m):
            if first[j] == k:
                bit = 0
                while busy[bit]:
                    bit += 1
                slot[j], busy[bit] = bit, True
                width = max(width, bit + 1)
        for j in range(m):
            if last[j] == k:
                busy[slot[j]] = False
    return slot, last, width


@compiled()
def _work(pairs: np.ndarray, order: np.ndarray) -> float:
    """Return how many multiplications `_exact` takes one way."""
    _, _, width = _slots(pairs, order)
    return float(2.0**width * (pairs > 0).sum())


@compiled()
def _exact(
    pairs: np.ndarray, missed: np.ndarray, free: np.ndarray, order: np.ndarray
) -> np.ndarray:
    """Sum over all joint events, forwards and backwards through the rows."""
    slot, last, width = _slots(pairs, order)
    steps, states = len(order), 1 << width
    forward = np.empty((steps + 1, states))
    forward[0] = 0.0
    forward[0, 0] = 1.0
    for k in range(steps):
        row = order[k]
        _spread(forward[k], forward[k + 1], pairs[row], missed[row], (slot, True))
        _retire(forward[k + 1], np.flatnonzero(last == k), slot, free)
        # Only ratios within a step count; left to grow, weights of long chains overflow.
        forward[k + 1] /= forward[k + 1].max()
    backward, open_ended = np.zeros(states), np.empty(states)
    backward[0] = 1.0
    found = np.zeros(pairs.shape)
    for k in range(steps - 1, -1, -1):
        row = order[k]
        _revive(backward, np.flatnonzero(last == k), slot, free)
        total = missed[row] * (forward[k] * backward).sum()
        for j in range(pairs.shape[1]):
            if pairs[row, j] > 0:
                found[row, j] = pairs[row, j] * _met(forward[k], backward, 1 << slot[j])
                total += found[row, j]
        found[row] /= total
        _spread(backward, open_ended, pairs[row], missed[row], (slot, False))
        backward[:] = open_ended / open_ended.max()
    return found


@compiled()
def _spread(
    before: np.ndarray,
    after: np.ndarray,
    row: np.ndarray,
    missed: float,
    way: tuple[np.ndarray, bool],
) -> None:
    """Let a row take nothing or any column that is free; backwards: have taken it.

    way: (M,) bits, and whether it goes forwards. States that differ in one bit lie in blocks, so
    that no state is looked at in vain.
    """
    slot, forwards = way
    after[:] = missed * before
    for j in range(len(row)):
        if row[j] > 0:
            bit = 1 << slot[j]
            source, target = (0, bit) if forwards else (bit, 0)
            for block in range(0, len(before), 2 * bit):
                for state in range(block, block + bit):
                    after[state + target] += row[j] * before[state + source]


@compiled()
def _retire(weights: np.ndarray, done: np.ndarray, slot: np.ndarray, free: np.ndarray) -> None:
    """Forget of columns seen for the last time whether they are taken."""
    for j in done:
        bit = 1 << slot[j]
        for block in range(0, len(weights), 2 * bit):
            for state in range(block, block + bit):
                weights[state] = free[j] * weights[state] + weights[state + bit]
                weights[state + bit] = 0.0


@compiled()
def _revive(weights: np.ndarray, done: np.ndarray, slot: np.ndarray, free: np.ndarray) -> None:
    """Undo `_retire`, backwards: what is to come has this weight, taken or not."""
    for j in done:
        bit = 1 << slot[j]
        for block in range(0, len(weights), 2 * bit):
            for state in range(block, block + bit):
                weights[state + bit] = weights[state]
                weights[state] *= free[j]


@compiled()
def _met(forward: np.ndarray, backward: np.ndarray, bit: int) -> float:
    """Sum over all events in which this row takes the column of this bit."""
    total = 0.0
    for block in range(0, len(forward), 2 * bit):
        for state in range(block, block + bit):
            total += forward[state] * backward[state + bit]
    return total
