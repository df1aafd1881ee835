"""What records take, convert and refuse; the constructor of fused detections."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.core import (
    Category,
    Detections,
    FusedDetections,
    ImageDetections,
    Pose,
    RecordError,
    Tracks,
)


def in_space(n: int = 2, **changes: object) -> Detections:
    fields: dict[str, object] = {
        "centres": np.column_stack([10.0 + np.arange(n), np.zeros(n), np.ones(n)]),
        "sizes": np.full((n, 3), 2.0),
        "yaws": np.zeros(n),
        "categories": np.full(n, Category.PEDESTRIAN),
        "scores": np.full(n, 0.5),
        "frame": "ego",
        "stamp_s": 1.0,
    }
    return Detections(**{**fields, **changes})  # type: ignore[arg-type]


def in_image(n: int = 2, **changes: object) -> ImageDetections:
    fields: dict[str, object] = {
        "boxes": np.tile([10.0, 20.0, 30.0, 40.0], (n, 1)) + np.arange(n)[:, None],
        "categories": np.zeros(n, np.int8),
        "scores": np.full(n, 0.8),
        "stamp_s": 1.02,
    }
    return ImageDetections(**{**fields, **changes})  # type: ignore[arg-type]


@given(st.lists(st.sampled_from(list(Category)), max_size=5))
def test_whole_floats_are_taken_as_integers(categories: list[Category]) -> None:
    as_floats = np.array(categories, np.float64)
    made = in_space(len(categories), categories=as_floats)
    assert made == in_space(len(categories), categories=np.array(categories, np.int8))
    assert made.categories.dtype == np.int8


@pytest.mark.parametrize(
    ("categories", "named"),
    [
        ([0.0, 2.5], "2.5"),
        ([0.0, np.nan], "nan"),
        ([0.0, -np.inf], "-inf"),
        ([0, 300], "300"),
        ([0.0, 256.0], "256"),
        (["0", "1"], "'0'"),
        ([None, 1], "None"),
    ],
)
def test_values_that_would_change_are_refused_by_name(categories: list, named: str) -> None:
    with pytest.raises(RecordError, match=r"Detections.categories: ") as error:
        in_space(categories=categories)
    assert named in str(error.value)


def test_ids_as_floats() -> None:
    assert Tracks.of(in_space(), np.array([3.0, 7.0])).ids.tolist() == [3, 7]
    for ids in ([3.0, 7.5], [3.0, 2.0**63]):
        with pytest.raises(RecordError, match=r"Tracks.ids: "):
            Tracks.of(in_space(), np.array(ids))


def test_masks_are_true_or_false() -> None:
    fused = FusedDetections.of(in_space(), None)
    assert replace(fused, by_lidar=[1.0, 1]) == fused
    with pytest.raises(RecordError, match=r"by_lidar: .* got 3"):
        replace(fused, by_lidar=[1, 3])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("scores", [0.5, 1.5]),
        ("scores", [0.5, -0.1]),
        ("scores", [0.5, np.nan]),
        ("categories", [0, len(Category)]),
        ("categories", [0, -1]),
        ("boxes", [[10, 20, 9, 40], [10, 20, 30, 40]]),
        ("boxes", [[10, 20, 30, 19], [10, 20, 30, 40]]),
        ("boxes", [[10, 20, np.inf, 40], [10, 20, 30, 40]]),
    ],
)
def test_image_detections_refuse_nonsense(field: str, value: list) -> None:
    with pytest.raises(RecordError, match=rf"ImageDetections.{field}: "):
        in_image(**{field: value})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("categories", [0, 99]),
        ("scores", [0.5, 2.0]),
        ("sizes", [[1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]),
        ("image_boxes", [[10, 20, 9, 40], [10, 20, 30, 40]]),
    ],
)
def test_fused_detections_refuse_nonsense(field: str, value: list) -> None:
    fused = FusedDetections.of(in_space(), in_image(), pairs=np.array([[0, 0], [1, 1]]))
    with pytest.raises(RecordError, match=rf"FusedDetections.{field}: "):
        replace(fused, **{field: value})


def test_what_a_target_does_not_have_is_not_checked() -> None:
    of_camera = FusedDetections.of(None, in_image())
    assert len(replace(of_camera, sizes=np.zeros((2, 3)))) == 2


@pytest.mark.parametrize("fault", ["skewed", "scaled", "mirrored", "nan", "last row"])
def test_a_pose_is_a_rigid_transform(fault: str) -> None:
    matrix = Pose.from_euler(1, 2, 3, yaw=0.4, pitch=0.1, roll=-0.2).matrix.copy()
    if fault == "skewed":
        matrix[0, 1] += 1e-4
    elif fault == "scaled":
        matrix[:3, :3] *= 1.0001
    elif fault == "mirrored":
        matrix[:3, 0] *= -1
    elif fault == "nan":
        matrix[0, 3] = np.nan
    else:
        matrix[3, 0] = 0.1
    with pytest.raises(RecordError, match=r"Pose.matrix: "):
        Pose(matrix)


def test_fused_detections_of_pairs() -> None:
    lidar, camera = in_space(3), in_image(2, scores=[0.8, 0.3])
    fused = FusedDetections.of(lidar, camera, pairs=np.array([[2, 0]]))
    # The pair first, then what LiDAR alone has, then what the camera alone has.
    assert fused.by_lidar.tolist() == [True, True, True, False]
    assert fused.by_camera.tolist() == [True, False, False, True]
    assert fused.lidar_rows.tolist() == [2, 0, 1, -1]
    np.testing.assert_array_equal(fused.centres[:3], lidar.centres[[2, 0, 1]])
    np.testing.assert_array_equal(fused.distances_m, [12.0, 10.0, 11.0, -1.0])
    np.testing.assert_array_equal(fused.image_boxes[[0, 3]], camera.boxes)
    assert fused.has_image_box.tolist() == [True, False, False, True]
    # The pair's category and score are the camera's, whose score is greater.
    assert fused.categories.tolist() == [0, 6, 6, 0]
    assert fused.scores.tolist() == [0.8, 0.5, 0.5, 0.3]
    np.testing.assert_allclose(fused.masses.sum(axis=1), 1.0)
    np.testing.assert_allclose(
        fused.masses[:, [0, 2, 3]], [[0.8, 0, 0.2], [0, 0.5, 0.5], [0, 0.5, 0.5], [0.3, 0, 0.7]]
    )
    assert fused.stamp_s == lidar.stamp_s
    np.testing.assert_array_equal(fused.detections().centres, lidar.centres[[2, 0, 1]])


def test_scores_of_pairs_can_be_given() -> None:
    fused = FusedDetections.of(in_space(), in_image(), pairs=np.array([[0, 1]]), scores=[0.99])
    assert fused.scores.tolist() == [0.99, 0.5, 0.8]


def test_one_sensor_alone_and_none() -> None:
    assert FusedDetections.of(None, in_image()).stamp_s == 1.02
    assert len(FusedDetections.of(in_space(0), None)) == 0
    with pytest.raises(RecordError, match="one sensor"):
        FusedDetections.of(None, None)
    with pytest.raises(RecordError, match="frame world"):
        FusedDetections.of(in_space(frame="world"), None)


@pytest.mark.parametrize("pairs", [[[0, 2]], [[0, 0], [0, 1]], [[-1, 0]], [[0.5, 0]], [0, 1]])
def test_impossible_pairs_are_refused(pairs: list) -> None:
    with pytest.raises(RecordError, match="pairs"):
        FusedDetections.of(in_space(), in_image(), pairs=np.array(pairs))


def test_rows_with_projected_boxes() -> None:
    lidar = in_space(3)
    projected = np.array([[1.0, 2, 3, 4], [0, 0, 0, 0], [5, 6, 7, 8]])
    fused = FusedDetections.from_rows(
        lidar,
        in_image(1),
        lidar_rows=np.array([0, 1, 2]),
        camera_rows=np.array([-1, -1, 0]),
        lidar_boxes=projected,
    )
    assert fused.has_image_box.tolist() == [True, False, True]
    np.testing.assert_array_equal(fused.image_boxes, [[1, 2, 3, 4], [0, 0, 0, 0], [10, 20, 30, 40]])
    with pytest.raises(RecordError, match="as many"):
        FusedDetections.from_rows(lidar, None, lidar_rows=np.array([0]), camera_rows=np.array([]))
