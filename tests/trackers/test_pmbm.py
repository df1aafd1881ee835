import itertools
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from roadscope.core import Detections, TrackState
from roadscope.trackers.gnn import GnnTracker
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.pmbm import PmbmTracker
from roadscope.trackers.pmbm_hypotheses import all_continued

DT, SCORE, DETECTION, CLUTTER, BIRTH = 0.1, 0.7, 0.9, 1e-2, 1e-3


def seen(tick, places, score=SCORE):
    places = np.asarray(places, float).reshape(-1, 2)
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.75)]), np.tile([4.6, 1.85, 1.5], (n, 1)),
        np.zeros(n), np.zeros(n, int), np.full(n, score), "ego", DT * tick,
    )  # fmt: skip


@cache
def history_weight(history, ticks):
    """Weight of a target's detections, (tick, place) each, and its part in which it still exists.

    Its states, visible, hidden and gone, are gone through with their generator's exponential.
    """
    kalman, ratio = PlaceFilter(motion=ConstantVelocity(2.0)), SCORE / (1 - SCORE)
    F, Q = kalman.motion.jacobian(None, DT), kalman.motion.noise(None, DT)
    chain = expm(DT * np.array([[-0.1, 0.1, 0], [1, -1, 0], [0, 0, 0]]))
    alive = np.exp(-DT / 30)
    step = chain * alive
    step[:, 2] += 1 - alive
    step[2] = [0, 0, 1]
    history = {tick: np.array(place) for tick, place in history}
    born = min(history)
    first = kalman.started(seen(0, [history[born]]))
    mean, covariance = first.means[0], first.covariances[0]
    state = np.array([BIRTH * DETECTION * ratio, 0, 0])
    for tick in range(born + 1, ticks):
        mean, covariance, state = F @ mean, F @ covariance @ F.T + Q, state @ step
        if tick not in history:
            state = state * [1 - DETECTION, 1, 1]
            continue
        S = covariance[:2, :2] + kalman.R
        apart = history[tick] - mean[:2]
        squared = apart @ np.linalg.solve(S, apart)
        density = np.exp(-squared / 2) / (2 * np.pi * np.sqrt(np.linalg.det(S)))
        state = state * [DETECTION * density * ratio, 0, 0]
        K = covariance[:, :2] @ np.linalg.inv(S)
        mean = mean + K @ apart
        covariance = covariance - K @ S @ K.T
    return state.sum(), state[:2].sum()


def by_enumeration(scans):
    """Existence of the target of each first detection, by all labellings of all detections."""
    total, there = 0.0, {}

    def visit(tick, weight, histories):
        nonlocal total
        if tick == len(scans):
            ends = {k: history_weight(tuple(h), len(scans)) for k, h in histories.items()}
            weight *= np.prod([w for w, _ in ends.values()])
            total += weight
            for key, (whole, part) in ends.items():
                there[key] = there.get(key, 0.0) + weight * part / whole
            return
        options = [None, "new", *histories]
        for chosen in itertools.product(options, repeat=len(scans[tick])):
            old = [c for c in chosen if c not in (None, "new")]
            if len(set(old)) < len(old):
                continue
            after = {key: list(h) for key, h in histories.items()}
            for j, (place, c) in enumerate(zip(scans[tick], chosen, strict=True)):
                if c is not None:
                    key = (tick, j) if c == "new" else c
                    after.setdefault(key, []).append((tick, tuple(place.tolist())))
            visit(tick + 1, weight * CLUTTER ** chosen.count(None), after)

    visit(0, 1.0, {})
    return {key: part / total for key, part in there.items()}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("counts", [(1, 1, 1, 1), (1, 2, 0, 1), (2, 2, 1)])
def test_equals_bayes_over_all_histories(seed, counts):
    """One target's detections and clutter near it; nothing is pruned."""
    rng = np.random.default_rng(seed)
    scans = []
    for tick, n in enumerate(counts):
        places = rng.normal([10 + 0.5 * tick, 0], 0.4, (n, 2))
        scans.append(places[np.argsort(places[:, 0])])
    tracker = PmbmTracker(
        gate_share=1 - 1e-12, detection=DETECTION, clutter_m2=CLUTTER, birth_m2=BIRTH,
        traits="unknown",
        hypotheses=10**5, least_share=0.0, drop=0.0,
    )  # fmt: skip
    for tick, places in enumerate(scans):
        tracker.update(seen(tick, places), None)
    ids = [(t, j) for t, places in enumerate(scans) for j in range(len(places))]
    mixture = tracker._mixture
    found = dict(zip([ids[i] for i in mixture.roster.ids.tolist()], mixture.existence, strict=True))
    expected = by_enumeration(scans)
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, abs=1e-9)


