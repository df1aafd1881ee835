import numpy as np
import pytest
from toy_clusters import FREE, cluster, rear_and_flank

from roadscope.core import Category
from roadscope.detectors.shape import vehicles_by_body, vehicles_by_l_shape


@pytest.mark.parametrize("yaw", [0.0, 0.2, 0.5])
def test_finds_a_car(yaw):
    (car,) = vehicles_by_body(cluster(rear_and_flank(yaw)), FREE)
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((18.0, -4.0), abs=0.12)
    assert car.yaw == pytest.approx(yaw, abs=np.radians(1.5))
    assert car.size[:2] == pytest.approx((4.5, 1.82), abs=0.2)


def test_free_sight_past_a_rear_says_how_wide_the_car_is():
    rear = rear_and_flank(0.0, (20.0, 0.0))[:20]
    (car,) = vehicles_by_body(cluster(rear), FREE)
    assert car.centre == pytest.approx((20.0, 0.0), abs=0.45)
    assert abs(car.yaw) < np.radians(4.0)


def test_two_columns_are_left_to_the_l_shape():
    two_columns = cluster(np.array([[12.0, 2.0], [12.0, 2.4]]))
    assert vehicles_by_body(two_columns, FREE) == vehicles_by_l_shape(two_columns, FREE)
