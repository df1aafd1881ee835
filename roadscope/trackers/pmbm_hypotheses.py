"""How each global hypothesis goes on: its best assignments of tracks and detections."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.assignment import _groups
from roadscope.trackers.pmbm_assignments import best_assignments


@compiled()
def continued(
    members: np.ndarray, log_weights: np.ndarray, costs: np.ndarray, count: int, gap: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the likeliest ways in which H global hypotheses of T tracks go on.

    members: (H, T) which local hypothesis is of each track, -1 for none.
    log_weights: (H,) of the hypotheses if nothing were detected of any track, up to a constant.
    costs: (L, M) minus the logarithm of how much a detection changes that; inf where impossible.
    count: how many to look for in all; each hypothesis gets its share by weight, at least one.
    gap: how much less likely, as a logarithm, than the likeliest of the same hypothesis.

    Returns (K,) the hypothesis each comes from, (K, T) detections or -1, (K,) log weights.
    Tracks and detections that nothing connects are looked at apart, and only once where
    hypotheses agree on them.
    """
    H, T = members.shape
    shares = np.exp(log_weights - log_weights.max())
    shares /= shares.sum()
    columns = [np.full((1, T), -1) for _ in range(H)]
    totals = [np.zeros(1) for _ in range(H)]
    group = _groups(_least_costs(members, costs), gap)
    for first in range(T):
        if group[first] != first:
            continue
        tracks = np.flatnonzero(group[:T] == first)
        targets = np.flatnonzero(group[T:] == first)
        same_as = _first_alike(members, tracks)
        ways = [np.empty((0, 0), np.int64) for _ in range(H)]
        prices = [np.empty(0) for _ in range(H)]
        for h in range(H):
            if same_as[h] == h:
                part = _part(costs, members[h], tracks, targets, gap)
                ways[h], prices[h] = best_assignments(part, count, gap)
            most = max(1, int(np.ceil(count * shares[h])))
            columns[h], totals[h] = _crossed(
                (columns[h], totals[h]), (ways[same_as[h]], prices[same_as[h]]),
                tracks, targets, (most, gap),
            )  # fmt: skip
    return _listed(columns, totals, log_weights, T)


@compiled()
def _least_costs(members: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Return (T, M) costs of each track's cheapest local hypothesis."""
    least = np.full((members.shape[1], costs.shape[1]), np.inf)
    done = np.zeros(len(costs), np.bool_)
    for h in range(len(members)):
        for t in range(members.shape[1]):
            k = members[h, t]
            if k >= 0 and not done[k]:
                done[k] = True
                for j in range(costs.shape[1]):
                    least[t, j] = min(least[t, j], costs[k, j])
    return least


@compiled()
def _first_alike(members: np.ndarray, tracks: np.ndarray) -> np.ndarray:
    """Return (H,) the first hypothesis that says the same of some tracks."""
    first = np.arange(len(members))
    for h in range(len(members)):
        for other in range(h):
            alike = True
            for t in tracks:
                if members[h, t] != members[other, t]:
                    alike = False
                    break
            if alike:
                first[h] = other
                break
    return first


@compiled()
def _part(
    costs: np.ndarray, member: np.ndarray, tracks: np.ndarray, targets: np.ndarray, gap: float
) -> np.ndarray:
    """Return costs of some tracks and detections.

    A pair dearer than the gap is in no assignment within the gap: without it that one is cheaper.
    """
    part = np.full((len(tracks), len(targets)), np.inf)
    for i in range(len(tracks)):
        k = member[tracks[i]]
        if k >= 0:
            for j in range(len(targets)):
                if costs[k, targets[j]] <= gap:
                    part[i, j] = costs[k, targets[j]]
    return part


@compiled()
def _crossed(
    known: tuple[np.ndarray, np.ndarray],
    more: tuple[np.ndarray, np.ndarray],
    tracks: np.ndarray,
    targets: np.ndarray,
    limits: tuple[int, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Join the assignments so far, columns and totals, with those of one more group."""
    (columns, totals), (ways, prices) = known, more
    sums = np.empty(len(totals) * len(prices))
    for a in range(len(totals)):
        for b in range(len(prices)):
            sums[a * len(prices) + b] = totals[a] + prices[b]
    order = np.argsort(sums, kind="mergesort")[: limits[0]]
    size = 0
    while size < len(order) and sums[order[size]] <= sums[order[0]] + limits[1]:
        size += 1
    joined = np.empty((size, columns.shape[1]), np.int64)
    for k in range(size):
        joined[k] = columns[order[k] // len(prices)]
        for i in range(len(tracks)):
            way = ways[order[k] % len(prices), i]
            joined[k, tracks[i]] = targets[way] if way >= 0 else -1
    return joined, sums[order[:size]]


@compiled()
def _listed(
    columns: list[np.ndarray], totals: list[np.ndarray], log_weights: np.ndarray, T: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Put all hypotheses' continuations into one list."""
    size = 0
    for each in totals:
        size += len(each)
    parents, found = np.empty(size, np.int64), np.empty((size, T), np.int64)
    weights = np.empty(size)
    k = 0
    for h in range(len(totals)):
        for a in range(len(totals[h])):
            parents[k], found[k] = h, columns[h][a]
            weights[k] = log_weights[h] - totals[h][a]
            k += 1
    return parents, found, weights
