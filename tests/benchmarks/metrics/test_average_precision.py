import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.benchmarks.metrics import (
    FALSE_ALARM,
    IGNORED,
    Pairing,
    average_precision,
    match_greedily,
    overlap_precision,
    precision_by_group,
    rank_by_distance,
)


def pairing(distances, eligible=None) -> Pairing:
    distances = np.array(distances, float)
    n, m = distances.shape
    return Pairing(
        distances, np.ones(m, bool) if eligible is None else np.array(eligible), np.ones(n, bool)
    )


def ap(distances, scores, eligible=None) -> float:
    return average_precision([pairing(distances, eligible)], [np.array(scores)], gate_m=2.0).value


def test_all_found_and_nothing_else_is_one() -> None:
    assert ap([[0.0, 9.0], [9.0, 0.0]], [0.2, 0.9]) == 1.0


def test_half_found_first_gives_half() -> None:
    # Precision 1 up to recall 0.5, nothing beyond: 51 of 101 levels.
    assert ap([[0.0, 9.0], [9.0, 9.0]], [0.9, 0.1]) == pytest.approx(51 / 101)


def test_a_false_alarm_that_is_ranked_first_costs_and_one_ranked_last_does_not() -> None:
    assert ap([[0.0], [9.0]], [0.9, 0.1]) == 1.0
    assert ap([[0.0], [9.0]], [0.1, 0.9]) == 0.5


def test_by_hand_with_three_objects() -> None:
    # Ranked: hit, false alarm, hit; the third object is missed. Precision 1 up to recall 1/3,
    # 2/3 up to 2/3: levels 0 to 0.33 (34), then 0.34 to 0.66 (33).
    distances = np.full((3, 3), 9.0)
    distances[0, 0] = distances[2, 1] = 0.0
    assert ap(distances, [0.9, 0.8, 0.7]) == pytest.approx((34 + 33 * 2 / 3) / 101)


def test_the_second_detection_of_an_object_is_a_false_alarm() -> None:
    assert ap([[0.1], [0.0]], [0.9, 0.8]) == 1.0
    assert ap([[0.1, 9.0], [0.0, 9.0], [9.0, 0.0]], [0.9, 0.8, 0.7]) < 1.0


def test_ineligible_objects_do_not_count() -> None:
    assert ap([[9.0, 0.0], [0.0, 9.0]], [0.9, 0.1], eligible=[True, False]) == 1.0


def test_without_objects_there_is_no_value() -> None:
    score = average_precision([pairing(np.empty((2, 0)))], [np.ones(2)], gate_m=2.0)
    assert np.isnan(score.value)
    assert score.n == 0


@given(st.integers(0, 6), st.integers(1, 5), st.integers(0, 2**32 - 1), st.booleans())
@settings(max_examples=60, deadline=None)
def test_the_order_of_detections_does_not_matter(n, m, seed, ties) -> None:
    rng = np.random.default_rng(seed)
    distances = rng.uniform(0, 4, (n, m))
    scores = rng.integers(0, 3, n) / 2 if ties else rng.random(n)
    order = rng.permutation(n)
    assert ap(distances, scores) == ap(distances[order], scores[order])


def slow_match(costs, order, eligible, counted) -> np.ndarray:
    """Return what `match_greedily` does, one detection after the other."""
    fates = np.full(len(order), FALSE_ALARM)
    for row in order:
        for group, hit in ((eligible, True), (~eligible, False)):
            free = np.where(group, costs[row], np.inf)
            if fates[row] == FALSE_ALARM and free.size and np.isfinite(free.min()):
                costs[:, free.argmin()] = np.inf
                fates[row] = free.argmin() if hit else IGNORED
                break
        if fates[row] == FALSE_ALARM and not counted[row]:
            fates[row] = IGNORED
    return fates


@given(st.integers(0, 8), st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_detections_are_matched_one_after_the_other(n, m, seed) -> None:
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((n, m)) < 0.5, rng.integers(0, 4, (n, m)) / 4, np.inf)
    eligible, counted = rng.random(m) < 0.6, rng.random(n) < 0.7
    order = rng.permutation(n)
    expected = slow_match(costs.copy(), order, eligible, counted)
    matched = match_greedily(costs, order, eligible=eligible, counted=counted)
    assert matched.tolist() == expected.tolist()


