import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Category
from roadscope.detectors import Horizon
from roadscope.detectors.shape import SHAPES, Cluster, vehicles_by_body, vehicles_by_l_shape

FREE = Horizon(np.empty(0), np.empty(0), np.radians(0.17), None, np.zeros(2))
HEIGHTS = (0.4, 0.7, 1.0, 1.2, 1.4)


def cluster(outline, noise_m=0.02, seed=0):
    """Returns of five beams on an outline."""
    rng = np.random.default_rng(seed)
    outline = outline[np.argsort(np.arctan2(outline[:, 1], outline[:, 0]))]
    noisy = np.repeat(outline, 5, axis=0) + noise_m * rng.standard_normal((5 * len(outline), 2))
    points = np.column_stack([noisy, np.tile(HEIGHTS, len(outline))])
    column = np.repeat(np.arange(len(outline)), 5)
    means = noisy.reshape(-1, 5, 2).mean(axis=1)
    return Cluster(points, np.tile(np.arange(5), len(outline)), column, means, np.zeros(2))


def rear_and_flank(centre, yaw, length=4.5, width=1.82):
    rear = np.column_stack([np.full(20, -length / 2), np.linspace(-width / 2, width / 2, 20)])
    flank = np.column_stack([np.linspace(-length / 2, length / 2, 25), np.full(25, width / 2)])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.concatenate([rear, flank[1:]]) @ turn.T + centre


@pytest.mark.parametrize("yaw", [0.0, 0.2, 0.5])
def test_finds_a_car(yaw):
    (car,) = vehicles_by_body(cluster(rear_and_flank((18.0, -4.0), yaw)), FREE)
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((18.0, -4.0), abs=0.12)
    assert car.yaw == pytest.approx(yaw, abs=np.radians(1.5))
    assert car.size[:2] == pytest.approx((4.5, 1.82), abs=0.2)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.floats(-0.4, 0.6))
def test_order_of_returns_changes_nothing(seed, yaw):
    one = cluster(rear_and_flank((18.0, -4.0), yaw), seed=seed)
    rows = np.random.default_rng(seed).permutation(len(one.points))
    mixed = Cluster(one.points[rows], one.ring[rows], one.column[rows], one.outline, one.origin)
    assert vehicles_by_body(one, FREE)[0].centre == pytest.approx(
        vehicles_by_body(mixed, FREE)[0].centre, abs=1e-6
    )


def test_free_sight_past_a_rear_says_how_wide_the_car_is():
    rear = rear_and_flank((20.0, 0.0), 0.0)[:20]
    (car,) = vehicles_by_body(cluster(rear), FREE)
    assert car.centre == pytest.approx((20.0, 0.0), abs=0.45)
    assert abs(car.yaw) < np.radians(4.0)


def test_two_columns_are_left_to_the_l_shape():
    given_ = cluster(np.array([[12.0, 2.0], [12.0, 2.4]]))
    assert vehicles_by_body(given_, FREE) == vehicles_by_l_shape(given_, FREE)


def test_is_registered():
    assert SHAPES["body"] is vehicles_by_body
