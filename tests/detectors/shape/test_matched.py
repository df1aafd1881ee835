import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Category
from roadscope.detectors import ClusterDetector, Horizon
from roadscope.detectors.shape import SHAPES, Cluster, vehicles_by_matched_filter

FREE = Horizon(np.empty(0), np.empty(0), np.radians(0.17), None, np.zeros(2))


def cluster(outline, heights=(0.4, 0.7, 1.0, 1.2, 1.4), noise_m=0.02, seed=0):
    """Returns of several beams on an outline, which is given from right to left."""
    rng = np.random.default_rng(seed)
    count, levels = len(outline), len(heights)
    noisy = np.repeat(outline, levels, axis=0) + noise_m * rng.standard_normal((count * levels, 2))
    points = np.column_stack([noisy, np.tile(heights, count)])
    column = np.repeat(np.arange(count), levels)
    ring = np.tile(np.arange(levels), count)
    return Cluster(points, ring, column, noisy.reshape(count, levels, 2).mean(axis=1), np.zeros(2))


def rear_and_flank(centre=(18.0, -4.0), yaw=0.2, length=4.4, width=1.82):
    """A car right ahead: its left flank and its rear, in order of azimuth from right to left."""
    rear = np.column_stack([np.full(12, -length / 2), np.linspace(-width / 2, width / 2, 12)])
    flank = np.column_stack([np.linspace(-length / 2, length / 2, 16), np.full(16, width / 2)])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    points = np.concatenate([rear, flank[1:]]) @ turn.T + centre
    return points[np.argsort(np.arctan2(points[:, 1], points[:, 0]))]


@pytest.mark.parametrize("yaw", [0.0, 0.2, 0.5])
def test_finds_a_car(yaw):
    (car,) = vehicles_by_matched_filter(cluster(rear_and_flank(yaw=yaw)), FREE)
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((18.0, -4.0), abs=0.15)
    assert car.yaw == pytest.approx(yaw, abs=np.radians(1.5))
    assert car.size[:2] == pytest.approx((4.4, 1.82), abs=0.25)
    assert car.residual_m < 0.1


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(-0.15, 0.6))
def test_order_of_returns_changes_nothing(seed, yaw):
    given_ = cluster(rear_and_flank(yaw=yaw), seed=seed)
    rows = np.random.default_rng(seed).permutation(len(given_.points))
    mixed = Cluster(
        given_.points[rows], given_.ring[rows], given_.column[rows], given_.outline, given_.origin
    )
    (one,), (other,) = (vehicles_by_matched_filter(c, FREE) for c in (given_, mixed))
    assert one.centre == pytest.approx(other.centre, abs=1e-6)
    assert one.yaw == pytest.approx(other.yaw, abs=1e-6)


def test_a_person_is_left_to_the_rectangle():
    angles = np.linspace(-1.2, 1.2, 7)
    round_ = np.column_stack([8.0 - 0.25 * np.cos(angles), 1.0 + 0.25 * np.sin(angles)])
    person = cluster(round_, heights=np.linspace(0.2, 1.7, 9))
    found = vehicles_by_matched_filter(person, FREE)
    assert found == SHAPES["rectangle"](person, FREE)


def test_too_large_and_too_small_clusters_show_nobody():
    wall = np.column_stack([np.full(80, 20.0), np.linspace(-20, 20, 80)])
    assert vehicles_by_matched_filter(cluster(wall), FREE) == []
    assert vehicles_by_matched_filter(cluster(np.array([[9.0, 0.0]]), heights=(1.0,)), FREE) == []


def test_is_a_shape_by_name_with_its_option():
    assert SHAPES["matched-filter"] is vehicles_by_matched_filter
    ClusterDetector(shape="matched-filter", sigma_m=0.1)
    with pytest.raises(ValueError, match="sigma_m"):
        vehicles_by_matched_filter(cluster(rear_and_flank()), FREE, sigma_m=-1.0)
