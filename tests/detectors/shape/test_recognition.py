import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.core import Category
from roadscope.detectors import Horizon
from roadscope.detectors.shape import (
    FACES,
    GAP_M,
    HALF_FACE_M,
    JOIN_M,
    Segment,
    face_ends,
    recognise,
    split_ends,
)

FREE = Horizon(np.empty(0), np.empty(0), np.radians(0.25), None, np.zeros(2))


def line(a, b, count=10):
    return np.linspace(a, b, count)


def recognise_points(*pieces, horizon=FREE):
    points = np.concatenate(pieces)
    return recognise(points, split_ends(points, 0.3), horizon)


def test_rear_face_alone_is_a_car_ahead():
    (car,) = recognise_points(line((20.0, -0.9), (20.0, 0.9)))
    assert car.category is Category.CAR
    assert car.centre == pytest.approx((22.3, 0.0))
    assert car.yaw == pytest.approx(0.0)
    assert car.residual_m == pytest.approx(0.0, abs=1e-9)


def test_flank_alone_is_completed_away_from_the_sensor():
    (car,) = recognise_points(line((12.0, 3.0), (16.6, 3.0)))
    assert car.centre == pytest.approx((14.3, 3.0 + 1.85 / 2))
    assert car.yaw == pytest.approx(0.0)


@pytest.mark.parametrize("bearing", np.radians([0, 35, 90, 160, -100, -170]))
def test_corner_gives_the_box_from_any_side(bearing):
    turn = np.array([[np.cos(bearing), -np.sin(bearing)], [np.sin(bearing), np.cos(bearing)]])
    rear, flank = line((20.0, 4.85), (20.0, 3.0)), line((20.2, 3.0), (24.6, 3.0), 12)
    (car,) = recognise_points(rear @ turn.T, flank @ turn.T)
    assert np.allclose(car.centre, turn @ [22.3, 3.925], atol=0.02)
    assert np.sin(car.yaw - bearing) == pytest.approx(0.0, abs=0.02)
    assert car.size[:2] == pytest.approx((4.6, 1.85), abs=0.02)


def test_long_flank_is_a_truck():
    (truck,) = recognise_points(line((12.0, 3.0), (26.0, 3.0), 30))
    assert truck.category is Category.TRUCK
    assert truck.size[0] == pytest.approx(14.0)


@pytest.mark.parametrize(
    "points",
    [
        line((20.0, -0.2), (20.0, 0.2)),
        line((20.0, 3.0), (45.0, 3.0), 40),
        np.concatenate([line((20.0, 0), (20.0, 4.0)), line((20.4, 4.0), (24, 4.0))]),
        line((20.0, -0.9), (20.0, 0.9), 2),
        np.concatenate([line((20.0, 0), (20, 2.5)), line((20.3, 2.7), (23, 5.0))]),
    ],
    ids=["pole", "rail", "too wide", "two points", "corner of 45 deg"],
)
def test_other_shapes_are_no_vehicles(points):
    assert recognise_points(points) == []


def test_ragged_outline_has_too_many_segments():
    rng = np.random.default_rng(3)
    points = np.column_stack([20 + rng.uniform(0, 2, 12), np.linspace(0, 2.4, 12)])
    assert recognise_points(points) == []


def beside(azimuth, range_m):
    """Something that stands at one azimuth."""
    return Horizon(np.array([azimuth]), np.array([range_m]), np.radians(0.25), None, np.zeros(2))


def test_hidden_side_is_where_the_body_goes_on():
    """The right of the face is hidden: its left end and the usual width tell the middle."""
    face = line((20.0, -0.1), (20.0, 0.9))
    hidden = beside(np.arctan2(-0.1, 20.0) - np.radians(0.25), 10.0)
    (car,) = recognise_points(face, horizon=hidden)
    assert car.centre == pytest.approx((22.3, 0.9 - 1.85 / 2))
    behind = beside(np.arctan2(-0.1, 20.0) - np.radians(0.25), 30.0)
    assert recognise_points(face, horizon=behind) == []


