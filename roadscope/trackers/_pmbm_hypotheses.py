"""How global hypotheses continue: by the best assignments of targets and detections.

Targets that compete for a detection, directly or through others, form a cluster. Each cluster has
its own hypotheses and weights (Reid 1979). Hypotheses of all targets together would be all
combinations of those of the clusters, which are too many.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.sorting import stable_order
from roadscope.trackers._assignment import components, least_total, sorted_by


class HypothesisLimits(NamedTuple):
    """Which hypotheses of a cluster are not pruned.

    most: the greatest number.
    gap: the greatest difference between the log weight of the best hypothesis and that of another.
    """

    most: int
    gap: float


class Hypotheses(NamedTuple):
    """H global hypotheses of clusters of targets, with E members in all.

    cluster: (H,) int64, rising.
    log_weights: (H,).
    hypothesis, target, local: (E,) int64, sorted by hypothesis: each member is a target of a
        hypothesis, with one of its local hypotheses, that is, with a history of detections.
    """

    cluster: np.ndarray
    log_weights: np.ndarray
    hypothesis: np.ndarray
    target: np.ndarray
    local: np.ndarray


class Continuations(NamedTuple):
    """`Hypotheses` after a tick, with F members.

    local: (F,) the local hypothesis of a member before the tick; for new targets L, the number
        of local hypotheses before.
    detection: (F,) the detection that the member gets, -1 for none.
    """

    cluster: np.ndarray
    log_weights: np.ndarray
    hypothesis: np.ndarray
    target: np.ndarray
    local: np.ndarray
    detection: np.ndarray


class PairCosts(NamedTuple):
    """P possible pairs of L local hypotheses and M detections.

    local, detection: (P,) int64, sorted by local hypothesis, then by detection.
    costs: (P,) minus the logarithm of the weight that the detection adds, compared with a miss and
        a detection that is new or clutter.
    """

    local: np.ndarray
    detection: np.ndarray
    costs: np.ndarray


class Sizes(NamedTuple):
    """Number of targets, of their local hypotheses and of detections."""

    targets: int
    locals: int
    detections: int


class ClusterContinuations(NamedTuple):
    """The k continuations of one cluster of t targets and m detections.

    targets, detections: (t,) and (m,) their numbers among all.
    local: (k, t) the local hypothesis of each target before the tick, -1 for none.
    assigned: (k, t) index into `detections`, -1 for none.
    log_weights: (k,).
    """

    targets: np.ndarray
    detections: np.ndarray
    local: np.ndarray
    assigned: np.ndarray
    log_weights: np.ndarray


@compiled()
def continue_all(
    hypotheses: Hypotheses, pairs: PairCosts, sizes: Sizes, limits: HypothesisLimits
) -> Continuations:
    """Return the continuations of all clusters; clusters that compete for a detection are merged.

    limits: of the hypotheses of each cluster; the gap also limits the continuations of each
        hypothesis.

    With T targets and L local hypotheses before, a detection j that no target gets is the new
    target T + j with the local hypothesis L.
    """
    T = sizes.targets
    clusters = hypotheses.cluster.max() + 1 if len(hypotheses.cluster) else 0
    component, count = _competitors(hypotheses, pairs, sizes, clusters, limits.gap)
    target_order, first_target = sorted_by(component[:T], count)
    detection_order, first_detection = sorted_by(component[T : T + sizes.detections], count)
    cluster_order, first_cluster = sorted_by(component[T + sizes.detections :], count)
    first_hypothesis = np.searchsorted(hypotheses.cluster, np.arange(clusters + 1))
    first_member = np.searchsorted(hypotheses.hypothesis, np.arange(len(hypotheses.cluster) + 1))
    first_pair = np.searchsorted(pairs.local, np.arange(sizes.locals + 1))
    target_index, detection_index = np.empty(T, np.int64), np.full(sizes.detections, -1)
    blocks = [_unclaimed(0) for _ in range(0)]
    for c in range(count):
        targets = target_order[first_target[c] : first_target[c + 1]]
        detections = detection_order[first_detection[c] : first_detection[c + 1]]
        for i in range(len(targets)):
            target_index[targets[i]] = i
        for j in range(len(detections)):
            detection_index[detections[j]] = j
        local, log_weights = np.full((1, len(targets)), -1), np.zeros(1)
        for k in cluster_order[first_cluster[c] : first_cluster[c + 1]]:
            first, last = first_hypothesis[k], first_hypothesis[k + 1]
            table = np.full((last - first, len(targets)), -1)
            for e in range(first_member[first], first_member[last]):
                row = hypotheses.hypothesis[e] - first
                table[row, target_index[hypotheses.target[e]]] = hypotheses.local[e]
            local, log_weights = _product(
                local, log_weights, table, hypotheses.log_weights[first:last], limits
            )
        number, costs = _cluster_costs(
            local, pairs, first_pair, detection_index, len(detections), limits.gap
        )
        if local.size == 1 and len(costs) == 1:
            assigned, totals = best_assignments(costs, limits.most, limits.gap)
            parents, after = np.zeros(len(assigned), np.int64), log_weights[0] - totals
        else:
            parents, assigned, after = continue_hypotheses(
                number, log_weights, costs, limits.most, limits.gap
            )
        blocks.append(ClusterContinuations(targets, detections, local[parents], assigned, after))
        detection_index[detections] = -1
    for unclaimed in np.flatnonzero(component[T : T + sizes.detections] < 0):
        blocks.append(_unclaimed(int(unclaimed)))  # noqa: PERF401
    return _joined_continuations(blocks, sizes)


@compiled()
def _competitors(
    hypotheses: Hypotheses, pairs: PairCosts, sizes: Sizes, clusters: int, gap: float
) -> tuple[np.ndarray, int]:
    """Return `components` of targets (rows) with M detections and C previous clusters (columns).

    A target is connected with its cluster and with the detections that it may get. gap: greatest
    cost of such a pair.
    """
    target_of_local = np.zeros(sizes.locals, np.int64)
    target_of_local[hypotheses.local] = hypotheses.target
    likely = np.flatnonzero(pairs.costs < gap)
    rows = np.concatenate((target_of_local[pairs.local[likely]], hypotheses.target))
    cluster = hypotheses.cluster[hypotheses.hypothesis]
    columns = np.concatenate((pairs.detection[likely], sizes.detections + cluster))
    return components(rows, columns, sizes.targets, sizes.detections + clusters)


@compiled()
def _unclaimed(detection: int) -> ClusterContinuations:
    """Return the continuation of a detection that no target may get: a new target."""
    none = np.empty((1, 0), np.int64)
    return ClusterContinuations(
        np.empty(0, np.int64), np.full(1, detection), none, none, np.zeros(1)
    )


@compiled()
def _cluster_costs(
    local: np.ndarray,
    pairs: PairCosts,
    first_pair: np.ndarray,
    detection_index: np.ndarray,
    detections: int,
    gap: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the local hypotheses of a cluster, numbered anew from 0, and their costs.

    local: (h, t) local hypotheses of the targets in each joint hypothesis, -1 for none.
    first_pair: (L + 1,) where the pairs of each local hypothesis start.
    detection_index: (M,) number of each detection within the cluster, -1 outside of it.
    detections: the number m of detections in the cluster.
    Returns (h, t) new numbers in the order of `local`, -1 for none, and (l, m) costs, inf beyond
    the gap.
    """
    number_of = np.full(len(first_pair) - 1, -1)
    for h in range(local.shape[0]):
        for t in range(local.shape[1]):
            if local[h, t] >= 0:
                number_of[local[h, t]] = 0
    used = np.flatnonzero(number_of == 0)
    costs = np.full((len(used), detections), np.inf)
    for i in range(len(used)):
        number_of[used[i]] = i
        for k in range(first_pair[used[i]], first_pair[used[i] + 1]):
            j = detection_index[pairs.detection[k]]
            if j >= 0 and pairs.costs[k] <= gap:
                costs[i, j] = pairs.costs[k]
    numbers = np.full(local.shape, -1)
    for h in range(local.shape[0]):
        for t in range(local.shape[1]):
            if local[h, t] >= 0:
                numbers[h, t] = number_of[local[h, t]]
    return numbers, costs


