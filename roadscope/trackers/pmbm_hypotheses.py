"""How hypotheses go on: by the best assignments of tracks and detections.

Tracks that compete for no detection, directly or through others, are in clusters of their own,
each with hypotheses and weights of its own (Reid 1979). All hypotheses at once would be their
product, of which no count would be enough.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.components import components
from roadscope.trackers.pmbm_assignments import best_assignments

Parts = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@compiled()
def all_continued(
    cluster: np.ndarray,
    members: np.ndarray,
    log_weights: np.ndarray,
    costs: np.ndarray,
    limits: tuple[int, float],
) -> Parts:
    """Return how the hypotheses of all clusters go on; clusters that now compete become one.

    cluster: (H,) which cluster a hypothesis is of; members: (H, T), -1 outside of it too.
    log_weights, costs: as in `continued`; limits: its count, of each cluster, and its gap.

    Returns (K,) new clusters, (K, T) members each hypothesis had, (K, T) detections or -1, (K,)
    log weights, and (M,) the cluster of each detection.
    """
    T, M = members.shape[1], costs.shape[1]
    clusters = cluster.max() + 1 if len(cluster) else 0
    links = np.nonzero(_links(cluster, members, costs, clusters, limits[1]) < 0.5)
    group, parts_count = components(links[0], links[1], (T, M + clusters))
    owner = np.full(M, -1)
    parts = [(np.empty(0, np.int64), np.empty((0, 0), np.int64), np.empty((0, 0), np.int64))]
    weights = [np.empty(0)]
    for number in range(parts_count):
        tracks = np.flatnonzero(group[:T] == number)
        targets = np.flatnonzero(group[T : T + M] == number)
        owner[targets] = len(parts) - 1
        joint, prior = np.full((1, len(tracks)), -1), np.zeros(1)
        for c in np.flatnonzero(group[T + M :] == number):
            rows = np.flatnonzero(cluster == c)
            joint, prior = _product(
                joint, prior, members[rows][:, tracks], log_weights[rows], limits
            )
        used = np.unique(joint)
        used = used[used >= 0]
        local = np.where(joint >= 0, np.searchsorted(used, joint), -1)
        parents, columns, after = continued(
            local, prior, costs[used][:, targets], limits[0], limits[1]
        )
        for k in range(len(columns)):
            for i in range(len(tracks)):
                columns[k, i] = targets[columns[k, i]] if columns[k, i] >= 0 else -1
        parts.append((tracks, joint[parents], columns))
        weights.append(after)
    return _spread_out(parts, weights, owner, T)


@compiled()
def _links(
    cluster: np.ndarray, members: np.ndarray, costs: np.ndarray, clusters: int, gap: float
) -> np.ndarray:
    """Return (T, M + C), 0 where a track may have a detection or is of a cluster, otherwise 1."""
    T, M = members.shape[1], costs.shape[1]
    least = _least_costs(members, costs)
    links = np.ones((T, M + clusters))
    for t in range(T):
        for j in range(M):
            if least[t, j] < gap:
                links[t, j] = 0.0
    for h in range(len(members)):
        for t in range(T):
            if members[h, t] >= 0:
                links[t, M + cluster[h]] = 0.0
    return links


@compiled()
def _product(
    some: np.ndarray,
    weights: np.ndarray,
    others: np.ndarray,
    more: np.ndarray,
    limits: tuple[int, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Join the hypotheses of two clusters, (A, T) and (B, T), the likeliest pairs first."""
    sums = np.empty(len(weights) * len(more))
    for a in range(len(weights)):
        for b in range(len(more)):
            sums[a * len(more) + b] = weights[a] + more[b]
    order = np.argsort(-sums, kind="mergesort")[: limits[0]]
    size = 0
    while size < len(order) and sums[order[size]] >= sums[order[0]] - limits[1]:
        size += 1
    joint = np.empty((size, some.shape[1]), np.int64)
    for k in range(size):
        a, b = order[k] // len(more), order[k] % len(more)
        joint[k] = np.maximum(some[a], others[b])
    return joint, sums[order[:size]]


@compiled()
def _spread_out(
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    weights: list[np.ndarray],
    owner: np.ndarray,
    T: int,
) -> Parts:
    """Put the clusters' hypotheses below one another; a detection alone makes a cluster too."""
    size = (owner < 0).sum()
    for each in weights:
        size += len(each)
    cluster, log_weights = np.empty(size, np.int64), np.zeros(size)
    before, columns = np.full((size, T), -1), np.full((size, T), -1)
    k = 0
    for c in range(1, len(parts)):
        tracks, had, took = parts[c]
        for a in range(len(weights[c])):
            cluster[k], log_weights[k] = c - 1, weights[c][a]
            for i in range(len(tracks)):
                before[k, tracks[i]], columns[k, tracks[i]] = had[a, i], took[a, i]
            k += 1
    for j in range(len(owner)):
        if owner[j] < 0:
            owner[j] = cluster[k] = len(parts) - 1 + j
            k += 1
    return cluster, before, columns, log_weights, owner


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
    links = np.nonzero(_least_costs(members, costs) < gap)
    group, parts_count = components(links[0], links[1], (T, costs.shape[1]))
    for number in range(parts_count):
        tracks = np.flatnonzero(group[:T] == number)
        targets = np.flatnonzero(group[T:] == number)
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
