import numpy as np
import pytest
from toy_clusters import FREE, cluster, rear_and_flank

from roadscope.core import Category
from roadscope.detectors import ClusterDetector
from roadscope.detectors.shape import SHAPES, vehicles_by_matched_filter


@pytest.mark.parametrize("yaw", [0.0, 0.2, 0.5])
def test_finds_a_car(yaw):
    (car,) = vehicles_by_matched_filter(cluster(rear_and_flank(yaw)), FREE)
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((18.0, -4.0), abs=0.15)
    assert car.yaw == pytest.approx(yaw, abs=np.radians(1.5))
    assert car.size[:2] == pytest.approx((4.5, 1.82), abs=0.25)
    assert car.residual_m < 0.1


def test_a_person_is_left_to_the_rectangle():
    angles = np.linspace(-1.2, 1.2, 7)
    round_ = np.column_stack([8.0 - 0.25 * np.cos(angles), 1.0 + 0.25 * np.sin(angles)])
    person = cluster(round_, heights=np.linspace(0.2, 1.7, 9))
    vehicles = vehicles_by_matched_filter(person, FREE)
    assert vehicles == SHAPES["rectangle"](person, FREE)


def test_too_large_and_too_small_clusters_give_no_vehicle():
    wall = np.column_stack([np.full(80, 20.0), np.linspace(-20, 20, 80)])
    assert vehicles_by_matched_filter(cluster(wall), FREE) == []
    assert vehicles_by_matched_filter(cluster(np.array([[9.0, 0.0]]), heights=(1.0,)), FREE) == []


def test_is_a_shape_by_name_with_its_option():
    assert SHAPES["matched-filter"] is vehicles_by_matched_filter
    ClusterDetector(shape="matched-filter", sigma_m=0.1)
    with pytest.raises(ValueError, match="sigma_m"):
        vehicles_by_matched_filter(cluster(rear_and_flank(0.2)), FREE, sigma_m=-1.0)
