"""Scores are probabilities made of curves, and the evidence they rest on is what it says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import HEIGHT_M, cloud

from roadscope.core import Bounds, Category
from roadscope.detectors import (
    COUNTS,
    FEATURES,
    Horizon,
    ScoreModel,
    count_returns,
    features,
    scores,
    shares_of_rays,
    shipped_model,
    sort_to_cells,
)
from roadscope.detectors.shape import Vehicle

CAR = (22.0, 0.0, 4.6, 1.85, 1.5, 0.0)
VIEW = Bounds(-0.96, 0.96)
ELEVATIONS = np.linspace(-3, 3, 13)


def vehicle(x=22.0, y=0.0, length=4.6, width=1.85, yaw=0.0):
    return Vehicle((x, y), (length, width, 1.5), yaw, Category.CAR, 0.05, 20, -1.0)


def cloud_and_horizon(boxes):
    returns = cloud(boxes, noise_m=0.02, elevations=ELEVATIONS)
    standing = returns.points[:, 2] > 0.3
    return returns, Horizon.of(returns, standing, VIEW)


def feature(vehicles, boxes):
    returns, horizon = cloud_and_horizon(boxes)
    values = features(vehicles, returns, horizon, HEIGHT_M)
    return dict(zip(FEATURES, values.T, strict=True))


def counted(boxes, points, ring):
    return dict(
        zip(COUNTS, count_returns(boxes, points, ring, sort_to_cells(points)).T, strict=True)
    )


def test_a_car_is_more_probable_than_the_gap_beside_it():
    returns, horizon = cloud_and_horizon([CAR])
    right, wrong = scores([vehicle(), vehicle(y=5.0)], returns, horizon, HEIGHT_M)
    assert 0 < wrong < 0.2 < 0.6 < right < 1


def test_copies_of_returns_are_no_evidence():
    returns, horizon = cloud_and_horizon([CAR])
    twice = returns.select(np.repeat(np.arange(len(returns)), 2))
    boxes = [vehicle(), vehicle(y=5.0)]
    once = scores(boxes, returns, horizon, HEIGHT_M)
    assert np.array_equal(scores(boxes, twice, horizon, HEIGHT_M), once)


def test_no_box_no_score():
    returns, horizon = cloud_and_horizon([CAR])
    assert scores([], returns, horizon, HEIGHT_M).shape == (0,)


def test_what_goes_on_beyond_the_ends_shows():
    rail = (22.0, 4.0, 40.0, 0.3, 0.8, 0.0)
    values = feature([vehicle(), vehicle(y=4.0, width=0.5)], [CAR, rail])
    assert values["ends"][0] == 0.0
    assert values["ends"][1] > 1.0
    assert values["top_m"][1] == pytest.approx(0.8, abs=0.15)


def test_rays_that_pass_through_a_box_are_counted():
    values = feature([vehicle(), vehicle(y=8.0)], [CAR])
    assert values["passing"][0] < 0.2
    assert values["passing"][1] == 1.0
    assert values["log_returns"][0] > np.log(50)


@given(seed=st.integers(0, 10**6), count=st.integers(1, 400))
def test_counts_equal_a_plain_computation(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.uniform((-10, -10, 0), (10, 10, 4), (count, 3))
    ring = rng.integers(0, 8, count)
    x, y, length, width, yaw = box = rng.uniform((-12, -12, 1, 1, -3), (12, 12, 8, 3, 3))
    counts = counted(box[None], points, ring)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    u = np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy) - length / 2
    v = np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx) - width / 2
    z, inside = points[:, 2], (u < 0.25) & (v < 0.25)
    body = inside & (z >= 0.12) & (z <= 2.5)
    near = (u <= 1.5) & (v <= 1.5) & ~inside & (z > 0.3) & (z <= 2.5)
    assert counts["body"] == body.sum()
    assert counts["levels"] == len(np.unique(ring[body]))
    assert counts["above"] == (inside & (z > 2.5)).sum()
    assert counts["ends"] == (near & (v < 0.25)).sum()
    assert counts["sides"] == (near & (u < 0.25)).sum()
    assert counts["ground"] == (inside & (z < 0.12) & (u < -0.5) & (v < -0.5)).sum()
    assert counts["top"] == (z[body].max() if body.any() else 0.0)


@given(yaw=st.floats(-3.1, 3.1))
def test_sight_turns_with_the_scene(yaw):
    azimuths, ranges = np.radians(np.arange(-180, 180)) + 1e-3, np.full(360, 30.0)
    azimuths, ranges = np.delete(azimuths, [5, 100]), np.delete(ranges, [5, 100])
    box = np.array([[20 * np.cos(yaw), 20 * np.sin(yaw), 4.0, 2.0, yaw + 0.4]])
    blocked, hit, passing, _ = shares_of_rays(box, azimuths, ranges, np.zeros(2), np.radians(1))[0]
    assert (blocked, hit, passing) == (0, 0, 1)
    blocked, hit, passing, columns = shares_of_rays(
        box, azimuths, np.full(358, 20.0), np.zeros(2), np.radians(1)
    )[0]
    assert blocked + hit + passing == pytest.approx(1)
    assert columns >= 5
    assert hit > 0.5


@given(st.lists(st.floats(-9, 9), min_size=len(FEATURES), max_size=len(FEATURES)))
def test_curves_run_straight_between_knots_and_level_beyond(row):
    model = ScoreModel(0.5, {"range_m": ((0.0, 2.0), (0.0, -4.0))})
    values = np.array([row])
    odds = 0.5 - 2.0 * np.clip(row[FEATURES.index("range_m")], 0, 2)
    assert model.probabilities(values) == pytest.approx([1 / (1 + np.exp(-odds))])


def test_shipped_weights_fit_the_features():
    model = shipped_model()
    assert set(model.curves) == set(FEATURES)
    for knots, weights in model.curves.values():
        assert len(knots) == len(weights) >= 2
        assert (np.diff(knots) > 0).all()
        assert np.isfinite(weights).all()
