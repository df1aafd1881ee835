import dataclasses
import pickle

import numpy as np
import pytest

from roadscope.core import (
    Calibration,
    CameraImage,
    Category,
    Detections,
    Family,
    Frame,
    ImageDetections,
    ImuSamples,
    LidarScan,
    Pose,
    RecordError,
    Tracks,
    TrackState,
    Truth,
)


def scan(n: int = 3, **changes: object) -> LidarScan:
    fields: dict[str, object] = {
        "points": np.arange(3 * n, dtype=np.float32).reshape(n, 3),
        "intensity": np.full(n, 0.5),
        "ring": np.zeros(n, int),
        "column": np.arange(n),
        "time_offset_s": np.zeros(n),
        "stamp_s": 0.5,
        "sensor": "lux",
    }
    return LidarScan(**{**fields, **changes})  # type: ignore[arg-type]


def detections(n: int = 2, **changes: object) -> Detections:
    fields: dict[str, object] = {
        "centres": np.arange(3.0 * n).reshape(n, 3),
        "sizes": np.full((n, 3), 2.0),
        "yaws": np.linspace(0, 1, n),
        "categories": np.zeros(n, int),
        "scores": np.ones(n),
        "frame": "ego",
        "stamp_s": 1.0,
    }
    return Detections(**{**fields, **changes})  # type: ignore[arg-type]


def tracks(n: int = 2, **changes: object) -> Tracks:
    fields: dict[str, object] = {
        "ids": np.arange(n),
        "centres": np.arange(3.0 * n).reshape(n, 3),
        "sizes": np.full((n, 3), 2.0),
        "yaws": np.zeros(n),
        "velocities": np.tile([3.0, 0.0], (n, 1)),
        "covariances": np.tile(np.diag([1.0, 2.0, 3.0, 4.0]), (n, 1, 1)),
        "categories": np.zeros(n, int),
        "scores": np.ones(n),
        "states": np.full(n, TrackState.CONFIRMED),
        "frame": "ego",
        "stamp_s": 1.0,
    }
    return Tracks(**{**fields, **changes})  # type: ignore[arg-type]


def truth() -> Truth:
    one = np.ones(1)
    return Truth(
        one.astype(int),
        one.astype(int),
        np.ones((1, 3)),
        np.ones((1, 3)),
        one,
        np.ones((1, 2)),
        one.astype(int),
        one.astype(int),
        one,
        Pose.identity(),
        0.0,
        np.zeros(4, int),
    )


ALL = [
    scan(),
    detections(),
    tracks(),
    truth(),
    Pose.planar(1, 2, 3),
    CameraImage(np.zeros((2, 3, 3), np.uint8), np.eye(3), 0.0, "camera"),
    ImuSamples(np.arange(2.0), np.zeros((2, 3)), np.zeros((2, 3))),
    ImageDetections(np.ones((1, 4)), np.zeros(1, int), np.ones(1), 0.0),
    Frame(0.5, Calibration((("lux", Pose.identity()),)), lidar=scan()),
]


@pytest.mark.parametrize("record", ALL, ids=lambda r: type(r).__name__)
def test_records_compare_by_content_and_survive_pickling(record: object) -> None:
    copy = pickle.loads(pickle.dumps(record))
    assert copy == record
    assert copy is not record
    assert record != object()


@pytest.mark.parametrize("record", ALL, ids=lambda r: type(r).__name__)
def test_records_are_frozen_and_slotted(record: object) -> None:
    name = dataclasses.fields(record)[0].name  # type: ignore[arg-type]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(record, name, None)
    assert not hasattr(record, "__dict__")


