import itertools
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm
from tracked_scenes import T as DT
from tracked_scenes import boxes, make

from roadscope.trackers import (
    ConstantVelocity,
    Hypotheses,
    HypothesisLimits,
    PairCosts,
    PositionFilter,
    Sizes,
    best_assignments,
    continue_all,
    continue_hypotheses,
)

SCORE, DETECTION, CLUTTER, BIRTH = 0.7, 0.9, 1e-2, 1e-3


@cache
def history_weight(history, ticks):
    """Weight of a target's detections, (tick, position) each, and its part that still exists.

    Visible, hidden and gone are the states of a Markov chain with a matrix exponential.
    """
    kalman, ratio = PositionFilter(motion=ConstantVelocity(2.0)), SCORE / (1 - SCORE)
    F, Q = kalman.motion.jacobian(None, DT), kalman.motion.noise(None, DT)
    chain = expm(DT * np.array([[-0.1, 0.1, 0], [1, -1, 0], [0, 0, 0]]))
    survival = np.exp(-DT / 30)
    step = chain * survival
    step[:, 2] += 1 - survival
    step[2] = [0, 0, 1]
    history = {tick: np.array(position) for tick, position in history}
    born = min(history)
    first = kalman.started(boxes([history[born]], 0))
    mean, covariance = first.means[0], first.covariances[0]
    state = np.array([BIRTH * DETECTION * ratio, 0, 0])
    for tick in range(born + 1, ticks):
        mean, covariance, state = F @ mean, F @ covariance @ F.T + Q, state @ step
        if tick not in history:
            state = state * [1 - DETECTION, 1, 1]
            continue
        S = covariance[:2, :2] + kalman.R
        residual = history[tick] - mean[:2]
        squared = residual @ np.linalg.solve(S, residual)
        density = np.exp(-squared / 2) / (2 * np.pi * np.sqrt(np.linalg.det(S)))
        state = state * [DETECTION * density * ratio, 0, 0]
        K = covariance[:, :2] @ np.linalg.inv(S)
        mean = mean + K @ residual
        covariance = covariance - K @ S @ K.T
    return state.sum(), state[:2].sum()


def by_enumeration(scans):
    """Existence of the target of each first detection, by all labellings of all detections."""
    total, exists = 0.0, {}

    def visit(tick, weight, histories):
        nonlocal total
        if tick == len(scans):
            ends = {k: history_weight(tuple(h), len(scans)) for k, h in histories.items()}
            weight *= np.prod([w for w, _ in ends.values()])
            total += weight
            for key, (whole, part) in ends.items():
                exists[key] = exists.get(key, 0.0) + weight * part / whole
            return
        options = [None, "new", *histories]
        for chosen in itertools.product(options, repeat=len(scans[tick])):
            old = [c for c in chosen if c not in (None, "new")]
            if len(set(old)) < len(old):
                continue
            after = {key: list(h) for key, h in histories.items()}
            for j, (position, c) in enumerate(zip(scans[tick], chosen, strict=True)):
                if c is not None:
                    key = (tick, j) if c == "new" else c
                    after.setdefault(key, []).append((tick, tuple(position.tolist())))
            visit(tick + 1, weight * CLUTTER ** chosen.count(None), after)

    visit(0, 1.0, {})
    return {key: part / total for key, part in exists.items()}


@pytest.mark.parametrize(
    ("seed", "counts"), [(0, (1, 1, 1, 1)), (1, (1, 2, 0, 1)), (2, (2, 2, 1)), (0, (2, 2, 1))]
)
def test_existence_is_bayes_over_all_histories(seed, counts):
    """One target's detections and clutter near it; nothing is pruned."""
    rng = np.random.default_rng(seed)
    scans = []
    for tick, n in enumerate(counts):
        positions = rng.normal([10 + 0.5 * tick, 0], 0.4, (n, 2))
        scans.append(positions[np.argsort(positions[:, 0])])
    tracker = make(
        "pmbm",
        gate_share=1 - 1e-12,
        detection=DETECTION,
        clutter_m2=CLUTTER,
        birth_m2=BIRTH,
        traits="unknown",
        hypotheses=10**5,
        least_share=0.0,
        drop=0.0,
    )
    for tick, positions in enumerate(scans):
        tracker.update(boxes(positions, tick, SCORE), None)
    births = [(t, j) for t, positions in enumerate(scans) for j in range(len(positions))]
    mixture = tracker._mixture
    keys = [births[i] for i in mixture.reported.ids.tolist()]
    existences = dict(zip(keys, mixture.existence, strict=True))
    assert existences == pytest.approx(by_enumeration(scans), abs=1e-9)


def changed_identities(tracker, seed):
    """How many of two crossing targets, hard to distinguish for a while, end with another id."""
    rng = np.random.default_rng(seed)
    ids = []
    for k in range(50):
        t = DT * k
        paths = np.array([[10 * t, t - 2.5], [10 * t, 2.5 - t]])
        detected = rng.random(2) < (0.7 if abs(t - 2.5) < 0.6 else 1.0)
        positions = (paths + 0.3 * rng.standard_normal((2, 2)))[detected]
        tracks = tracker.update(boxes(positions, k, SCORE), None)
        distances = np.linalg.norm(tracks.centres[:, None, :2] - paths, axis=-1)
        ids.append(tracks.ids[distances.argmin(axis=0)].tolist())
    return sum(a != b for a, b in zip(ids[12], ids[-1], strict=True))


