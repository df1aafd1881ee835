from itertools import combinations

import numpy as np
import pytest
from dense_costs import candidates
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment
from tracked_scenes import boxes, make

from roadscope.core import Category, Pose, TrackState
from roadscope.trackers import (
    EXACT_LIMIT,
    FOLDER,
    ClutterDensity,
    DetectionModel,
    Existence,
    Gaussians,
    PositionFilter,
    ScoreCalibration,
    TrackerTick,
    association_marginals,
    loopy_marginals,
    mixture_moments,
    one_to_one_pairs,
)

BOTH = pytest.mark.parametrize("kind", ["jpda", "pmbm"])


def marginals(pairs, missed, free, limit, pruned=False):
    """(N, M) marginals of (N, M) weights, 0 where impossible."""
    rows, columns = map(np.ascontiguousarray, np.nonzero(pairs))
    probabilities = np.zeros(pairs.shape)
    probabilities[rows, columns] = association_marginals(
        rows, columns, pairs[rows, columns], missed, free, limit, pruned
    )
    return probabilities


def by_enumeration(pairs, missed, free, pruned=False):
    """Go through every joint event; pruned: of those with the same rows and columns keep one."""
    n, m = pairs.shape
    events = []

    def visit(i, weight, taken):
        if i == n:
            free_ones = [free[j] for j in range(m) if j not in taken.values()]
            events.append((weight * np.prod(free_ones), taken))
            return
        visit(i + 1, weight * missed[i], taken)
        for j in range(m):
            if pairs[i, j] > 0 and j not in taken.values():
                visit(i + 1, weight * pairs[i, j], {**taken, i: j})

    visit(0, 1.0, {})
    if pruned:
        best = {}
        for weight, taken in sorted(events, key=lambda event: event[0]):
            best[frozenset(taken), frozenset(taken.values())] = weight, taken
        events = list(best.values())
    sums = np.zeros((n, m))
    for weight, taken in events:
        for row, column in taken.items():
            sums[row, column] += weight
    return sums / sum(weight for weight, _ in events)


weights = st.one_of(st.just(0.0), st.floats(1e-6, 1e6), st.sampled_from([1e-12, 1.0, 1e12]))
alone = st.one_of(st.floats(1e-3, 10), st.sampled_from([1e-9, 1.0, 1e9]))


@st.composite
def problems(draw):
    n, m = draw(st.integers(0, 5)), draw(st.integers(0, 6))
    return (
        draw(arrays(float, (n, m), elements=weights)),
        draw(arrays(float, n, elements=alone)),
        draw(arrays(float, m, elements=alone)),
    )


@settings(max_examples=150)
@given(problems())
def test_marginals_are_those_of_all_joint_events(problem):
    expected = by_enumeration(*problem) if problem[0].size else problem[0]
    np.testing.assert_allclose(marginals(*problem, np.inf), expected, atol=1e-9)


@settings(max_examples=150)
@given(problems())
def test_pruned_marginals_are_those_of_the_likeliest_permutations(problem):
    pairs, missed, free = problem
    pairs = pairs * np.random.default_rng(0).uniform(0.9, 1.1, pairs.shape)  # no two alike
    expected = by_enumeration(pairs, missed, free, pruned=True) if pairs.size else pairs
    np.testing.assert_allclose(
        marginals(pairs, missed, free, np.inf, pruned=True), expected, atol=1e-9
    )


def by_assignments(pairs, missed, free):
    """Assign each set of rows to each set of columns that is as large, optimally."""
    n, m = pairs.shape
    sums, total = np.zeros((n, m)), 0.0
    for size in range(min(n, m) + 1):
        for rows in map(list, combinations(range(n), size)):
            for columns in map(list, combinations(range(m), size)):
                block = pairs[np.ix_(rows, columns)]
                one, other = linear_sum_assignment(np.log(block), maximize=True)
                weight = block[one, other].prod()
                weight *= np.delete(missed, rows).prod() * np.delete(free, columns).prod()
                total += weight
                sums[np.array(rows, int)[one], np.array(columns, int)[other]] += weight
    return sums / total