def test_records_differ_when_one_value_differs() -> None:
    assert scan(intensity=[0.5, 0.5, 0.6]) != scan()
    assert scan(4) != scan(3)
    assert detections(masses=np.ones((2, 3)) / 3) != detections()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": np.zeros((3, 2))}, r"LidarScan.points: expected shape \(N, 3\), got \(3, 2\)"),
        ({"ring": np.zeros(2, int)}, r"LidarScan.ring: .* N = 3 as in points, got \(2,\)"),
        ({"ring": [0.0, 0.5, 1.0]}, r"LidarScan.ring: not an array of int16: .* got 0.5"),
        ({"ring": [0, 1 << 16, 0]}, r"LidarScan.ring: not an array of int16: .* got 65536"),
        ({"points": np.full((3, 3), np.nan)}, r"LidarScan.points: must be finite, got nan"),
        ({"time_offset_s": [0.0, np.inf, 0.0]}, r"time_offset_s: must be finite, got inf"),
        ({"intensity": ["a", "b", "c"]}, r"LidarScan.intensity: not an array of float32"),
        ({"points": np.full((3, 3), 1e9)}, r"points: expected values from -5000 to 5000, got 1000"),
        ({"ring": [0, -1, 0]}, r"LidarScan.ring: expected values from 0 to 1023, got -1"),
        ({"column": [0, 1 << 20, 0]}, r"column: expected values from 0 to 65535, got 1048576"),
    ],
)
def test_a_wrong_scan_says_what_is_wrong(changes: dict[str, object], message: str) -> None:
    with pytest.raises(RecordError, match=message):
        scan(**changes)


def test_wrong_detections_and_tracks_are_refused() -> None:
    with pytest.raises(RecordError, match="sizes: expected positive lengths"):
        detections(sizes=np.zeros((2, 3)))
    with pytest.raises(RecordError, match="scores: expected values in 0 to 1"):
        detections(scores=[0.5, 1.5])
    with pytest.raises(RecordError, match="categories: expected values of Category, 0 to 6"):
        detections(categories=[0, 99])
    with pytest.raises(RecordError, match="sizes: expected positive lengths"):
        tracks(sizes=-np.ones((2, 3)))
    with pytest.raises(RecordError, match="states: expected values of TrackState, 0 to 2"):
        tracks(states=[1, 9])
    with pytest.raises(RecordError, match="ids: expected unique ids"):
        tracks(ids=[4, 4])


def test_moving_there_and_back_changes_nothing() -> None:
    there = Pose.planar(3, -2, 1.1)
    moved = detections().moved(there, "world")
    assert moved.frame == "world"
    back = moved.moved(there.inverse(), "ego")
    np.testing.assert_allclose(back.centres, detections().centres, atol=1e-12)
    np.testing.assert_allclose(back.yaws, detections().yaws, atol=1e-12)


def test_moving_tracks_turns_velocity_and_covariance() -> None:
    moved = tracks().moved(Pose.planar(0, 0, np.pi / 2), "world")
    np.testing.assert_allclose(moved.velocities, [[0, 3], [0, 3]], atol=1e-12)
    np.testing.assert_allclose(moved.covariances[0], np.diag([2, 1, 4, 3]), atol=1e-12)


def test_empty_records_select_and_families() -> None:
    assert len(Detections.empty(0.0)) == len(Tracks.empty(0.0)) == 0
    assert detections().select(np.array([True, False])).centres.tolist() == [[0, 1, 2]]
    assert {c.family for c in Category} == set(Family)
    with pytest.raises(KeyError, match="no sensor 'roof' in the calibration; known: lux"):
        Calibration((("lux", Pose.identity()),)).pose("roof")


@pytest.mark.parametrize("mask", [[True, False], [[True] * 3] * 3])
def test_a_mask_of_another_shape_selects_no_returns(mask: object) -> None:
    sweep = LidarScan(
        np.zeros((3, 3)), np.zeros(3), np.arange(3), np.arange(3), np.zeros(3), 0.0, "lidar"
    )
    assert sweep.select([2, 0]).ring.tolist() == [2, 0]
    assert sweep.select(sweep.ring > 0).ring.tolist() == [1, 2]
    with pytest.raises(IndexError, match="does not fit 3 rows"):
        sweep.select(np.array(mask))


def test_image_detections_are_selected_row_by_row() -> None:
    boxes = np.arange(12.0).reshape(3, 4)
    masses = np.array([[0.9, 0.0, 0.0, 0.1], [0.0, 0.5, 0.0, 0.5], [0.0, 0.0, 0.2, 0.8]])
    image_detections = ImageDetections(
        boxes, np.array([0, 5, 6], np.int8), np.array([0.9, 0.5, 0.2]), 1.5, masses, (640, 480)
    )
    sure = image_detections.select(image_detections.scores >= 0.5)
    assert sure == ImageDetections(
        boxes[:2], np.array([0, 5], np.int8), np.array([0.9, 0.5]), 1.5, masses[:2], (640, 480)
    )
    with pytest.raises(RecordError, match="select: expected a mask or an index array"):
        image_detections.select(0)  # type: ignore[arg-type]
