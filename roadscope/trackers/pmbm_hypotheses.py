"""How hypotheses go on: by the best assignments of tracks and detections.

Tracks that compete for no detection, directly or through others, are in clusters of their own,
each with hypotheses and weights of its own (Reid 1979). All hypotheses at once would be their
product, of which no count would be enough.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.components import components, sorted_by
from roadscope.trackers.pmbm_assignments import best_assignments

Parts = tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
Block = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of one cluster: (t,) tracks, (m,) detections, (k, t) members each had and what these took."""


@compiled()
def all_continued(
    hypotheses: tuple[np.ndarray, np.ndarray],
    members: tuple[np.ndarray, np.ndarray, np.ndarray],
    near: tuple[np.ndarray, np.ndarray, np.ndarray],
    counts: tuple[int, int, int],
    limits: tuple[int, float],
) -> Parts:
    """Return how the hypotheses of all clusters go on; clusters that now compete become one.

    hypotheses: (H,) their clusters, rising, and (H,) log weights as in `continued`.
    members: (E,) hypothesis, target and local hypothesis, by hypothesis.
    near: (P,) rows, columns and costs of local hypotheses and detections that may be a pair.
    counts, limits: T, L and M; `count` of `continued`, of each cluster, and its `gap`.

    Returns (K,) new clusters, (K,) log weights and (F,) entries of new members: hypothesis,
    target, the local hypothesis that it had, and its detection or -1. A detection taken by nobody
    is target T + j, and had local hypothesis L.
    """
    (cluster, log_weights), (hypothesis, target, local) = hypotheses, members
    T, L, M = counts
    clusters = cluster.max() + 1 if len(cluster) else 0
    group, count = _competitors(
        (cluster[hypothesis], target, local), near, (T, L, M, clusters), limits[1]
    )
    tracks, first_track = sorted_by(group[:T], count)
    targets, first_target = sorted_by(group[T : T + M], count)
    joined, first_joined = sorted_by(group[T + M :], count)
    first_hypothesis = np.searchsorted(cluster, np.arange(clusters + 1))
    first_member = np.searchsorted(hypothesis, np.arange(len(cluster) + 1))
    place = np.empty(T, np.int64)
    blocks, weights = [_alone(0) for _ in range(0)], [np.empty(0) for _ in range(0)]
    for c in range(count):
        mine = tracks[first_track[c] : first_track[c + 1]]
        theirs = targets[first_target[c] : first_target[c + 1]]
        place[mine] = np.arange(len(mine))
        joint, prior = np.full((1, len(mine)), -1), np.zeros(1)
        for k in joined[first_joined[c] : first_joined[c + 1]]:
            rows = slice(first_hypothesis[k], first_hypothesis[k + 1])
            entries = slice(first_member[rows.start], first_member[rows.stop])
            table = np.full((rows.stop - rows.start, len(mine)), -1)
            _fill(table, hypothesis[entries] - rows.start, place[target[entries]], local[entries])
            joint, prior = _product(joint, prior, table, log_weights[rows], limits)
        used, inside = _inside(joint, theirs, near, limits[1])
        parents, ways, after = _cluster_continued(joint, prior, used, inside, limits)
        blocks.append((mine, theirs, joint[parents], ways))
        weights.append(after)
    for j in np.flatnonzero(group[T : T + M] < 0):
        blocks.append(_alone(int(j)))
        weights.append(np.zeros(1))
    return _listed_members(blocks, weights, T, L)


@compiled()
def _competitors(
    members: tuple[np.ndarray, np.ndarray, np.ndarray],
    near: tuple[np.ndarray, np.ndarray, np.ndarray],
    counts: tuple[int, int, int, int],
    gap: float,
) -> tuple[np.ndarray, int]:
    """Return `components` of (T,) targets with (M,) detections and (C,) clusters up to now.

    members: (E,) cluster, target and local hypothesis.
    """
    (cluster, target, local), (T, L, M, clusters) = members, counts
    of_local = np.zeros(L, np.int64)
    of_local[local] = target
    likely = np.flatnonzero(near[2] < gap)
    some = np.concatenate((of_local[near[0][likely]], target))
    others = np.concatenate((near[1][likely], M + cluster))
    return components(some, others, (T, M + clusters))


@compiled()
def _fill(table: np.ndarray, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
    """Write values to places of a table."""
    for k in range(len(values)):
        table[rows[k], columns[k]] = values[k]


@compiled()
def _cluster_continued(
    joint: np.ndarray,
    prior: np.ndarray,
    used: np.ndarray,
    inside: np.ndarray,
    limits: tuple[int, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `continued` of one cluster; of one target alone without a detour.

    joint: (h, t) local hypotheses, those `used` rising; inside: (l, m) their costs.
    """
    if joint.size == 1 and len(used) == 1:
        ways, prices = best_assignments(inside, limits[0], limits[1])
        return np.zeros(len(ways), np.int64), ways, prior[0] - prices
    known = np.where(joint >= 0, np.searchsorted(used, joint), -1)
    return continued(known, prior, inside, limits[0], limits[1])


@compiled()
def _alone(j: int) -> Block:
    """Return the cluster of a detection that no track may have."""
    none = np.empty((1, 0), np.int64)
    return np.empty(0, np.int64), np.full(1, j), none, none


@compiled()
def _inside(
    joint: np.ndarray,
    targets: np.ndarray,
    near: tuple[np.ndarray, np.ndarray, np.ndarray],
    gap: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the local hypotheses of a cluster, rising, and (l, m) their costs up to the gap."""
    rows, columns, costs = near
    used = np.unique(joint)
    used = used[used >= 0]
    inside = np.full((len(used), len(targets)), np.inf)
    for i in range(len(used)):
        first, last = np.searchsorted(rows, used[i]), np.searchsorted(rows, used[i] + 1)
        for k in range(first, last):
            j = np.searchsorted(targets, columns[k])
            if costs[k] <= gap and j < len(targets) and targets[j] == columns[k]:
                inside[i, j] = costs[k]
    return used, inside


@compiled()
def _listed_members(blocks: list[Block], weights: list[np.ndarray], T: int, L: int) -> Parts:
    """Put the clusters' hypotheses below one another, each with those who are new in it."""
    size, most = 0, 0
    for c in range(len(blocks)):
        size += len(weights[c])
        most += len(weights[c]) * (len(blocks[c][0]) + len(blocks[c][1]))
    cluster, log_weights = np.empty(size, np.int64), np.empty(size)
    entries = np.empty((4, most), np.int64)
    h, e = 0, 0
    for c in range(len(blocks)):
        tracks, targets, had, took = blocks[c]
        for k in range(len(weights[c])):
            cluster[h], log_weights[h] = c, weights[c][k]
            taken = np.zeros(len(targets), np.bool_)
            for i in range(len(tracks)):
                if took[k, i] >= 0:
                    taken[took[k, i]] = True
                if had[k, i] >= 0:
                    entries[0, e], entries[1, e], entries[2, e] = h, tracks[i], had[k, i]
                    entries[3, e] = targets[took[k, i]] if took[k, i] >= 0 else -1
                    e += 1
            for j in range(len(targets)):
                if not taken[j]:
                    entries[0, e], entries[1, e], entries[2, e] = h, T + targets[j], L
                    entries[3, e] = targets[j]
                    e += 1
            h += 1
    return cluster, log_weights, (entries[0, :e], entries[1, :e], entries[2, :e], entries[3, :e])


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