@pytest.mark.parametrize(("n", "m"), [(7, 6), pytest.param(9, 9, marks=pytest.mark.slow)])
def test_a_crowd_up_to_the_limit_is_pruned(n, m):
    problem = on_a_line(4, n, m, 2.5)
    assert problem[0].all()
    pruned = marginals(*problem, EXACT_LIMIT, pruned=True)
    np.testing.assert_allclose(pruned, by_assignments(*problem), atol=1e-9)
    assert np.abs(pruned - marginals(*problem, EXACT_LIMIT)).max() > 0.01


@pytest.mark.parametrize(("n", "m", "prunes"), [(9, 9, True), (10, 9, False), (2, 18, True)])
def test_in_a_cluster_beyond_the_limit_all_events_count(n, m, prunes):
    problem = on_a_line(2, n, m, 2.5)
    exact = marginals(*problem, EXACT_LIMIT)
    assert np.array_equal(marginals(*problem, EXACT_LIMIT, pruned=True), exact) != prunes
    if not prunes:
        assert not np.allclose(marginals(*problem, np.inf, pruned=True), exact, atol=1e-3)


@pytest.mark.parametrize("gap_m", [0.5, 0.8])
def test_people_side_by_side_do_not_become_one(gap_m):
    """Two walk next to each other for ten seconds, detected nine times out of ten."""
    distances = {}
    for pruned in (False, True):
        rng, tracker = np.random.default_rng(5), make("jpda", traits="unknown", pruned=pruned)
        gaps_m = []
        for tick in range(100):
            places = np.array([[8 + 0.13 * tick, 0.0], [8 + 0.13 * tick, gap_m]])
            detected = (places + rng.normal(0, 0.1, (2, 2)))[rng.random(2) < 0.9]
            frame = boxes(detected, tick, 0.9, Category.PEDESTRIAN)
            sure = tracker.update(frame, Pose.identity()).sure
            if len(sure) == 2:
                gaps_m.append(abs(np.diff(sure.centres[:, 1])[0]))
        distances[pruned] = np.median(gaps_m)
    assert distances[True] == pytest.approx(gap_m, abs=0.15)
    assert distances[False] < distances[True]


def on_a_line(seed, n, m, span_m):
    """Tracks and detections strewn over a line, those nearer than 3 m possible pairs."""
    rng = np.random.default_rng(seed)
    distances = rng.uniform(0, span_m, (n, 1)) - rng.uniform(0, span_m, m)
    pairs = np.where(np.abs(distances) < 3, 30 * np.exp(-0.5 * distances**2), 0.0)
    return pairs, rng.uniform(0.05, 0.9, n), rng.uniform(0.5, 2, m)


@pytest.mark.parametrize("seed", range(3))
def test_marginals_of_clusters_and_chains(seed):
    problem = on_a_line(seed, 7, 7, 12.0)
    np.testing.assert_allclose(marginals(*problem, np.inf), by_enumeration(*problem), atol=1e-9)


def test_a_track_that_cannot_be_missed():
    pairs = np.array([[2.0, 1.0], [1.0, 0.0]])
    missed, free = np.array([0.0, 1.0]), np.ones(2)
    probabilities = marginals(pairs, missed, free, np.inf)
    np.testing.assert_allclose(probabilities, by_enumeration(pairs, missed, free), atol=1e-12)


def test_a_crowd_of_twelve_has_the_marginals_of_symmetry():
    n = 12
    probabilities = marginals(np.ones((n, n)), np.full(n, 1e-12), np.full(n, 1e-12), EXACT_LIMIT)
    np.testing.assert_allclose(probabilities, 1 / n, atol=1e-9)


def test_rows_and_columns_may_change_places():
    pairs, missed, free = on_a_line(1, 14, 9, 10.0)
    probabilities = marginals(pairs, missed, free, np.inf)
    turned = marginals(np.ascontiguousarray(pairs.T), free, missed, np.inf)
    np.testing.assert_allclose(probabilities, turned.T, atol=1e-12)


def test_a_long_chain_is_exact_and_does_not_overflow():
    n = 200
    pairs = 1e9 * (np.eye(n) + np.eye(n, k=1))
    probabilities = marginals(pairs, np.full(n, 1e-3), np.ones(n), EXACT_LIMIT)
    assert np.array_equal(probabilities, marginals(pairs, np.full(n, 1e-3), np.ones(n), np.inf))
    assert probabilities.sum() == pytest.approx(n, abs=0.1)


