import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from roadscope.benchmarks.metrics import Pairing, assign, centre_distances, match

matrices = hnp.arrays(
    np.float64, hnp.array_shapes(min_dims=2, max_dims=2, max_side=4), elements=st.floats(0, 5)
)


def pairing(distances, eligible=None, counted=None) -> Pairing:
    distances = np.array(distances, float)
    n, m = distances.shape
    return Pairing(
        distances,
        np.ones(m, bool) if eligible is None else np.array(eligible),
        np.ones(n, bool) if counted is None else np.array(counted),
    )


def best_by_search(distances: np.ndarray, gate_m: float) -> tuple[int, float]:
    """Most pairs within the gate, and the least total distance among such pairings."""
    n, m = distances.shape
    best = (0, 0.0)
    small, large = (range(n), range(m)) if n <= m else (range(m), range(n))
    for chosen in itertools.permutations(large, len(small)):
        pairs = zip(small, chosen, strict=True)
        values = [distances[p] if n <= m else distances[p[::-1]] for p in pairs]
        close = [v for v in values if v <= gate_m]
        best = min(best, (-len(close), sum(close)))
    return -best[0], best[1]


@given(matrices)
@settings(max_examples=60, deadline=None)
def test_as_many_pairs_as_possible_then_least_distance(distances) -> None:
    rows, columns = assign(distances, 2.0)
    count, total = best_by_search(distances, 2.0)
    assert len(rows) == count
    assert np.isclose(distances[rows, columns].sum(), total)
    assert len(set(rows)) == len(set(columns)) == count


def test_distances_are_horizontal() -> None:
    assert centre_distances([[0, 0, 5]], [[3, 4, -5]]) == 5.0


def test_the_gate_is_inclusive() -> None:
    assert len(assign(np.array([[2.0]]), 2.0)[0]) == 1
    assert len(assign(np.array([[2.0 + 1e-9]]), 2.0)[0]) == 0


def test_a_detection_of_an_ineligible_object_is_ignored() -> None:
    result = match(pairing([[0.5, 9.0], [9.0, 0.5]], eligible=[True, False]), 2.0)
    assert result.detected.tolist() == [0]
    assert result.ignored.tolist() == [1]
    assert len(result.misses) == len(result.false_alarms) == 0


def test_an_ineligible_object_excuses_one_detection_only() -> None:
    result = match(pairing([[0.5], [0.6]], eligible=[False]), 2.0)
    assert result.ignored.tolist() == [0]
    assert result.false_alarms.tolist() == [1]


def test_eligible_objects_come_first() -> None:
    result = match(pairing([[1.9, 0.1]], eligible=[True, False]), 2.0)
    assert result.truth.tolist() == [0]


def test_nothing_outside_the_range_band_is_a_false_alarm() -> None:
    result = match(pairing([[9.0], [9.0]], counted=[False, True]), 2.0)
    assert result.false_alarms.tolist() == [1]
    assert result.ignored.tolist() == [0]
    assert result.misses.tolist() == [0]


@given(matrices, st.randoms(use_true_random=False))
@settings(max_examples=40, deadline=None)
def test_every_detection_and_every_eligible_object_has_one_fate(distances, random) -> None:
    n, m = distances.shape
    p = pairing(
        distances,
        [random.random() < 0.5 for _ in range(m)],
        [random.random() < 0.5 for _ in range(n)],
    )
    r = match(p, 2.0)
    assert sorted([*r.detected, *r.false_alarms, *r.ignored]) == list(range(n))
    assert sorted([*r.truth, *r.misses]) == np.flatnonzero(p.eligible).tolist()
