import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.detectors.pose import axis_difference, fit_ransac, with_corner

SIZE = {"length_m": 4.87, "width_m": 1.85}
ORIGIN = np.zeros(2)


def corner(yaw=0.0, centre=(30.0, 6.0), noise_m=0.02, seed=0):
    """The rear face and the right flank of a brick."""
    length, width = SIZE.values()
    rear = np.column_stack([np.full(10, -length / 2), np.linspace(-0.9, 0.9, 10)])
    flank = np.column_stack([np.linspace(-2.3, 2.3, 14), np.full(14, -width / 2)])
    points = np.concatenate([rear, flank])
    points += noise_m * np.random.default_rng(seed).standard_normal(points.shape)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return points @ turn.T + centre


def fit(points, origin=ORIGIN, **options):
    return fit_ransac(points, origin, np.random.default_rng(5), **SIZE, **options)


@pytest.mark.parametrize("yaw", np.radians([0, 5, -25]))
def test_a_corner_gives_the_rectangle(yaw):
    fitted = fit(corner(yaw))
    assert np.hypot(fitted.x - 30, fitted.y - 6) < 0.1
    assert np.degrees(abs(axis_difference(fitted.yaw, yaw))) < 1.5
    assert fitted.score > 0.9


def test_clutter_does_not_move_the_corner():
    clutter = np.array([[29.0, 4.0], [33.0, 9.0], [28.0, 8.5]])
    fitted = fit(np.concatenate([corner(), clutter]))
    assert np.hypot(fitted.x - 30, fitted.y - 6) < 0.1


def test_one_face_is_completed_away_from_the_sensor():
    rear = np.column_stack([np.full(10, 30.0), np.linspace(-0.9, 0.9, 10)])
    flank = np.column_stack([np.linspace(20.0, 24.8, 20), np.full(20, 5.0)])
    assert fit(rear).centre == pytest.approx((30 + 4.87 / 2, 0.0), abs=0.01)
    assert fit(rear).yaw == pytest.approx(0.0, abs=0.01)
    assert fit(flank).centre == pytest.approx((22.4, 5 + 1.85 / 2), abs=0.01)


def test_returns_behind_a_face_are_no_second_face():
    rear = np.column_stack([np.full(12, 30.0), np.linspace(-0.9, 0.9, 12)])
    window = np.column_stack([np.full(6, 30.8), np.linspace(-0.5, 0.5, 6)])
    assert fit(np.concatenate([rear, window])).y == pytest.approx(0.0, abs=0.03)


def test_the_main_face_taken_for_the_long_side_turns_a_rear():
    rear = np.column_stack([np.full(10, 30.0), np.linspace(-0.9, 0.9, 10)])
    fitted = fit(rear, long_side="main")
    assert abs(axis_difference(fitted.yaw, np.pi / 2)) < 0.01


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=12),
    st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
)
def test_any_finite_points_give_a_pose(points, origin):
    fitted = fit(np.array(points, float), np.array(origin, float))
    assert np.abs(fitted.centre).max() <= np.abs(np.array(points)).max() + 2 * SIZE["length_m"]


@pytest.mark.parametrize(
    ("options", "message"),
    [({"inlier_m": 0}, "inlier_m"), ({"trials": 0}, "trials"), ({"long_side": "left"}, "left")],
)
def test_settings_are_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        fit(corner(), **options)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(11, 24))
@settings(max_examples=30)
def test_the_second_face_is_where_most_agree(seed, count):
    """Against every pair of returns compared."""
    rng = np.random.default_rng(seed)
    points = corner(seed=seed)[:count]
    points[:, 1] += rng.uniform(-0.1, 0.1)
    axis, inlier_m = np.array([1.0, 0.0]), 0.06
    held = np.arange(len(points)) >= 10
    along = points[:, 0] - points[:, 0].mean()
    low, high = along[held].min() + inlier_m, along[held].max() - inlier_m
    depths = (points - points[held].mean(axis=0)) @ [0.0, 1.0]
    behind = ~held & (depths * points[:, 1].mean() > 0) & ((along < low) | (along > high))
    pairs = np.abs(np.subtract.outer(along[behind], along)) <= inlier_m
    most = int((pairs & behind).sum(axis=1).max(initial=0))
    _, _, second = with_corner(points, axis, held, ORIGIN, inlier_m)
    assert second.sum() == (most if most >= 2 else 0)