@given(st.integers(0, 2**32 - 1))
def test_belief_propagation_is_exact_without_loops(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    pairs = rng.exponential(10, (n, n)) * (np.eye(n) + np.eye(n, k=1))
    missed, free = rng.uniform(0.05, 1, n), rng.uniform(0.5, 2, n)
    probabilities = marginals(pairs, missed, free, np.inf)
    np.testing.assert_allclose(loopy_marginals(pairs, missed, free), probabilities, atol=1e-6)


def test_belief_propagation_has_the_errors_that_its_module_states():
    errors = []
    for seed in range(200):
        problem = on_a_line(seed, 8, 8, 10.0)
        errors.append(np.abs(marginals(*problem, np.inf) - marginals(*problem, 0.0)).max())
    assert 1e-4 < max(errors) < 0.3
    assert np.mean(errors) < 0.06


def test_mixture_moments():
    kalman = PositionFilter()
    belief = Gaussians(np.array([[1.0, 2, 3, 4]]), np.diag([0.5, 0.4, 2, 3])[None])
    positions, shares = np.array([[1.5, 2.2], [0.4, 1.7]]), np.array([[0.5, 0.2]])
    moments = mixture_moments(belief, positions, candidates(shares), kalman.R)
    parts = [belief, *(kalman.corrected(belief, position[None]) for position in positions)]
    weights = np.array([0.3, 0.5, 0.2])
    mean = sum(w * part.means[0] for w, part in zip(weights, parts, strict=True))
    covariance = sum(
        w * (part.covariances[0] + np.outer(part.means[0] - mean, part.means[0] - mean))
        for w, part in zip(weights, parts, strict=True)
    )
    np.testing.assert_allclose(moments.means[0], mean, atol=1e-12)
    np.testing.assert_allclose(moments.covariances[0], covariance, atol=1e-12)


def test_existence_after_two_steps_is_that_after_one():
    model, start = DetectionModel(), Existence(np.array([0.7, 0.1]), np.array([0.1, 0.8]))
    once = model.predicted(start, 0.3)
    twice = model.predicted(model.predicted(start, 0.1), 0.2)
    np.testing.assert_allclose(once.visible, twice.visible, atol=1e-12)
    np.testing.assert_allclose(once.probability, start.probability * np.exp(-0.3 / 30), atol=1e-12)
    late = model.predicted(start, 20.0)
    np.testing.assert_allclose(late.visible / late.hidden, 10.0, rtol=1e-6)


def test_a_miss_says_nothing_of_a_hidden_target():
    visible = Existence(np.array([0.9]), np.array([0.0])).after_miss(0.9)
    hidden = Existence(np.array([0.0]), np.array([0.9])).after_miss(0.9)
    assert visible.probability == pytest.approx(0.09 / 0.19)
    assert hidden.probability == pytest.approx(0.9)


def test_pairs_of_marginals_are_one_to_one():
    beta = candidates(np.array([[0.6, 0.3], [0.35, 0.0]]))
    rows, columns = one_to_one_pairs(beta, np.array([0.05, 0.7]))
    assert (rows.tolist(), columns.tolist()) == ([0], [0])
    rows, columns = one_to_one_pairs(beta, np.array([0.05, 0.01]))
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [1, 0])


@BOTH
def test_existence_rises_with_hits_and_falls_with_misses(kind):
    tracker = make(kind, traits="unknown")
    rising = [tracker.update(boxes([(20 + k, 0)], k, 0.5), None) for k in range(6)]
    scores = [tracks.scores[0] for tracks in rising]
    assert scores[0] < 0.2
    assert scores[-1] > 0.99
    assert [int(tracks.states[0]) for tracks in (rising[0], rising[-1])] == [
        TrackState.TENTATIVE,
        TrackState.CONFIRMED,
    ]
    falling = []
    while len(tracks := tracker.update(boxes([], 6 + len(falling)), None)):
        falling.append(tracks.scores[0])
    assert (np.diff(falling) < 0).all()
    assert 12 < len(falling) < 300


