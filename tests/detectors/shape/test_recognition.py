import numpy as np
import pytest

from roadscope.core import Category
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.iepf import fit_iepf
from roadscope.detectors.shape.recognition import recognise
from roadscope.detectors.shape.segment import Segment

FREE = Horizon(np.empty(0), np.empty(0), np.radians(0.25), None, np.zeros(2))


def line(a, b, count=10):
    return np.linspace(a, b, count)


def recognise_points(*pieces, horizon=FREE):
    return recognise(fit_iepf(np.concatenate(pieces)), horizon)


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
    kept = 0
    for _ in range(50):
        face = line((20.0, -0.9), (20.0, 0.9), 20)
        face[:, 0] += 0.1 * rng.standard_normal(20)
        kept += len(recognise_points(face))
    assert kept >= 47


def test_a_jump_separates_two_vehicles_of_one_cluster():
    left, right = line((20.0, 3.6), (20.0, 1.9)), line((20.0, 0.0), (20.0, -1.7))
    assert [v.centre[1] for v in recognise_points(left, right)] == pytest.approx([2.75, -0.85])


def test_a_jump_inside_a_straight_segment_separates_too():
    pieces = np.concatenate([line((20.0, 3.6), (20.0, 1.9)), line((20.0, 0.0), (20.0, -1.7))])
    assert len(recognise([Segment(pieces)], FREE)) == 2
    assert recognise([], FREE) == []
