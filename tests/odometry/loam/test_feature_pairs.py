"""The lines and planes that features belong to, and the nearest point of a ring."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.odometry import exp_se3
from roadscope.odometry.loam import NONE, RINGS_AWAY, SLIM, lines_of, nearest, planes_of, ring_table

NOWHERE = np.eye(4)


def rings_of_points(rng, count, rings=5):
    """Points on rings of a LiDAR: cones about the vertical, after a sweep that was deskewed."""
    ring = rng.integers(0, rings, count)
    azimuth, reach = rng.uniform(-np.pi, np.pi, count), rng.uniform(2, 15, count)
    up = np.radians(4.0 * ring - 8) + rng.uniform(-0.01, 0.01, count)
    flat = reach * np.cos(up)
    points = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), reach * np.sin(up)])
    return points, ring, rng.integers(0, 3, count)


def nearest_slowly(table, place, label, home, farthest, least, most):
    ring = np.repeat(np.arange(len(table.lows)), np.diff(table.starts))
    squared = ((table.points - place) ** 2).sum(axis=1)
    able = (np.abs(ring - home) <= farthest) & (np.abs(ring - home) >= least) & (squared < most)
    able &= (label < 0) | (table.labels == label)
    if not able.any():
        return NONE, NONE
    k = int(np.argmin(np.where(able, squared, np.inf)))
    return k, int(ring[k])


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 9999),
    count=st.integers(0, 120),
    label=st.integers(-1, 2),
    least=st.integers(0, 1),
    reach_m=st.sampled_from([0.5, 3.0, 40.0]),
)
def test_the_nearest_point_equals_that_of_the_slow_twin(seed, count, label, least, reach_m):
    rng = np.random.default_rng(seed)
    table = ring_table(*rings_of_points(rng, count))
    near_the_seam = np.array([-8.0, rng.uniform(-0.2, 0.2), 0.3])
    for place in [*rng.uniform(-15, 15, (10, 3)) * (1, 1, 0.2), near_the_seam, np.zeros(3)]:
        search = place, label, 2, 3, least, reach_m**2
        assert nearest(table, *search) == nearest_slowly(table, *search)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_edges_are_paired_with_the_line_through_two_rings():
    pole = np.array([[5.0, 1.0, z] for z in (-1.0, -0.5, 0.0, 0.5)])
    other = pole + np.array([0, 3, 0])
    table = ring_table(np.vstack([pole, other]), np.tile([0, 1, 2, 3], 2), np.repeat([7, 8], 4))
    points = np.array([[5.2, 1.3, 0.1], [5, 3.8, 0]])
    labels, rings = np.array([7, 8]), np.array([2, 2])
    pairs = lines_of(points, labels, rings, table, NOWHERE, 5.0)
    assert pairs.points == pytest.approx(points)
    assert pairs.anchors[:, 1].tolist() == [1, 4]
    for axes in pairs.axes:
        assert axes @ axes.T == pytest.approx(np.eye(2))
        assert axes[:, 2] == pytest.approx(0)
    swapped = lines_of(points, labels[::-1].copy(), rings, table, NOWHERE, 5.0)
    assert swapped.anchors[:, 1].tolist() == [4, 1]
    assert len(lines_of(points, np.array([9, 9]), rings, table, NOWHERE, 5.0).points) == 0
    for reach_m, count in ((0.6, 2), (0.5, 0)):
        near = lines_of(points, np.array([-1, -1]), rings, table, NOWHERE, reach_m)
        assert len(near.points) == count


def test_neighbours_are_searched_at_the_pose(rng):
    points, ring, labels = rings_of_points(rng, 200)
    table = ring_table(points, ring, labels)
    motion = exp_se3(np.array([1.0, 0.5, 0, 0, 0, 0.3]))
    there = (points - motion[:3, 3]) @ motion[:3, :3]
    for kernel in (lines_of, planes_of):
        pairs = kernel(there, np.full(200, -1), ring, table, motion, 5.0)
        assert len(pairs.points) > 150
        placed = pairs.points @ motion[:3, :3].T + motion[:3, 3]
        assert placed == pytest.approx(pairs.anchors, abs=1e-9)


@pytest.mark.parametrize(
    "direction", [(0, 0, 1), (1, 0, 0), (0.1, 0.1, -3), (1, 1, 1), (-2, 5, 0.3)]
)
def test_axes_of_a_line_are_across_it(direction):
    line = np.array([[4.0, 2, 0], np.array([4.0, 2, 0]) + direction])
    table = ring_table(line, np.array([0, 1]), np.zeros(2, int))
    pairs = lines_of(line[:1], np.zeros(1, int), np.zeros(1, int), table, NOWHERE, 50.0)
    assert pairs.axes[0] @ direction == pytest.approx(0, abs=1e-9)
    assert pairs.axes[0] @ pairs.axes[0].T == pytest.approx(np.eye(2))


def test_a_plane_goes_through_three_points_of_two_rings(rng):
    plane = np.array([[4.0, -0.2, 0], [4.0, 0.3, 0], [4.1, 0, 0.5]])
    table = ring_table(plane, np.array([0, 0, 1]), np.zeros(3, int))
    point = np.array([[3.5, 0, 0.1]])
    pairs = planes_of(point, np.zeros(1, int), np.zeros(1, int), table, NOWHERE, 5.0)
    normal = np.cross(plane[1] - plane[0], plane[2] - plane[0])
    expected = abs((point[0] - plane[0]) @ normal) / np.linalg.norm(normal)
    assert abs(pairs.axes[0, 0] @ (point[0] - pairs.anchors[0])) == pytest.approx(expected)
    assert not pairs.axes[0, 1].any()


def test_features_without_a_line_or_plane_are_left_out():
    here = np.array([[4.0, 0, 0]])
    search = here, np.zeros(1, int), np.zeros(1, int)
    slim = np.array([[4.0, 0, 0], [4.0, 1, 0], [4.0, 0.5, SLIM / 3]])
    for points, rings in [
        (np.empty((0, 3)), np.empty(0, int)),
        (slim[:1], np.array([0])),
        (slim[[0, 2]], np.array([0, RINGS_AWAY + 1])),
    ]:
        table = ring_table(points, rings, np.zeros(len(points), int))
        assert len(lines_of(*search, table, NOWHERE, 5.0).points) == 0
        assert len(planes_of(*search, table, NOWHERE, 5.0).points) == 0
    table = ring_table(slim, np.array([0, 0, 1]), np.zeros(3, int))
    assert len(planes_of(*search, table, NOWHERE, 5.0).points) == 0
    twice = ring_table(np.vstack([here, here]), np.array([0, 1]), np.zeros(2, int))
    assert len(lines_of(*search, twice, NOWHERE, 5.0).points) == 0