@BOTH
def test_clutter_alone_confirms_nothing(kind):
    rng, tracker = np.random.default_rng(5), make(kind, traits="unknown")
    for k in range(60):
        clutter = boxes(rng.uniform(-50, 50, (rng.poisson(1.0), 2)), k, 0.5)
        assert (tracker.update(clutter, None).states == TrackState.TENTATIVE).all()


def test_higher_scores_are_believed_sooner():
    low, high = (
        make("jpda", traits="unknown").update(boxes([(5, 5)], 0, score), None).scores[0]
        for score in (0.3, 0.9)
    )
    assert low < high
    without = make("jpda", score_weight=0, traits="unknown", clutter_m2=1e-4)
    first = without.update(boxes([(5, 5)], 0, 0.3), None)
    assert first.scores[0] == pytest.approx(0.9e-5 / (0.9e-5 + 1e-4))


@BOTH
def test_in_dense_clutter_a_target_is_confirmed_by_coming_back(kind):
    tracker = make(kind, clutter_m2=2e-3, traits="unknown")
    reported_tracks = [tracker.update(boxes([(20 + 0.5 * k, 0)], k, 0.5), None) for k in range(20)]
    assert reported_tracks[0].scores[0] < 0.02
    assert reported_tracks[-1].ids[reported_tracks[-1].states == TrackState.CONFIRMED].tolist() == [
        0
    ]
    tracker.reset()
    tracker.update(boxes([(20, 0)], 0, 0.5), None)
    assert len(tracker.update(boxes([], 1), None)) == 0


@BOTH
@pytest.mark.parametrize(("a_tick", "most"), [(0.5, 2.2), (8.0, 1.3)])
def test_clutter_density_is_estimated_beside_targets(kind, a_tick, most):
    """Sparse clutter is taken to be denser: it has not been everywhere yet."""
    rng, tracker = np.random.default_rng(0), make(kind, traits="unknown")
    cars = np.array([[8.0 * k, 6.0 * (k % 4)] for k in range(-4, 5)])
    for t in range(150):
        false = rng.uniform(-40, 40, (rng.poisson(a_tick), 2))
        moved = cars + np.array([0.05 * t, 0.0])
        tracker.update(boxes(np.concatenate([moved, false]), t, 0.5), None)
    assert 0.7 < tracker._model.clutter.density_m2 / (a_tick / 80**2) < most


@BOTH
def test_dense_clutter_is_not_confirmed_for_long(kind):
    """As many false detections as real detectors make, with scores that say nothing."""
    rng, confirmed = np.random.default_rng(1), {}
    for clutter_m2 in (None, 1e-4):
        tracker, counts = make(kind, traits="unknown", clutter_m2=clutter_m2), []
        for t in range(120):
            clutter = boxes(rng.uniform(-20, 20, (rng.poisson(8), 2)), t, 0.5)
            counts.append(int((tracker.update(clutter, None).states > 0).sum()))
        confirmed[clutter_m2] = sum(counts[60:])
    assert confirmed[None] < 0.3 * confirmed[1e-4]


def test_the_area_of_clutter_moves_with_the_ego():
    clutter = ClutterDensity()
    for t in range(5):
        tick = TrackerTick.after(None, boxes([(12, 2)], 0), Pose.planar(30.0 * t, 0.0, 0.3))
        clutter.add_area(tick)
    assert clutter.cells == {(1, 0)}


def test_base_rates_are_taken_out_of_scores(tmp_path):
    """Two files of the same detector, one from where hardly anything was right."""
    text = (FOLDER / "unknown.toml").read_text("utf-8")
    tick = TrackerTick.after(None, boxes([(0, 0)], 0, 0.7), None)
    assert ScoreCalibration("unknown").probabilities(tick) == [pytest.approx(0.7)]
    rare = tmp_path / "rare.toml"
    rare.write_text(text.replace("score_offset = 0.0", "score_offset = -3.0"), "utf-8")
    assert 1 / (1 + np.exp(3 - np.log(0.7 / 0.3))) < 0.11
    assert ScoreCalibration(str(rare)).probabilities(tick)[0] > 0.3