@given(st.integers(1, 300), st.floats(0.05, 0.95), st.integers(0, 2**32 - 1), st.booleans())
def test_as_scikit_learn_has_it_up_to_interpolation(n, share, seed, ties) -> None:
    """With every object found, the curve is that of a binary classifier's scores.

    Ours is raised to the best precision at higher recall and read at 101 levels; without the
    raising (precision that never rises with recall) both differ by the reading alone.
    """
    rng = np.random.default_rng(seed)
    right = rng.random(n) < share
    right[0] = True
    scores = rng.integers(0, 20, n) / 20 if ties else rng.random(n)
    distances = np.full((n, int(right.sum())), 9.0)
    distances[np.flatnonzero(right), np.arange(right.sum())] = 0.0
    from sklearn.metrics import average_precision_score

    theirs = average_precision_score(right, scores)
    ours = ap(distances, scores)
    assert ours >= theirs - 0.011
    assert ours == pytest.approx(raised_average_precision(right, scores), abs=0.011)


def raised_average_precision(right, scores) -> float:
    """Return scikit-learn's sum over steps of recall, each at the best precision from there on."""
    from sklearn.metrics import precision_recall_curve

    precision, recall, _ = precision_recall_curve(right, scores)
    best = np.maximum.accumulate(precision)
    return float(-(np.diff(recall) * best[:-1]).sum())


def test_overlap_below_the_threshold_is_no_hit() -> None:
    frame = pairing([[0.1, 9.0], [9.0, 0.1]])
    shares = [np.array([[0.6, 0.0], [0.0, 0.8]])]
    scores = [np.array([0.9, 0.5])]
    assert overlap_precision([frame], shares, scores, least_iou=0.5, gate_m=2.0).value == 1.0
    strict = overlap_precision([frame], shares, scores, least_iou=0.7, gate_m=2.0)
    assert strict.value == pytest.approx(51 * 0.5 / 101)


def episode(seed: int, frames: int = 5) -> tuple[list[Pairing], list[np.ndarray]]:
    rng = np.random.default_rng(seed)
    sizes = rng.integers(0, 6, (frames, 2)).tolist()
    pairings = [
        Pairing(rng.uniform(0, 6, (n, m)), rng.random(m) < 0.8, rng.random(n) < 0.9)
        for n, m in sizes
    ]
    return pairings, [rng.random(n) for n, _ in sizes]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_one_group_of_all_is_the_whole(seed) -> None:
    pairings, scores = episode(seed)
    ranked = rank_by_distance(pairings, scores, gate_m=2.0)
    detections = sum(len(s) for s in scores)
    for own in (None, np.full(detections, 1)):
        groups = np.full(ranked.object_count, 1)
        empty, whole = precision_by_group(ranked, groups, own, count=2)
        assert np.isnan(empty)
        expected = average_precision(pairings, scores, gate_m=2.0).value
        np.testing.assert_equal(whole, expected)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_a_group_is_what_is_left_without_the_objects_and_detections_of_others(seed) -> None:
    pairings, scores = episode(seed)
    ranked = rank_by_distance(pairings, scores, gate_m=2.0)
    rng = np.random.default_rng(seed)
    groups = rng.integers(0, 3, ranked.object_count)
    own = rng.integers(0, 3, sum(len(s) for s in scores))
    separate_precisions = precision_by_group(ranked, groups, own, count=3)
    shared = precision_by_group(ranked, groups, None, count=3)
    alone = np.full((2, 3), np.nan)
    for group in range(3):
        mine = [
            k
            for k in range(len(ranked.detections))
            if ranked.objects[k] < 0 or groups[ranked.objects[k]] == group
        ]
        near = [k for k in mine if ranked.objects[k] >= 0 or own[ranked.detections[k]] == group]
        for row, rows_of_group in enumerate((near, mine)):
            table = np.full((len(rows_of_group), int((groups == group).sum())), 9.0)
            hits = [i for i, k in enumerate(rows_of_group) if ranked.objects[k] >= 0]
            table[hits, range(len(hits))] = 0.0
            alone[row, group] = ap(table, ranked.scores[rows_of_group])
    np.testing.assert_allclose([separate_precisions, shared], alone)
    assert not (shared > separate_precisions).any()
