from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Category, Detections
from roadscope.trackers.existence import ExistenceTracker
from roadscope.trackers.existence_priors import Neighbours, expected_velocities
from roadscope.trackers.existence_targets import Measured
from roadscope.trackers.gating import FAMILIES
from roadscope.trackers.learned import learned

TRAITS = learned("unknown")
CAR = FAMILIES[Category.CAR]


def cars(places, yaws=0.0):
    places = np.asarray(places, float).reshape(-1, 2)
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.8)]), np.tile([4.5, 1.8, 1.5], (n, 1)),
        np.full(n, yaws), np.full(n, Category.CAR), np.full(n, 0.95), "ego", 0.0,
    )  # fmt: skip


def expected(neighbours=(), yaw=0.0, family=CAR, traits=TRAITS):
    """One newcomer at the origin; neighbours: x, y, vx, vy."""
    table = np.array(neighbours, float).reshape(-1, 4)
    known = Neighbours(table[:, :2], table[:, 2:], np.full(len(table), family))
    new = Measured.of(cars([0, 0], yaw), np.zeros(2), traits)
    found = expected_velocities(new, known, traits)
    return found.means[0], found.covariances[0]


def test_alone_a_newcomer_moves_as_usual():
    mean, covariance = expected(yaw=np.pi / 2)
    forward = (2 * TRAITS.front[0] - 1) * TRAITS.cruise_m_s[0]
    assert mean == pytest.approx([0, forward])
    assert covariance[1, 1] + forward**2 == pytest.approx(TRAITS.speed_m_s[0] ** 2)
    assert covariance[0, 0] < 0.1 * covariance[1, 1]
    either_way, _ = expected(traits=replace(TRAITS, front=np.full(7, 0.5)))
    assert either_way == pytest.approx([0, 0])


def test_neighbours_tell_speeds_and_which_way():
    mean, covariance = expected([(-20, 0, 25, 0), (15, 1, 26, 0), (30, 0, 25, 0)])
    assert mean[0] == pytest.approx(24, abs=2)
    assert covariance[0, 0] < expected()[1][0, 0]
    back, _ = expected([(-20, 0, -25, 0), (15, 1, -26, 0), (30, 0, -25, 0)])
    assert back[0] < -5


@pytest.mark.parametrize("far", [(500, 0, 25, 0), (0, 40, 25, 0), (10, 0, 0, 25)])
def test_far_and_crossing_ones_say_nothing(far):
    assert expected([far])[0] == pytest.approx(expected()[0], abs=0.1)


def test_pedestrians_say_nothing_of_cars():
    told = expected([(1, 0, 1.5, 0)], family=FAMILIES[Category.PEDESTRIAN])
    assert told[0] == pytest.approx(expected()[0])


def test_a_car_that_follows_others_is_known_at_once():
    tracker = ExistenceTracker(traits="unknown")
    for t in range(20):
        queue = [[10 + 2 * t + 12 * k, 0] for k in range(3)]
        tracker.update(replace(cars(queue), stamp_s=0.1 * t), None)
    late = cars([*[[50 + 12 * k, 0] for k in range(3)], [38, 0]])
    tracks = tracker.update(replace(late, stamp_s=2.0), None)
    assert tracks.velocities[-1] == pytest.approx([20, 0], abs=4)
