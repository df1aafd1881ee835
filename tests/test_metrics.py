"""The metrics as outsiders call them; their values are compared elsewhere with references."""

import math

import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope import Detections, ImageDetections, Pose, Truth, metrics


def boxes(xs: list[float], scores: list[float]) -> Detections:
    return detections([(x, 0.0) for x in xs], scores=scores)


def objects(xs: list[float]) -> Truth:
    return truth([(x, 0.0) for x in xs])


def straight(scale: float = 1.0, count: int = 301) -> list[Pose]:
    return [Pose.planar(scale * x, 0.0, 0.0) for x in range(count)]


def test_drift_of_a_wrong_scale_is_the_scale() -> None:
    assert metrics.kitti_drift(straight(1.01), straight()).t_rel == pytest.approx(1.0, abs=0.02)
    short = metrics.kitti_drift(straight(1.01), straight(), lengths_m=[50.0], every=1)
    assert set(short.lengths_m) == {50.0}
    assert len(short) == 250
    assert math.isnan(metrics.kitti_drift(straight(count=50), straight(count=50)).t_rel)


def test_poses_may_be_arrays_or_records() -> None:
    estimate = np.array([pose.matrix for pose in straight(1.1, 11)])
    by_array = metrics.ate(estimate, straight(count=11), alignment="origin")
    assert by_array == metrics.ate(straight(1.1, 11), straight(count=11), alignment="origin")
    assert by_array.end_m == pytest.approx(1.0)
    assert metrics.rpe(estimate, straight(count=11), step=2).rmse_m == pytest.approx(0.2)


def test_a_shifted_trajectory_has_no_error_once_it_is_aligned() -> None:
    moved = [Pose.planar(5.0, 3.0, 1.0) @ pose for pose in straight(count=20)]
    assert metrics.ate(moved, straight(count=20)).rmse_m == pytest.approx(0.0, abs=1e-9)
    assert metrics.ate(moved, straight(count=20), alignment="none").rmse_m > 1.0


def test_precision_of_detections() -> None:
    true = objects([0.0, 10.0])
    assert metrics.average_precision([boxes([0.5, 9.0], [0.9, 0.8])], [true]).value == 1.0
    # One of two is found: precision 1 up to a recall of a half, which are 51 of 101 recalls.
    half = metrics.average_precision([boxes([0.5, 50.0], [0.9, 0.8])], [true])
    assert half.value == pytest.approx(51 / 101)
    assert metrics.average_precision([boxes([0.5], [0.9])], [true], gate_m=0.4).value == 0.0


def test_objects_that_are_not_required_are_neither_right_nor_wrong() -> None:
    true, required = objects([0.0, 10.0]), [np.array([True, False])]
    detected = [boxes([0.0, 10.0], [0.8, 0.9])]
    assert metrics.average_precision(detected, [true], required=required).value == 1.0
    missed = [boxes([0.0], [0.8])]
    assert metrics.average_precision(missed, [true], required=required).value == 1.0


def test_precision_of_image_boxes() -> None:
    true = np.array([[0.0, 0.0, 10.0, 10.0]])
    image_detections = ImageDetections(
        np.array([[0.0, 0.0, 10.0, 8.0], [50.0, 50.0, 60.0, 60.0]]),
        np.zeros(2, int),
        np.array([0.9, 0.3]),
        0.0,
    )
    assert metrics.image_average_precision([image_detections], [true]).ap == 1.0
    assert metrics.image_average_precision([image_detections], [true], least_iou=0.9).ap == 0.0
    assert metrics.image_average_precision([image_detections], [[]]).objects == 0


def test_scores_that_promise_too_much() -> None:
    scores, right = np.full(10, 0.95), np.arange(10) < 5
    assert metrics.calibration_error(scores, right).value == pytest.approx(0.45)


def test_errors_of_a_consistent_filter() -> None:
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(4000, 4)) * [2.0, 1.0, 0.5, 0.5]
    covariances = np.tile(np.diag([4.0, 1.0, 0.25, 0.25]), (4000, 1, 1))
    assert metrics.nees(errors[:, :2], covariances).mean == pytest.approx(2.0, abs=0.15)
    both = metrics.nees(errors[:, :2], covariances, velocity_errors=errors[:, 2:])
    assert both.freedom == 4
    assert both.mean == pytest.approx(4.0, abs=0.2)
    assert metrics.nees(3 * errors[:, :2], covariances).inside < 0.7


def test_a_perfect_track_has_perfect_scores() -> None:
    sequence = metrics.TrackedSequence.of([[4], [4]], [[9], [9]], distances_m=[[[0.0]], [[0.0]]])
    assert metrics.hota(sequence).hota.tolist() == [1.0] * len(metrics.ALPHAS)
    assert metrics.clear(sequence).mota == 1.0
    assert metrics.identity(sequence).idf1 == 1.0
    assert metrics.ospa(sequence).mean == metrics.gospa(sequence).mean == 0.0
    assert metrics.amota(sequence).samota == 1.0