def test_clutter_alone_confirms_nothing():
    rng = np.random.default_rng(5)
    tracker = PmbmTracker(traits="unknown")
    for k in range(60):
        places = rng.uniform(-50, 50, (rng.poisson(1.0), 2))
        states = tracker.update(seen(k, places, 0.5), None).states
        assert (states == TrackState.TENTATIVE).all()


def test_existence_rises_with_hits_and_falls_with_misses():
    tracker = PmbmTracker(traits="unknown")
    for k in range(6):
        tracks = tracker.update(seen(k, [(20 + k, 0)], 0.5), None)
    assert tracks.scores[0] > 0.99
    assert tracks.states.tolist() == [TrackState.CONFIRMED]
    falling = []
    for k in range(6, 300):
        tracks = tracker.update(seen(k, []), None)
        if not len(tracks):
            break
        falling.append(tracks.scores[0])
    assert (np.diff(falling) < 0).all()
    assert len(falling) > 12
    assert len(tracker._mixture.members) == 0


def swaps(tracker, seed):
    """How many of two crossing targets, hard to tell apart for a while, end with another id."""
    rng = np.random.default_rng(seed)
    owners = []
    for k in range(50):
        t = DT * k
        paths = np.array([[10 * t, t - 2.5], [10 * t, 2.5 - t]])
        kept = rng.random(2) < (0.7 if abs(t - 2.5) < 0.6 else 1.0)
        tracks = tracker.update(seen(k, (paths + 0.3 * rng.standard_normal((2, 2)))[kept]), None)
        apart = np.linalg.norm(tracks.centres[:, None, :2] - paths, axis=-1)
        owners.append(tracks.ids[apart.argmin(axis=0)].tolist())
    return sum(a != b for a, b in zip(owners[12], owners[-1], strict=True))


def test_crossing_targets_are_told_apart_where_nearest_neighbours_are_not():
    greedy, deferred = 0, 0
    for seed in range(16):
        greedy += swaps(GnnTracker(velocity_walk=0.5), seed)
        deferred += swaps(PmbmTracker(velocity_walk=0.5), seed)
    assert greedy >= 3
    assert deferred <= greedy / 2


def test_targets_far_apart_have_hypotheses_of_their_own():
    tracker = PmbmTracker(traits="unknown")
    rng = np.random.default_rng(0)
    centres = np.array([[0, 0], [60, 0], [0, 60]])
    for k in range(8):
        # Beside each target a second detection, so that all are in doubt.
        near = centres + rng.normal(0, 0.3, (3, 2))
        tracks = tracker.update(seen(k, np.concatenate([centres, near])), None)
    mixture = tracker._mixture
    assert len(np.unique(mixture.cluster)) >= 3
    for c in np.unique(mixture.cluster):
        rows = mixture.cluster == c
        assert np.exp(mixture.log_weights[rows]).sum() == pytest.approx(1)
    assert len(tracks) >= 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"hypotheses": 0}, "hypotheses must be 1 or more"),
        ({"birth_m2": 0.0}, "birth_m2 must be positive"),
        ({"least_share": 2.0}, "least_share must lie in 0 to 1"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        PmbmTracker(**arguments)


def test_the_one_hypothesis_left_may_lack_the_clusters_target():
    """Two hypotheses, the likelier without the target; its detection is then a new target's."""
    cluster, log_weights = np.zeros(2, np.int64), np.array([-5.0, 0.0])
    one = np.zeros(1, np.int64)
    near = one, one, np.array([-1.0])
    _, weights, entries = all_continued(
        (cluster, log_weights), (one, one, one), near, (1, 1, 1), (1, 7.0)
    )
    assert weights.tolist() == [0.0]
    assert [part.tolist() for part in entries] == [[0], [1], [1], [0]]