def test_crossing_targets_keep_identities_that_nearest_neighbours_swap():
    nearest, deferred = (
        sum(changed_identities(make(name, velocity_walk=0.5), seed) for seed in range(16))
        for name in ("gnn", "pmbm")
    )
    assert nearest >= 3
    assert deferred <= nearest / 2


def test_targets_far_from_each_other_have_hypotheses_of_their_own():
    tracker = make("pmbm", traits="unknown")
    rng, centres = np.random.default_rng(0), np.array([[0, 0], [60, 0], [0, 60]])
    for k in range(8):
        # Beside each target a second detection, so that all are in doubt.
        near = centres + rng.normal(0, 0.3, (3, 2))
        tracks = tracker.update(boxes(np.concatenate([centres, near]), k, SCORE), None)
    mixture = tracker._mixture
    assert len(np.unique(mixture.cluster)) >= 3
    for c in np.unique(mixture.cluster):
        assert np.exp(mixture.log_weights[mixture.cluster == c]).sum() == pytest.approx(1)
    assert len(tracks) >= 6


def test_the_one_hypothesis_left_may_lack_the_clusters_target():
    """Two hypotheses, the likelier without the target; its detection is then a new target's."""
    one = np.zeros(1, np.int64)
    hypotheses = Hypotheses(np.zeros(2, np.int64), np.array([-5.0, 0.0]), one, one, one)
    after = continue_all(
        hypotheses, PairCosts(one, one, np.array([-1.0])), Sizes(1, 1, 1), HypothesisLimits(1, 7.0)
    )
    assert after.log_weights.tolist() == [0.0]
    assert [part.tolist() for part in after[2:]] == [[0], [1], [1], [0]]


def all_assignments(costs):
    """Every assignment with its total, cheapest first."""
    n, m = costs.shape
    assignments = []

    def visit(i, total, chosen):
        if i == n:
            assignments.append((total, chosen))
            return
        visit(i + 1, total, (*chosen, -1))
        for j in range(m):
            if costs[i, j] < np.inf and j not in chosen:
                visit(i + 1, total + costs[i, j], (*chosen, j))

    visit(0, 0.0, ())
    return sorted(assignments)


sides = st.tuples(st.integers(1, 4), st.integers(0, 4))
elements = st.one_of(st.just(np.inf), st.floats(-20, 20), st.integers(-2, 2).map(float))
some_costs = sides.flatmap(lambda shape: arrays(float, shape, elements=elements))


@settings(max_examples=100)
@given(some_costs, st.integers(1, 300))
def test_best_assignments_are_those_of_enumeration(costs, count):
    expected = all_assignments(costs)[:count]
    columns, totals = best_assignments(costs, count, np.inf)
    np.testing.assert_allclose(totals, [total for total, _ in expected], atol=1e-9)
    assert len({tuple(row) for row in columns.tolist()}) == len(columns)
    for row, total in zip(columns, totals, strict=True):
        rows = np.flatnonzero(row >= 0)
        assert len(set(row[rows].tolist())) == len(rows)
        assert costs[rows, row[rows]].sum() == pytest.approx(total, abs=1e-9)


@given(some_costs)
def test_the_gap_leaves_out_dearer_assignments_alone(costs):
    expected = all_assignments(costs)
    near = [total for total, _ in expected if total <= expected[0][0] + 5]
    # A total just at the gap may fall on either side.
    if min((abs(t - expected[0][0] - 5) for t, _ in expected), default=1) > 1e-9:
        np.testing.assert_allclose(best_assignments(costs, 1000, 5.0)[1], near, atol=1e-9)


@pytest.mark.parametrize("gap", [np.inf, 6.0])
@pytest.mark.parametrize("seed", range(3))
def test_hypotheses_continue_as_enumeration_of_each_says(seed, gap):
    """Three hypotheses of four targets, which split into components and agree on some."""
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((8, 4)) < 0.5, rng.uniform(-6, 6, (8, 4)), np.inf)
    local = np.array([[0, 2, 4, 6], [1, 2, 4, -1], [0, 3, -1, 7]])
    log_weights = np.log([0.5, 0.3, 0.2])
    expected = {}
    for h, own in enumerate(local):
        each = all_assignments(np.where(own[:, None] >= 0, costs[own], np.inf))
        for total, columns in each:
            if total <= each[0][0] + gap:
                expected[h, columns] = log_weights[h] - total
    parents, columns, weights = continue_hypotheses(local, log_weights, costs, 10**4, gap)
    keys = zip(parents.tolist(), map(tuple, columns.tolist()), strict=True)
    assert len(parents) == len(expected)
    assert dict(zip(keys, weights, strict=True)) == pytest.approx(expected, abs=1e-9)


def test_the_count_is_shared_by_weight():
    local, log_weights = np.array([[0], [1]]), np.log([0.8, 0.2])
    parents, _, _ = continue_hypotheses(local, log_weights, np.zeros((2, 6)), 5, np.inf)
    assert np.bincount(parents).tolist() == [4, 1]