def test_flank_cut_by_the_field_of_view_goes_on_outside():
    flank = line((7.0, 3.0), (2.2, 3.0), 20)[:10]
    view = (-1.0, float(np.arctan2(3.0, flank[-1, 0])))
    cut = Horizon(np.empty(0), np.empty(0), np.radians(0.25), view, np.zeros(2))
    (car,) = recognise_points(flank, horizon=cut)
    assert car.centre == pytest.approx((7.0 - 2.3, 3.0 + 1.85 / 2))
    assert car.yaw == pytest.approx(0.0)


def test_wall_hidden_at_both_ends_has_no_known_size():
    wall = line((20.0, -3.0), (20.0, 3.0), 20)
    ends = np.arctan2([-3.0, 3.0], 20.0) + np.radians([-0.25, 0.25])
    trees = Horizon(ends, np.array([15.0, 15.0]), np.radians(0.25), None, np.zeros(2))
    assert recognise_points(wall, horizon=trees) == []
    assert len(recognise_points(wall)) == 1


def test_noise_at_a_split_is_no_corner():
    rng = np.random.default_rng(1)
    recognised = 0
    for _ in range(50):
        face = line((20.0, -0.9), (20.0, 0.9), 20)
        face[:, 0] += 0.1 * rng.standard_normal(20)
        recognised += len(recognise_points(face))
    assert recognised >= 47


def test_a_jump_separates_two_vehicles_of_one_cluster():
    left, right = line((20.0, 3.6), (20.0, 1.9)), line((20.0, 0.0), (20.0, -1.7))
    assert [v.centre[1] for v in recognise_points(left, right)] == pytest.approx([2.75, -0.85])


def test_a_jump_inside_a_straight_segment_separates_too():
    pieces = np.concatenate([line((20.0, 3.6), (20.0, 1.9)), line((20.0, 0.0), (20.0, -1.7))])
    assert len(recognise(pieces, np.array([[0, len(pieces) - 1]]), FREE)) == 2
    assert recognise(pieces[:0], np.empty((0, 2), np.int64), FREE) == []


def chains_one_by_one(points, ends):
    """Lines of each body, piece by piece, with the line fit of a `Segment`."""
    chains, chain = [], []
    for first, last in ends:
        piece = points[first : last + 1]
        jumps = np.flatnonzero(np.hypot(*np.diff(piece, axis=0).T) > GAP_M)
        parts = np.split(piece, jumps + 1)
        chain.append(parts[0])
        for part in parts[1:]:
            chains.append(chain)
            chain = [part]
    for body in [*chains, chain]:
        joined = []
        for piece in body:
            both = np.concatenate([joined[-1], piece[1:]]) if joined else piece
            if joined and Segment(both).residual_m <= JOIN_M:
                joined[-1] = both
            else:
                joined.append(piece)
        extent = np.hypot(*np.ptp(np.concatenate(body), axis=0))
        lines, count = sum(len(p) > 1 for p in joined), sum(len(p) for p in joined)
        if extent >= HALF_FACE_M and 1 <= lines <= 3 and count >= 3:
            yield joined


@given(st.integers(1, 25).flatmap(lambda n: arrays(float, (n, 2), elements=st.floats(-2, 2))))
def test_lines_equal_the_slow_computation(points):
    points = np.round(points, 1) * [1, 0.2] + np.linspace(0, 2, len(points))[:, None] ** 2
    ends = split_ends(points, 0.3)
    slow = [(k, len(p)) for k, c in enumerate(chains_one_by_one(points, ends)) for p in c]
    rows = face_ends(points, ends, FACES)
    numbers = np.unique(rows[:, 0], return_inverse=True)[1]
    assert list(zip(numbers, rows[:, 2] - rows[:, 1] + 1, strict=True)) == slow
