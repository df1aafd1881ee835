"""Points of a map, the nearest of them, and lines and planes through those."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.odometry import exp_se3
from roadscope.odometry.lego import CUBE_M, NEAREST, PointMap, nearest_points

HERE = np.eye(4)


def known(points, thin_m=1e-9):
    point_map = PointMap(thin_m=thin_m)
    point_map.add(points)
    return point_map


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 9999), count=st.integers(0, 300))
def test_nearest_points_equal_those_of_the_slow_twin(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3, 3, (count, 3))
    held = known(points)
    for place in rng.uniform(-3.5, 3.5, (10, 3)):
        nearest_rows = np.empty(NEAREST, np.int64)
        n = nearest_points(held.grid, place, nearest_rows)
        away = np.linalg.norm(points - place, axis=1)
        order = np.argsort(away)[: min(NEAREST, int((away < CUBE_M).sum()))]
        assert nearest_rows[:n].tolist() == order.tolist()


def test_points_near_others_are_left_out_and_tables_grow():
    rng = np.random.default_rng(0)
    held = PointMap(thin_m=0.3)
    for k in range(12):
        held.add(rng.uniform(-30, 30, (4000, 3)) * (1, 1, 0.05) + [5 * k, 0, 0])
    cubes = np.floor(held.points / CUBE_M)
    order = np.lexsort(cubes.T)
    for rows in np.split(order, np.flatnonzero(np.diff(cubes[order], axis=0).any(axis=1)) + 1)[
        :200
    ]:
        own = held.points[rows]
        distances_m = np.linalg.norm(own[:, None] - own, axis=2) + 9 * np.eye(len(own))
        assert distances_m.min() >= 0.3
    assert len(held) > 1 << 13
    held.add(held.points.copy())
    before = len(held)
    held.add(held.points + 1e-3 * (np.ceil(held.points) - held.points))
    assert len(held) == before
    held.clear()
    assert len(held) == 0
    with pytest.raises(ValueError, match="thin_m"):
        PointMap(thin_m=0.0)


def test_far_points_and_nan_are_left_out():
    held = known(np.array([[1e9, 0, 0], [0, -1e8, 0]]))
    assert len(held) == 0


def test_lines_and_planes_are_distinguished():
    rng = np.random.default_rng(1)
    pole = np.column_stack([np.full(20, 3.0), np.full(20, 1.0), np.linspace(-1, 1, 20)])
    wall = np.column_stack([np.full(200, 8.0), rng.uniform(-3, 3, 200), rng.uniform(-2, 2, 200)])
    held = known(np.vstack([pole, wall]) + 0.005 * rng.standard_normal((220, 3)))
    motion = exp_se3(np.array([0.4, -0.2, 0.1, 0.05, 0.02, 0.3]))
    off = np.array([[3.1, 1.05, 0.2], [8.2, 0.3, 0.4], [20.0, 0, 0]])
    points = (off - motion[:3, 3]) @ motion[:3, :3]
    lines = held.lines(points[:1], motion)
    assert np.abs(lines.axes[0] @ [0, 0, 1]).max() < 0.05
    assert lines.anchors[0, :2] == pytest.approx([3, 1], abs=0.02)
    planes = held.planes(points, motion)
    assert planes.points.tolist() == points[1:2].tolist()
    assert abs(planes.axes[0, 0, 0]) > 0.99
    assert not planes.axes[0, 1].any()
    assert len(held.lines(points[2:], motion).points) == 0


def test_one_beams_trace_has_no_plane():
    rng = np.random.default_rng(2)
    trace = np.column_stack([np.full(100, 9.0), np.linspace(-3, 3, 100), np.full(100, -1.9)])
    held = known(trace + 0.02 * rng.standard_normal((100, 3)))
    assert len(held.planes(trace, HERE).points) == 0
