import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.benchmarks.metrics.average_precision import average_precision
from roadscope.benchmarks.metrics.matching import Pairing


def pairing(distances, eligible=None) -> Pairing:
    distances = np.array(distances, float)
    n, m = distances.shape
    return Pairing(
        distances, np.ones(m, bool) if eligible is None else np.array(eligible), np.ones(n, bool)
    )


def ap(distances, scores, eligible=None) -> float:
    return average_precision([pairing(distances, eligible)], [np.array(scores)], 2.0).value


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
    score = average_precision([pairing(np.empty((2, 0)))], [np.ones(2)], 2.0)
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
