"""Metrics of drives against values worked out by hand, and times to collision against shapely."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import box

from roadscope.benchmarks.metrics import (
    ScoredDrive,
    phantom_braking,
    score_drive,
    times_to_collision,
)


def drive(
    seconds=10.0,
    *,
    speeds=10.0,
    accelerations=0.0,
    due=0.0,
    other=(1000.0, 0.0, 0.0),
    velocity=(0.0, 0.0),
    planned_s=10.0,
    collided=False,
):
    """An ego that drives along x, and one other road user; all 4 m long and 2 m wide."""
    stamps_s = np.arange(round(seconds * 10)) / 10
    count = len(stamps_s)
    speeds = np.broadcast_to(np.float64(speeds), count)
    places = np.concatenate([[0.0], np.cumsum(speeds[:-1]) * 0.1])
    others = np.zeros((count, 1, 3))
    others[:, 0] = other
    others[:, 0, :2] += stamps_s[:, None] * np.array(velocity)
    velocities = np.zeros((count, 2, 2))
    velocities[:, 0, 0], velocities[:, 1] = speeds, velocity
    return ScoredDrive(
        stamps_s,
        speeds,
        np.broadcast_to(np.float64(accelerations), count),
        np.broadcast_to(np.float64(due), count),
        np.column_stack([places, np.zeros((count, 2))]),
        others,
        velocities,
        np.array([[4.0, 2.0], [4.0, 2.0]]),
        float(seconds),
        10.0,
        planned_s,
        collided,
    )


def values(of):
    return {name: score.value for name, score in score_drive(of).named().items()}


def test_an_undisturbed_drive_has_the_best_scores() -> None:
    scores = values(drive())
    assert scores["reward"] == pytest.approx(1.0)
    assert scores["progress"] == pytest.approx(1.0)
    assert scores["least_ttc_s"] == 10.0
    for name in ("collided", "collisions", "near_misses", "hard_braking", "phantom_braking"):
        assert scores[name] == 0.0, name


def test_a_collision_ends_the_reward() -> None:
    scores = values(drive(5.0, collided=True))
    assert scores["reward"] == pytest.approx(0.5)
    assert scores["collided"] == 1.0
    assert scores["collisions"] == pytest.approx(3600 / 5.0)
    assert scores["least_ttc_s"] == 0.0


def test_speed_beyond_the_desired_one_gives_no_reward() -> None:
    assert values(drive(speeds=20.0))["reward"] == 1.0
    assert values(drive(speeds=20.0))["progress"] == pytest.approx(2.0)
    assert values(drive(speeds=5.0))["reward"] == pytest.approx(0.5)


def test_braking_is_a_phantoms_unless_there_was_a_reason_within_a_second() -> None:
    hard = np.zeros(100)
    hard[40:45] = hard[80:85] = -5.0
    due = np.zeros(100)
    due[35] = -2.0
    braking = drive(accelerations=hard, due=due)
    assert np.flatnonzero(phantom_braking(braking)).tolist() == list(range(80, 85))
    scores = values(braking)
    assert scores["hard_braking"] == pytest.approx(2 * 3600 / 10.0)
    assert scores["phantom_braking"] == pytest.approx(3600 / 10.0)


def test_the_time_to_a_standing_car_is_the_gap_over_the_speed() -> None:
    times_s = times_to_collision(drive(2.0, other=(50.0, 0.0, 0.0)))
    assert times_s[0] == pytest.approx((50.0 - 4.0) / 10.0)
    assert times_s[10] == pytest.approx((50.0 - 10.0 - 4.0) / 10.0)
    assert times_to_collision(drive(2.0, other=(50.0, 2.1, 0.0)))[0] == 10.0


def test_absent_road_users_are_never_encountered() -> None:
    assert (times_to_collision(drive(other=(np.nan, np.nan, np.nan))) == 10.0).all()


def outline(x, y, yaw):
    return affinity.translate(affinity.rotate(box(-2, -1, 2, 1), yaw, use_radians=True), x, y)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-30, 30),
    st.floats(-30, 30),
    st.floats(-3.2, 3.2),
    st.floats(-15, 15),
    st.floats(-15, 15),
)
def test_times_to_collision_are_those_of_outlines_that_are_moved(x, y, yaw, vx, vy) -> None:
    moment = drive(0.2, other=(x, y, yaw), velocity=(vx, vy))
    time_s = float(times_to_collision(moment)[0])
    fine = np.arange(0.0, 10.0, 0.02)
    touching = [
        t for t in fine if outline(10.0 * t, 0, 0).intersects(outline(x + vx * t, y + vy * t, yaw))
    ]
    if touching:
        assert time_s == pytest.approx(touching[0], abs=0.021)
    else:
        # A touch may last less than a step.
        assert (
            time_s == 10.0
            or outline(10.0 * time_s, 0, 0).distance(outline(x + vx * time_s, y + vy * time_s, yaw))
            < 0.01
        )
