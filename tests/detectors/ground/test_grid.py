import numpy as np
import pytest
from toy_lidar import cloud

from roadscope.detectors import Cloud
from roadscope.detectors.ground import cell_spans, grid_above_ground, keep_all

CAR = (25, 0, 4.6, 1.85, 1.5, 0)


@pytest.mark.parametrize("far", [0.0, 1e6])
def test_cell_spans_equal_a_loop(far):
    points = np.random.default_rng(0).uniform(-3, 3, (200, 3))
    points[7, :2] += far
    lowest, highest = cell_spans(points, 0.5)
    cells = np.floor(points[:, :2] / 0.5)
    for point, low, high in zip(cells, lowest, highest, strict=True):
        heights = points[(cells == point).all(axis=1), 2]
        assert (low, high) == (heights.min(), heights.max())


def test_flat_ground_goes_and_the_car_stays():
    returns = cloud([CAR], noise_m=0.03)
    above_ground = grid_above_ground(returns)
    on_car = np.abs(returns.points[:, 0] - CAR[0]) < 2.5
    on_car &= np.abs(returns.points[:, 1]) < 1
    assert not above_ground[~on_car].any()
    assert above_ground[on_car].mean() > 0.9


def test_single_layer_far_away_is_kept_by_its_height():
    returns = cloud([(110, 0, 4.6, 1.85, 1.5, 0)], elevations=(0.0,))
    assert len(returns) > 0
    assert grid_above_ground(returns).all()


def test_low_return_in_a_rising_cell_is_kept_unless_it_is_the_bottom():
    points = np.array([[1.1, 1.1, 0.1], [1.1, 1.2, 0.25], [1.2, 1.1, 0.6], [4.1, 1.1, 0.25]])
    returns = Cloud(points, np.arange(4), np.zeros(4, int), np.arange(4), np.zeros(2))
    assert grid_above_ground(returns).tolist() == [False, True, True, False]


def test_crowns_are_dropped():
    returns = Cloud(
        np.array([[5.0, 0, 1], [5, 0, 4]]),
        np.arange(2),
        np.zeros(2, int),
        np.arange(2),
        np.zeros(2),
    )
    assert grid_above_ground(returns).tolist() == [True, False]
    assert keep_all(returns).all()
