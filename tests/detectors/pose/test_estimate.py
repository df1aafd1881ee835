import numpy as np
import pytest

from roadscope.detectors.pose import (
    VehiclePose,
    axis_difference,
    checked_origin,
    checked_points,
    fit_multi,
    fit_single,
)


def test_corners_stand_round_the_centre():
    pose = VehiclePose(10.0, 5.0, np.pi / 2, 4.0, 2.0)
    assert np.allclose(pose.corners, [[11, 3], [11, 7], [9, 7], [9, 3]])
    assert np.allclose(pose.corners.mean(axis=0), pose.centre)


def test_yaw_is_wrapped():
    assert VehiclePose(0, 0, 7.0, 4, 2).yaw == pytest.approx(7.0 - 2 * np.pi)


@pytest.mark.parametrize(
    ("yaw", "reference", "difference"),
    [(0.1, 0.0, 0.1), (np.pi - 0.1, 0.0, -0.1), (-3.0, 3.0, 2 * np.pi - 6), (7 * np.pi, 0.0, 0.0)],
)
def test_axis_difference_knows_no_front(yaw, reference, difference):
    assert axis_difference(yaw, reference) == pytest.approx(difference)


@pytest.mark.parametrize(
    "fields", [(np.nan, 0, 0, 4, 2), (0, 0, np.inf, 4, 2), (0, 0, 0, 0, 2), (0, 0, 0, 4, -1)]
)
def test_pose_refuses_what_is_no_rectangle(fields):
    with pytest.raises(ValueError, match="VehiclePose"):
        VehiclePose(*fields)


def test_pose_refuses_a_covariance_of_wrong_shape():
    with pytest.raises(ValueError, match="covariance"):
        VehiclePose(0, 0, 0, 4, 2, covariance=np.eye(2))


def test_poses_compare_by_content():
    one, other = (VehiclePose(0, 0, 0, 4, 2, covariance=np.eye(3)) for _ in range(2))
    assert one == other
    assert one != VehiclePose(0, 0, 0, 4, 2)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.empty((0, 2)), "at least 1"),
        (np.zeros((3, 3)), "shape"),
        (np.array([[0.0, 1.0], [np.nan, 1.0]]), "row 1"),
        (np.array([[np.inf, 1.0]]), "row 0"),
    ],
)
def test_points_are_refused_by_name(points, message):
    with pytest.raises(ValueError, match=message):
        checked_points(points)


def test_an_origin_is_refused_by_name():
    with pytest.raises(ValueError, match="origin"):
        checked_origin(np.array([np.nan, 0]))


@pytest.mark.parametrize("stray", [300.0, 1e9])
def test_returns_that_no_vehicle_is_long_enough_for_are_refused(stray):
    points = np.array([[10.0, 0.0], [10.0, 1.0], [stray, 0.0]])
    size = {"length_m": 4.5, "width_m": 1.8}
    with pytest.raises(ValueError, match="returns of one vehicle must lie within 200 m"):
        fit_single(points, np.zeros(2), **size)
    with pytest.raises(ValueError, match="returns of one vehicle must lie within 200 m"):
        fit_multi([points[:2], points], [np.zeros(2)] * 2, [0.0, 0.1], **size)
    # A vehicle that went so far between two scans is another matter.
    fit_multi([points[:2], points[:2] + 250.0], [np.zeros(2)] * 2, [0.0, 8.0], **size)
