import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import spearmanr

from roadscope.benchmarks.results import BoardAgreement, spearman

VALUES = st.lists(st.integers(-5, 5), min_size=3, max_size=12)


@given(VALUES, st.integers(0, 100))
def test_it_is_scipys(ones, seed):
    others = np.random.default_rng(seed).integers(-3, 3, len(ones)).tolist()
    rho = spearman(ones, others)
    if len(set(ones)) > 1 and len(set(others)) > 1:
        assert rho == pytest.approx(spearmanr(ones, others).statistic, abs=1e-12)
    else:
        assert math.isnan(rho)


def test_ranks_and_not_values_count():
    assert spearman([1, 2, 3, 4], [1, 10, 100, 1000]) == pytest.approx(1)
    assert spearman([1, 2, 3], [3, 2, -8]) == pytest.approx(-1)
    with pytest.raises(ValueError, match="size 3"):
        spearman([1, 2], [1, 2, 3])


def test_entries_on_both_boards_are_compared():
    ours = {"a": 0.5, "b": 0.6, "c": 0.7, "only here": 1.0, "failed": math.nan}
    real = {"c": 70.0, "b": 60.0, "a": 65.0, "failed": 1.0, "only there": 2.0}
    agreement = BoardAgreement.of("kitti car", "quick v1", real, ours)
    assert agreement.entries == ("a", "b", "c")
    assert agreement.rho == pytest.approx(0.5)


def of_figures(ones, others):
    names = [str(k) for k in range(len(ones))]
    figures = (dict(zip(names, each, strict=True)) for each in (ones, others))
    return BoardAgreement.of("kitti car", "quick v1", *figures)


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_intervals_hold_the_correlation_of_all_entries_nineteen_times_in_twenty(correlation):
    truth = 6 / np.pi * np.arcsin(correlation / 2)  # Spearman's of normal values
    normal = np.random.default_rng(0).normal(size=(1000, 2, 16))
    other = correlation * normal[:, 0] + np.sqrt(1 - correlation**2) * normal[:, 1]
    intervals = [of_figures(*pair).interval for pair in zip(normal[:, 0], other, strict=True)]
    assert 0.93 < np.mean([low <= truth <= high for low, high in intervals]) < 0.97


def test_where_nothing_varies_there_is_no_interval():
    assert of_figures([1, 2, 3], [1, 3, 2]).interval is None
    assert of_figures([1, 2, 3, 4], [1, 2, 3, 5]).interval is None
    low, high = of_figures([1, 2, 3, 4], [1, 2, 4, 3]).interval
    assert -1 < low < 0.8 < high < 1


@pytest.mark.parametrize("figures", [{"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 1.0, "c": 1.0}])
def test_too_little_to_compare_is_no_agreement(figures):
    others = {"a": 1.0, "b": 2.0, "c": 3.0}
    assert BoardAgreement.of("kitti car", "quick v1", others, figures) is None
