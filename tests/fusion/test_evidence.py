import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.fusion import (
    UNDECIDED,
    FullConflictError,
    combine,
    combine_or_keep,
    conflict,
    decide,
)

PEDESTRIAN, CAR = 0, 1


def literal(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Eq. 6 over focal sets, as printed."""
    classes = len(first) - 1
    sets = [frozenset({c}) for c in range(classes)] + [frozenset(range(classes))]
    joined = dict.fromkeys(sets, 0.0)
    k = 0.0
    for (a, ma), (b, mb) in itertools.product(
        zip(sets, first, strict=True), zip(sets, second, strict=True)
    ):
        if a & b:
            joined[a & b] += ma * mb
        else:
            k += ma * mb
    return np.array([joined[s] / (1 - k) for s in sets])


def masses(classes: int) -> st.SearchStrategy[np.ndarray]:
    return st.lists(st.floats(0.01, 1.0), min_size=classes + 1, max_size=classes + 1).map(
        lambda v: np.array(v) / np.sum(v)
    )


@given(st.integers(2, 6).flatmap(lambda n: st.tuples(masses(n), masses(n), masses(n))))
@settings(max_examples=100)
def test_the_closed_form_is_the_rule(given_masses: tuple[np.ndarray, ...]) -> None:
    a, b, c = given_masses
    assert np.allclose(combine(a, b), literal(a, b), atol=1e-12)
    assert np.allclose(combine(a, b), combine(b, a))
    assert np.allclose(combine(combine(a, b), c), combine(a, combine(b, c)))
    nothing = np.eye(len(a))[-1]
    assert np.allclose(combine(a, nothing), a)
    assert conflict(a, b) == pytest.approx(
        sum(a[i] * b[j] for i in range(len(a) - 1) for j in range(len(a) - 1) if i != j)
    )


def test_it_is_the_rule_of_another_library() -> None:
    pyds = pytest.importorskip("pyds", reason="py_dempster_shafer is not installed")
    if not hasattr(pyds, "MassFunction"):
        pytest.skip("another package that is called pyds is installed")
    rng = np.random.default_rng(0)
    for classes in (2, 3, 5):
        sets = [frozenset({c}) for c in range(classes)] + [frozenset(range(classes))]
        for a, b in rng.dirichlet(np.ones(classes + 1), (20, 2)):
            one, other = (pyds.MassFunction(dict(zip(sets, m, strict=True))) for m in (a, b))
            theirs = one & other
            assert np.allclose(combine(a, b), [theirs[s] for s in sets], atol=1e-12)
            # Theirs is the logarithm of what is left to agree, its sign changed.
            assert one.conflict(other) == pytest.approx(-np.log(1 - conflict(a, b)))


def test_table_1_of_li_2021() -> None:
    fused = combine([0.612, 0.302, 0.086], [0.865, 0.122, 0.013])
    # Printed to three digits of inputs that were rounded to three themselves.
    assert np.allclose(fused, [0.920, 0.077, 0.002], atol=0.0015)


def test_the_decision_column_of_table_1() -> None:
    rows = [
        [0.612, 0.302, 0.086],
        [0.865, 0.122, 0.013],
        [0.920, 0.077, 0.003],
        [0.253, 0.700, 0.047],
        [0.171, 0.812, 0.017],
        [0.082, 0.917, 0.001],
    ]
    decided = [UNDECIDED, PEDESTRIAN, PEDESTRIAN, UNDECIDED, UNDECIDED, CAR]
    assert decide(np.array(rows)).tolist() == decided


def test_rows_are_combined_one_by_one() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.dirichlet(np.ones(4), (2, 5, 3))
    together = combine(a, b)
    assert np.allclose(together[2, 1], combine(a[2, 1], b[2, 1]))
    assert np.allclose(together.sum(-1), 1)


def test_full_conflict_has_a_name() -> None:
    with pytest.raises(FullConflictError, match=r"row \[1\]"):
        combine([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0]], [[0.5, 0.5, 0.0], [0.0, 1.0, 0.0]])

    with pytest.raises(FullConflictError, match="between the masses: no class"):
        combine([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


def test_masses_on_different_classes_are_refused() -> None:
    for rule in (combine, conflict):
        with pytest.raises(ValueError, match="as many classes, got 2 and 3"):
            rule([0.2, 0.2, 0.6], [0.2, 0.2, 0.2, 0.4])


@pytest.mark.parametrize("wrong", [[0.5, 0.6, 0.1], [-0.1, 1.0, 0.1], [1.0], [np.nan, 0.5, 0.5]])
def test_what_is_no_mass_is_refused(wrong: list[float]) -> None:
    with pytest.raises(ValueError, match="masses"):
        combine(wrong, [0.2, 0.2, 0.6])


def test_one_pair_in_full_conflict_leaves_the_others_alone() -> None:
    first = np.array([[1.0, 0.0, 0.0], [0.5, 0.2, 0.3]])
    second = np.array([[0.0, 1.0, 0.0], [0.1, 0.6, 0.3]])
    joined = combine_or_keep(first, second)
    assert joined[0].tolist() == [0.0, 1.0, 0.0]
    np.testing.assert_array_equal(joined[1], combine(first[1], second[1]))
    assert combine_or_keep(first[:0], second[:0]).shape == (0, 3)
