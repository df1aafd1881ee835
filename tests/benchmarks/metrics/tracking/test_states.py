from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from toy_boxes import tracks, truth

from roadscope.benchmarks.metrics.tracking import (
    FrameRows,
    Nees,
    StateErrors,
    chi_square,
    nees,
    state_errors,
)

FIRST = np.array([0])


def errors(
    yaw: float = 0.0, covariance: np.ndarray | None = None, speed_m_s: float = 10.0
) -> StateErrors:
    """One track 0.6 m to the right, 5 m/s too fast."""
    reported_tracks = tracks([[10.0, 0.6]], [7], velocities=np.array([[13.0, 4.0]]))
    reported_tracks = replace(reported_tracks, yaws=np.array([yaw]))
    if covariance is not None:
        reported_tracks = replace(reported_tracks, covariances=covariance[None])
    there = truth([[10.0, 0.0]], velocities=np.array([[speed_m_s, 0.0]]))
    return state_errors([reported_tracks], [there], [FrameRows(FIRST, FIRST)])


def test_by_hand() -> None:
    state = errors(yaw=0.3)
    assert state.positions == pytest.approx(np.array([[0.0, 0.6]]))
    assert state.velocities == pytest.approx(np.array([[3.0, 4.0]]))
    assert state.headings == pytest.approx([0.3])


def test_headings_are_errors_around_the_circle() -> None:
    assert errors(yaw=2 * math.pi - 0.2).headings == pytest.approx([-0.2])
    assert errors(yaw=math.pi - 0.1).reversed.tolist() == [True]
    assert errors(yaw=0.1).reversed.tolist() == [False]


def test_of_standing_objects_front_and_rear_are_the_same() -> None:
    standing = errors(yaw=math.pi - 0.1, speed_m_s=0.9)
    assert standing.headings == pytest.approx([-0.1])
    assert (standing.moving.tolist(), standing.reversed.tolist()) == ([False], [False])
    assert errors(yaw=1.5, speed_m_s=0.0).headings == pytest.approx([1.5])
    assert errors(yaw=math.pi - 0.1, speed_m_s=1.1).moving.tolist() == [True]


def test_no_pairs_no_errors() -> None:
    no_errors = state_errors([], [], [])
    assert len(no_errors) == 0
    assert math.isnan(nees(no_errors).mean)
    assert math.isnan(nees(no_errors).inside)
    assert nees(no_errors).band() == (0.0, 0.0)


def test_nees_by_hand() -> None:
    covariance = np.diag([1.0, 0.09, 9.0, 16.0])
    assert nees(errors(covariance=covariance)).values == pytest.approx([4.0])
    whole = nees(errors(covariance=covariance), velocity=True)
    assert whole.values == pytest.approx([4.0 + 1.0 + 1.0])
    assert (nees(errors()).freedom, whole.freedom) == (2, 4)


def test_what_is_no_covariance_is_left_out() -> None:
    assert len(nees(errors(covariance=np.zeros((4, 4))))) == 0
    assert len(nees(errors(covariance=np.diag([1.0, 1.0, 0.0, 1.0])), velocity=True)) == 0
    assert len(nees(errors(covariance=np.diag([1.0, 1.0, 0.0, 1.0])))) == 1


def drawn(n: int, scale: float) -> StateErrors:
    """Errors drawn from covariances of any shape, which claim scale times the variance."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(n, 4, 4))
    draws = np.einsum("kij,kj->ki", roots, rng.normal(size=(n, 4)))
    claimed = scale * roots @ roots.transpose(0, 2, 1)
    return StateErrors(draws[:, :2], draws[:, 2:], np.zeros(n), np.zeros(n, bool), claimed)


@pytest.mark.parametrize("velocity", [False, True])
def test_consistent_errors_lie_in_the_band(velocity) -> None:
    statistic = nees(drawn(4000, 1.0), velocity=velocity)
    low, high = statistic.band()
    assert low < statistic.mean < high
    assert statistic.inside == pytest.approx(0.95, abs=0.015)
    sure = nees(drawn(4000, 0.5), velocity=velocity)
    assert sure.mean == pytest.approx(2 * statistic.mean)
    assert sure.mean > sure.band()[1]
    modest = nees(drawn(4000, 2.0), velocity=velocity)
    assert modest.mean < modest.band()[0]


@pytest.mark.parametrize("freedom", [1, 2, 4, 800])
@pytest.mark.parametrize("probability", [0.025, 0.5, 0.95])
def test_quantiles_as_scipy_has_them(freedom, probability) -> None:
    assert chi_square(probability, freedom) == pytest.approx(chi2.ppf(probability, freedom))
    assert Nees(np.zeros(1), freedom).band()[0] == pytest.approx(chi2.ppf(0.025, freedom))


def test_values_that_go_together_widen_the_band() -> None:
    statistic = nees(drawn(4000, 1.2))
    assert not statistic.in_band(4000)
    assert statistic.in_band(50)
    assert not nees(drawn(4000, 8.0)).in_band(50)
    assert not nees(drawn(0, 1.0)).in_band(0)
    assert statistic.band(independent=4000) == statistic.band()
