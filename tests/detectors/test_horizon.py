import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import cloud

from roadscope.core import Bounds, wrap_angle
from roadscope.detectors import Cloud, Horizon
from roadscope.detectors.ground import grid_above_ground

VIEW = Bounds(np.radians(-55.0), np.radians(55.0))
NEAR, FAR = (20, 0.5, 4.6, 1.85, 1.5, 0), (40, 0, 4.6, 1.85, 1.5, 0)


def seen_horizon(boxes, **options):
    returns = cloud(boxes, **options)
    return Horizon.of(returns, grid_above_ground(returns), VIEW)


def test_field_of_view_and_step():
    horizon = seen_horizon([NEAR])
    assert np.degrees(horizon.view) == pytest.approx((-55, 55))
    assert np.degrees(horizon.step) == pytest.approx(0.25)
    turn = np.radians(np.arange(180, -180, -0.4))
    horizon = seen_horizon([NEAR], azimuths=turn)
    assert horizon.view is None
    assert np.degrees(horizon.step) == pytest.approx(0.4)


def test_nearest_return_of_each_column():
    horizon = seen_horizon([NEAR, FAR], ground=False)
    assert horizon.ranges[np.abs(horizon.azimuths).argmin()] == pytest.approx(12.7, abs=0.1)
    assert len(horizon.azimuths) == len(np.unique(horizon.azimuths))


def horizon_by_lexsort(returns, standing, view):
    """Sort all returns and look at every azimuth."""
    above = returns.select(standing)
    order = np.lexsort((above.ranges, above.column))
    nearest = order[np.diff(above.column[order], prepend=-1) != 0]
    column, first = np.unique(returns.column, return_index=True)
    turns = np.abs(wrap_angle(np.diff(returns.azimuths[first])))
    step = float(np.median(turns / np.diff(column))) if len(turns) else 0.0
    middle = (view[0] + view[1]) / 2
    off = np.abs(wrap_angle(returns.azimuths - middle)).max(initial=0.0)
    limited = view if off <= view[1] - middle + step else None
    return Horizon(above.azimuths[nearest], above.ranges[nearest], step, limited, returns.origin)


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([20, 110, 350]))
def test_equals_sorting_all_returns(seed, count, field_deg):
    rng = np.random.default_rng(seed)
    column = rng.integers(0, 30, count)
    angle = np.radians(field_deg) * (column / 29 - 0.5) + 0.001 * rng.standard_normal(count)
    reach = rng.integers(3, 9, count)
    points = np.column_stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(count)])
    row = np.arange(count)
    returns = Cloud(points, row, column, row, np.array([0.5, 0.1]))
    standing = rng.random(count) < 0.7
    ours, slow = (of(returns, standing, VIEW) for of in (Horizon.of, horizon_by_lexsort))
    assert np.array_equal(ours.azimuths, slow.azimuths)
    assert np.array_equal(ours.ranges, slow.ranges)
    assert (ours.step, ours.view) == (slow.step, slow.view)


def test_nearer_body_hides_and_farther_does_not():
    horizon = seen_horizon([NEAR, FAR])
    edge = np.arctan2(-0.425, 12.7)
    visible_end = np.array([5 + 32.7, 32.7 * np.tan(edge - np.radians(0.2))])
    assert horizon.hides_beyond(visible_end, 1)
    assert not horizon.hides_beyond(visible_end, -1)
    near_end = np.array([5 + 12.7, -0.4])
    assert not horizon.hides_beyond(near_end, -1)


def test_ends_of_the_view_hide():
    horizon = seen_horizon([NEAR])
    left = np.array([5 + 10 * np.cos(np.radians(54.7)), 10 * np.sin(np.radians(54.7))])
    assert horizon.hides_beyond(left, 1)
    assert not horizon.hides_beyond(left, -1)
    assert horizon.hides_beyond(left * [1, -1], -1)


def test_nothing_hides_nothing():
    assert not seen_horizon([], ground=False).hides_beyond(np.array([20.0, 0.0]), 1)


def test_what_is_hardly_nearer_hides_nothing():
    step = np.radians(0.25)
    for range_m, hides in ((20.1, False), (19.7, False), (19.0, True)):
        horizon = Horizon(np.array([step]), np.array([range_m]), step, None, np.zeros(2))
        assert horizon.hides_beyond(np.array([20.0, 0.0]), 1) == hides


@given(st.integers(0, 2**32 - 1), st.integers(0, 40), st.sampled_from([1, -1]))
def test_beside_means_one_or_two_columns_also_across_the_seam(seed, count, side):
    rng = np.random.default_rng(seed)
    step = np.radians(rng.choice([0.25, 5.0]))
    columns = rng.integers(-20, 20, count)
    middle = rng.choice([0.0, np.pi, -np.pi])
    azimuths = wrap_angle(middle + step * (columns + rng.choice([0, 0.3, 0.5])))
    ranges = rng.choice([19.0, 19.39, 19.5, 30.0], count)
    horizon = Horizon(azimuths, ranges, step, None, np.zeros(2))
    end = 20 * np.array([np.cos(middle), np.sin(middle)])
    offsets = wrap_angle(azimuths - np.arctan2(end[1], end[0])) * side
    beside = (offsets > 0.5 * step) & (offsets < 2.5 * step)
    expected = bool((ranges[beside] < np.hypot(*end) - 0.6).any())
    assert horizon.hides_beyond(end, side) == expected
