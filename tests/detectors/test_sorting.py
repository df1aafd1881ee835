import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.detectors import median_of, order_by, order_within, starts_of

sizes = st.integers(0, 300)


@given(
    sizes.flatmap(lambda n: arrays(np.int64, n, elements=st.integers(-9, 9)))
    | sizes.flatmap(lambda n: arrays(np.int64, n, elements=st.integers(-(2**40), 2**40)))
)
def test_order_by_is_a_stable_sort(values):
    assert np.array_equal(order_by(values), np.argsort(values, kind="stable"))


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.int64])
def test_extremes_of_every_type(dtype):
    values = np.array([np.iinfo(dtype).max, 0, np.iinfo(dtype).min // 2, 0], dtype)
    assert order_by(values).tolist() == [2, 1, 3, 0]


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 5, 90]), st.sampled_from([2, 1000]))
def test_order_within_sorts_each_group(seed, groups, distinct):
    rng = np.random.default_rng(seed)
    group = np.sort(rng.integers(0, groups, 300))
    values = rng.integers(0, distinct, 300).astype(float)
    order = order_within(values, starts_of(group))
    assert np.array_equal(order, np.lexsort((np.arange(300), values, group)))


@pytest.mark.parametrize("values", [np.arange(9.0), -np.arange(9.0), np.zeros(9)])
def test_sorted_and_reversed_groups(values):
    assert np.array_equal(order_within(values, np.array([0, 9])), np.argsort(values, kind="stable"))


def test_starts():
    assert starts_of(np.array([4, 4, 2, 7, 7, 7])).tolist() == [0, 2, 3, 6]
    assert starts_of(np.empty(0)).tolist() == [0]


@given(
    arrays(
        np.float64,
        st.integers(1, 300),
        elements=st.floats(-1e6, 1e6) | st.floats(0, 1e-300) | st.sampled_from([0.0, 0.1, 8e307]),
    )
)
def test_median_to_the_last_bit(values):
    assert median_of(values) == np.median(values)