@compiled()
def _joined_continuations(blocks: list[ClusterContinuations], sizes: Sizes) -> Continuations:
    """Return the hypotheses of all clusters, each with the new targets of its cluster."""
    rows, most = 0, 0
    for block in blocks:
        rows += len(block.log_weights)
        most += len(block.log_weights) * (len(block.targets) + len(block.detections))
    cluster, log_weights = np.empty(rows, np.int64), np.empty(rows)
    hypothesis, target = np.empty(most, np.int64), np.empty(most, np.int64)
    local, detection = np.empty(most, np.int64), np.empty(most, np.int64)
    h, e = 0, 0
    for c in range(len(blocks)):
        block = blocks[c]
        for k in range(len(block.log_weights)):
            cluster[h], log_weights[h] = c, block.log_weights[k]
            taken = np.zeros(len(block.detections), np.bool_)
            for i in range(len(block.targets)):
                j = block.assigned[k, i]
                if j >= 0:
                    taken[j] = True
                if block.local[k, i] >= 0:
                    hypothesis[e], target[e] = h, block.targets[i]
                    local[e] = block.local[k, i]
                    detection[e] = block.detections[j] if j >= 0 else -1
                    e += 1
            for j in range(len(block.detections)):
                if not taken[j]:
                    hypothesis[e], target[e] = h, sizes.targets + block.detections[j]
                    local[e], detection[e] = sizes.locals, block.detections[j]
                    e += 1
            h += 1
    return Continuations(cluster, log_weights, hypothesis[:e], target[:e], local[:e], detection[:e])


