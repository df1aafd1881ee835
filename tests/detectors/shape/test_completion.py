"""Rectangle and L-shape: whole bodies from what is seen of them."""

from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Category
from roadscope.detectors import Horizon
from roadscope.detectors.shape import SHAPES, Cluster

FITS = ["l-shape", "rectangle"]
STEP = np.radians(0.2)


def horizon(azimuths=(), ranges=()):
    azimuths, ranges = np.array(azimuths, float), np.array(ranges, float)
    return Horizon(azimuths, ranges, STEP, None, np.zeros(2))


def cluster(outline, heights=(0.4, 0.8, 1.2)):
    """Put the same outline at several heights."""
    outline = np.asarray(outline, float)
    x, y = outline.T
    outline = outline[np.argsort(np.arctan2(y, x) - np.arctan2(y.mean(), x.mean()))]
    count, levels = len(outline), len(heights)
    points = np.column_stack([np.repeat(outline, levels, axis=0), np.tile(heights, count)])
    ring, column = np.tile(np.arange(levels), count), np.repeat(np.arange(count), levels)
    return Cluster(points, ring, column, outline, np.zeros(2))


def seen_car(yaw=0.0, centre=(15.0, 4.0), size=(4.4, 1.8)):
    """Those points of a car's outline that face the origin."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    axes = np.array([[cos, sin], [-sin, cos]])
    points = []
    for k in range(2):
        facing = -np.sign(np.asarray(centre) @ axes[k])
        if abs(np.asarray(centre) @ axes[k]) <= size[k] / 2:
            continue
        along = np.linspace(-size[1 - k] / 2, size[1 - k] / 2, 24)
        points.append(centre + facing * size[k] / 2 * axes[k] + along[:, None] * axes[1 - k])
    return np.concatenate(points)


def first_of_each_column(points):
    """Keep the nearest point of each column of a scan: a face at grazing incidence has few."""
    x, y = points.T
    nearest = points[np.argsort(np.hypot(x, y))]
    _, rows = np.unique(np.arctan2(nearest[:, 1], nearest[:, 0]) // STEP, return_index=True)
    return nearest[rows]


def with_roof(points, yaw=0.0, centre=(15.0, 4.0)):
    """Add the far corners of a roof: without them the least rectangle may lie on the diagonal."""
    return np.concatenate(
        [points, turned([[-1.9, 0.7], [1.9, 0.7], [1.9, -0.7], [-1.9, -0.7]], yaw, centre)]
    )


def car_cluster(yaw):
    """Outline and roof of a car."""
    outline = first_of_each_column(seen_car(yaw))
    points = with_roof(outline, yaw)
    count = len(points)
    return replace(
        cluster(outline),
        points=np.column_stack([points, np.full(count, 1.2)]),
        ring=np.zeros(count, int),
        column=np.arange(count),
    )


def only(shape, *arguments):
    (vehicle,) = SHAPES[shape](*arguments)
    return vehicle


def turned(points, yaw, shift):
    matrix = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.asarray(points) @ matrix.T + shift


def axis_off(yaw, other):
    return abs((yaw - other + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("shape", FITS)
@pytest.mark.parametrize("yaw", np.radians([-50, -20, 10, 45, 80]))
def test_two_faces_give_the_car(shape, yaw):
    car = only(shape, car_cluster(yaw), horizon())
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((15.0, 4.0), abs=0.2)
    assert car.size[:2] == pytest.approx((4.4, 1.8), abs=0.3)
    assert axis_off(car.yaw, yaw) < (0.03 if shape == "l-shape" else 0.15)


@pytest.mark.parametrize("shape", FITS)
def test_rear_face_alone_is_completed_away_from_the_sensor(shape):
    rear = np.column_stack([np.full(20, 20.0), np.linspace(-0.9, 0.9, 20)])
    car = only(shape, cluster(rear), horizon())
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((22.2, 0.0), abs=0.05)
    assert axis_off(car.yaw, 0.0) < 0.01


@pytest.mark.parametrize("shape", FITS)
def test_hidden_side_is_where_the_body_goes_on(shape):
    """The right of the face is hidden: its left end and the usual width tell the middle."""
    face = np.column_stack([np.full(12, 20.0), np.linspace(-0.1, 0.9, 12)])
    hidden = horizon([np.arctan2(-0.1, 20.0) - STEP], [10.0])
    car = only(shape, cluster(face), hidden)
    assert car.centre == pytest.approx((22.2, 0.0), abs=0.05)


@pytest.mark.parametrize("shape", FITS)
@pytest.mark.parametrize(
    ("size", "heights", "category"),
    [
        ((5.7, 2.03), (0.4, 1.2, 2.15), Category.VAN),
        ((11.4, 2.55), (0.4, 1.2, 2.4), Category.BUS),
        ((2.05, 0.7), (0.3, 0.65, 1.0, 1.3, 1.6), Category.MOTORCYCLE),
        ((0.5, 0.5), (0.3, 0.6, 0.9, 1.3, 1.6), Category.PEDESTRIAN),
    ],
)
def test_category_comes_from_size_and_height(shape, size, heights, category):
    vehicle = only(shape, cluster(seen_car(0.4, size=size), heights), horizon())
    assert vehicle.category is category
    assert vehicle.size[2] >= heights[-1]


@pytest.mark.parametrize("shape", FITS)
def test_a_size_that_no_road_user_has_gives_no_vehicle(shape):
    wall = np.column_stack([np.linspace(5, 40, 100), np.full(100, 6.0)])
    post = np.column_stack([np.full(3, 9.0), np.linspace(0, 0.1, 3)])
    corner = np.concatenate(
        [wall[:40], np.column_stack([np.full(30, 5.0), np.linspace(6, 16, 30)])]
    )
    for outline in (wall, post, corner):
        assert SHAPES[shape](cluster(outline), horizon()) == []
