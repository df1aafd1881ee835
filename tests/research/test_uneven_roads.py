"""Simulated uneven roads: where things stand, and what is counted."""

import numpy as np
import pytest

from research import uneven_roads as study
from roadscope.detectors import Cloud


@pytest.mark.parametrize("shape", study.SHAPES)
def test_the_vehicle_stands_on_the_road_that_was_drawn(shape):
    scene = study.scene_of(3, shape, 5.0)
    scan = scene.frame.lidar
    road = study.road_of(np.random.default_rng(3), shape, 5.0)
    cloud = Cloud.of(scan, scene.frame.calibration.pose("lidar"))
    near = (scene.owners[cloud.rows] < 0) & (cloud.ranges < 8.0) & (cloud.azimuths**2 < 0.1)
    assert near.sum() > 500
    # The vehicle stands on the road: below it the ground is level but for its own sway.
    assert np.abs(cloud.points[near, 2]).max() < 0.4
    assert road.at(60.0, 0.0) > 2.0


def test_cars_are_where_their_returns_are():
    scene = study.scene_of(5, "bend ahead", 6.0)
    cloud = Cloud.of(scene.frame.lidar, scene.frame.calibration.pose("lidar"))
    assert (scene.cars[:, 2] >= study.LEAST_RETURNS).sum() >= 2
    for number, (x, y, returns) in enumerate(scene.cars):
        rows = scene.owners[cloud.rows] == number
        assert rows.sum() == returns
        assert (np.hypot(*(cloud.points[rows, :2] - (x, y)).T) < 3.0).all()


def test_the_same_seed_is_the_same_scan():
    one, other = (study.scene_of(7, "plane", 4.0) for _ in range(2))
    assert one.frame == other.frame


def test_a_detector_is_judged():
    scene = study.scene_of(5, "bend ahead", 6.0)
    score = study.judged("distance-l-shape")(scene)
    assert score.found >= score.cars - 1 > 0
    assert score.ground <= score.false