@compiled()
def _cheapest_sums(
    costs: np.ndarray, more_costs: np.ndarray, limits: HypothesisLimits
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least sums of one cost of each array, within limits.

    costs, more_costs: (A,) and (B,). Returns (K,) indices a * B + b, and (K,) rising sums.
    """
    sums = np.empty(len(costs) * len(more_costs))
    for a in range(len(costs)):
        for b in range(len(more_costs)):
            sums[a * len(more_costs) + b] = costs[a] + more_costs[b]
    order = stable_order(sums)[: limits.most]
    size = 0
    while size < len(order) and sums[order[size]] <= sums[order[0]] + limits.gap:
        size += 1
    return order[:size], sums[order[:size]]


@compiled()
def _product(
    local: np.ndarray,
    log_weights: np.ndarray,
    more_local: np.ndarray,
    more_log_weights: np.ndarray,
    limits: HypothesisLimits,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the likeliest joint hypotheses (K, T) of two clusters, and log weights (K,).

    local, more_local: (A, T) and (B, T) local hypotheses of the targets, -1 for those of the other
    cluster. log_weights, more_log_weights: (A,) and (B,).
    """
    order, costs = _cheapest_sums(-log_weights, -more_log_weights, limits)
    joint = np.empty((len(order), local.shape[1]), np.int64)
    for k in range(len(order)):
        a, b = order[k] // len(more_log_weights), order[k] % len(more_log_weights)
        joint[k] = np.maximum(local[a], more_local[b])
    return joint, -costs


@compiled()
def continue_hypotheses(
    local: np.ndarray, log_weights: np.ndarray, costs: np.ndarray, count: int, gap: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the likeliest continuations of H global hypotheses of T targets.

    local: (H, T) the local hypothesis of each target, -1 for none.
    log_weights: (H,) of the hypotheses if nothing were detected, up to a constant.
    costs: (L, M) as in `PairCosts`, inf where impossible.
    count: number of continuations of all hypotheses; each has a share of it in proportion to its
        weight, at least one.
    gap: greatest difference between the log weight of the likeliest continuation of a hypothesis
        and that of another one.

    Returns (K,) the hypothesis of each, (K, T) detections or -1, and (K,) log weights.
    Connected components of targets and detections are assigned one by one. Where several
    hypotheses have the same local hypotheses in a component, it is assigned once for all of them.
    """
    H, T = local.shape
    shares = np.exp(log_weights - log_weights.max())
    shares /= shares.sum()
    assigned = [np.full((1, T), -1) for _ in range(H)]
    totals = [np.zeros(1) for _ in range(H)]
    rows, columns = np.nonzero(_least_costs(local, costs) < gap)
    component, components_count = components(rows, columns, T, costs.shape[1])
    for number in range(components_count):
        targets = np.flatnonzero(component[:T] == number)
        detections = np.flatnonzero(component[T:] == number)
        same_as = _first_that_agrees(local, targets)
        part_assigned = [np.empty((0, 0), np.int64) for _ in range(H)]
        part_totals = [np.empty(0) for _ in range(H)]
        for h in range(H):
            first = same_as[h]
            if first == h:
                part = _part_costs(costs, local[h], targets, detections, gap)
                part_assigned[h], part_totals[h] = best_assignments(part, count, gap)
            most = max(1, int(np.ceil(count * shares[h])))
            order, sums = _cheapest_sums(totals[h], part_totals[first], HypothesisLimits(most, gap))
            part_count = len(part_totals[first])
            joined = np.empty((len(order), T), np.int64)
            for k in range(len(order)):
                joined[k] = assigned[h][order[k] // part_count]
                for i in range(len(targets)):
                    j = part_assigned[first][order[k] % part_count, i]
                    joined[k, targets[i]] = detections[j] if j >= 0 else -1
            assigned[h], totals[h] = joined, sums
    size = 0
    for each in totals:
        size += len(each)
    parents, all_assigned = np.empty(size, np.int64), np.empty((size, T), np.int64)
    weights = np.empty(size)
    k = 0
    for h in range(H):
        for a in range(len(totals[h])):
            parents[k], all_assigned[k] = h, assigned[h][a]
            weights[k] = log_weights[h] - totals[h][a]
            k += 1
    return parents, all_assigned, weights


@compiled()
def _least_costs(local: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Return (T, M) the least cost of any local hypothesis of each target."""
    least = np.full((local.shape[1], costs.shape[1]), np.inf)
    done = np.zeros(len(costs), np.bool_)
    for h in range(len(local)):
        for t in range(local.shape[1]):
            k = local[h, t]
            if k >= 0 and not done[k]:
                done[k] = True
                for j in range(costs.shape[1]):
                    least[t, j] = min(least[t, j], costs[k, j])
    return least


@compiled()
def _first_that_agrees(local: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return for each hypothesis, (H,), the first one with the same local hypotheses of targets.

    targets: numbers of the targets that are compared.
    """
    first = np.arange(len(local))
    for h in range(len(local)):
        for other in range(h):
            agrees = True
            for t in targets:
                if local[h, t] != local[other, t]:
                    agrees = False
                    break
            if agrees:
                first[h] = other
                break
    return first


@compiled()
def _part_costs(
    costs: np.ndarray, local: np.ndarray, targets: np.ndarray, detections: np.ndarray, gap: float
) -> np.ndarray:
    """Return the (t, m) costs of some targets and detections in one hypothesis, inf beyond the gap.

    An assignment with a pair that costs more than the gap exceeds the same assignment without this
    pair by more than the gap, so it is not needed.
    """
    part = np.full((len(targets), len(detections)), np.inf)
    for i in range(len(targets)):
        k = local[targets[i]]
        if k >= 0:
            for j in range(len(detections)):
                if costs[k, detections[j]] <= gap:
                    part[i, j] = costs[k, detections[j]]
    return part


@compiled()
def best_assignments(costs: np.ndarray, count: int, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the `count` cheapest assignments of (N, M) costs, within a gap (Murty 1968).

    An unassigned row or column costs 0. A pair may cost less or more, and inf if it is impossible.

    gap: greatest difference between a total and the least one.
    Returns (K, N) int64 columns, -1 where a row is unassigned, and (K,) rising totals.
    """
    n, m = costs.shape
    if n == 1:
        return _best_of_one_row(costs[0], HypothesisLimits(count, gap))
    # Each row has a column of its own for being unassigned. Impossible pairs cost more than any two
    # possible assignments differ.
    impossible_cost = 1.0
    for i in range(n):
        for j in range(m):
            if costs[i, j] < np.inf:
                impossible_cost += abs(costs[i, j])
    padded = np.full((n, m + n), impossible_cost)
    for i in range(n):
        padded[i, m + i] = 0.0
        for j in range(m):
            if costs[i, j] < np.inf:
                padded[i, j] = costs[i, j]
    chosen = np.empty((1 + count * n, n), np.int64)
    barred = np.zeros((1 + count * n, m + n), np.bool_)
    fixed = np.zeros(1 + count * n, np.int64)
    totals = np.full(1 + count * n, np.inf)
    totals[0] = _complete(padded, impossible_cost, chosen[0], 0, barred[0])
    size, worst = 1, totals[0] + gap
    columns, best_totals = np.empty((count, n), np.int64), np.empty(count)
    k = 0
    while k < count:
        best = np.argmin(totals[:size])
        if not totals[best] <= worst or totals[best] == np.inf:
            break
        columns[k], best_totals[k] = chosen[best], totals[best]
        k += 1
        # The other assignments of this node are divided by the first row in which they differ.
        for row in range(fixed[best], n):
            chosen[size] = chosen[best]
            barred[size] = barred[best] & (row == fixed[best])
            barred[size, chosen[best, row]] = True
            fixed[size] = row
            totals[size] = _complete(padded, impossible_cost, chosen[size], row, barred[size])
            if totals[size] <= worst:
                size += 1
            else:
                totals[size] = np.inf
        totals[best] = np.inf
    return np.where(columns[:k] < m, columns[:k], -1), best_totals[:k]


@compiled()
def _best_of_one_row(costs: np.ndarray, limits: HypothesisLimits) -> tuple[np.ndarray, np.ndarray]:
    """Return `best_assignments` of one row of (M,) costs."""
    order, totals = _cheapest_sums(np.append(costs, 0.0), np.zeros(1), limits)
    size = 0
    while size < len(totals) and totals[size] < np.inf:
        size += 1
    columns = order[:size].reshape(-1, 1)
    return np.where(columns < len(costs), columns, -1), totals[:size]


@compiled()
def _complete(
    padded: np.ndarray, impossible_cost: float, chosen: np.ndarray, fixed: int, barred: np.ndarray
) -> float:
    """Write the cheapest columns of the rows from `fixed` on; return the total, inf if impossible.

    padded: (N, C) costs. impossible_cost: that of impossible pairs. chosen: (N,) columns of rows;
    those before `fixed` are not changed. barred: (C,) bool, columns that row `fixed` must not have.
    """
    n, m = padded.shape
    remaining = padded[fixed:].copy()
    total = 0.0
    for i in range(fixed):
        remaining[:, chosen[i]] = impossible_cost
        total += padded[i, chosen[i]]
    for j in range(m):
        if barred[j]:
            remaining[0, j] = impossible_cost
    columns = least_total(remaining)
    for i in range(n - fixed):
        if remaining[i, columns[i]] >= impossible_cost:
            return np.inf
        chosen[fixed + i] = columns[i]
        total += remaining[i, columns[i]]
    return total
