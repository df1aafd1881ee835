import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.trackers.association import associate_nearest

places = st.integers(0, 7).flatmap(
    lambda n: arrays(float, (n, 2), elements=st.integers(0, 12).map(float))
)


def pairs_one_by_one(targets, predictions, gate):
    """Take the least difference of all that are free, again and again."""
    pairs = []
    while True:
        free = [
            (np.hypot(*(t - p)), j, i)
            for i, t in enumerate(targets)
            for j, p in enumerate(predictions)
            if i not in [a for a, _ in pairs] and j not in [b for _, b in pairs]
        ]
        free = [row for row in free if row[0] < gate]
        if not free:
            return pairs
        _, j, i = min(free)
        pairs.append((i, j))


@given(places, places, st.sampled_from([0.5, 2.0, 20.0]))
def test_equals_the_slow_way(targets, predictions, gate):
    expected = pairs_one_by_one(targets, predictions, gate)
    assert associate_nearest(targets, predictions, gate) == expected


def test_a_taken_filter_is_barred():
    targets = np.array([[0.0, 0.0], [0.4, 0.0]])
    assert associate_nearest(targets, np.array([[0.5, 0.0]]), 2.0) == [(1, 0)]
    both = np.array([[0.5, 0.0], [1.5, 0.0]])
    assert associate_nearest(targets, both, 2.0) == [(1, 0), (0, 1)]


def test_difference_at_the_gate_is_too_far():
    assert associate_nearest(np.zeros((1, 2)), np.array([[2.0, 0.0]]), 2.0) == []
