"""All cases of Li 2021, 5.1, on boxes whose overlaps are known."""

import numpy as np
import pytest
from toy_boxes import detections, image_detections
from toy_camera import looking_ahead

from roadscope.core import Category, Detections, ImageDetections
from roadscope.fusion import Li2021Fusion, camera_masses, combine, lidar_masses, projected_boxes

LOOK = looking_ahead(height_m=1.0)


def lidar(*places: tuple[float, float], size=(2.0, 2.0, 2.0), category=Category.CAR) -> Detections:
    centres = np.array([[x, y, 1.0] for x, y in places]).reshape(-1, 3)
    return detections(
        centres, sizes=size, categories=category, scores=0.7, frame="ego", stamp_s=1.0
    )


def camera(*boxes: tuple[float, ...], category=Category.CAR) -> ImageDetections:
    return image_detections(boxes, categories=category, scores=0.8, stamp_s=1.01)


def box_of(x: float, y: float) -> np.ndarray:
    return projected_boxes(lidar((x, y)), LOOK)[0][0]


def test_without_overlap_both_keep_what_they_know() -> None:
    fused = Li2021Fusion().fuse(lidar((20, 6)), camera((300, 200, 340, 280)), LOOK)
    assert fused.by_camera.tolist() == [True, False]
    assert fused.by_lidar.tolist() == [False, True]
    assert fused.distances_m.tolist() == pytest.approx([-1.0, np.hypot(20, 6)])
    assert fused.lidar_rows.tolist() == [-1, 0]
    assert fused.has_box.tolist() == [False, True]


def test_a_match_has_the_image_box_and_lidar_number_and_distance() -> None:
    box = box_of(20, 0)
    fused = Li2021Fusion().fuse(lidar((30, 9), (20, 0)), camera(tuple(box)), LOOK)
    joint = np.flatnonzero(fused.by_lidar & fused.by_camera)
    assert joint.tolist() == [0]
    assert np.allclose(fused.image_boxes[0], box)
    assert fused.lidar_rows[0] == 1
    assert fused.distances_m[0] == pytest.approx(20.0)
    expected = combine(lidar_masses(lidar((20, 0))), camera_masses(camera(tuple(box))))
    assert np.allclose(fused.masses[0], expected[0])
    assert fused.scores[0] > 0.8


@pytest.mark.parametrize(("share", "joined"), [(0.15, False), (0.25, True), (0.9, True)])
def test_threshold_1_is_a_share_of_the_camera_box(share: float, joined: bool) -> None:
    left, top, right, bottom = box_of(20, 0)
    wide = (right - left) / share
    fused = Li2021Fusion().fuse(lidar((20, 0)), camera((right - wide, top, right, bottom)), LOOK)
    assert len(fused) == (1 if joined else 2)
    assert (fused.by_lidar & fused.by_camera).any() == joined


def test_of_several_lidar_boxes_the_greatest_overlap_lends_its_number() -> None:
    left, top, right, bottom = box_of(20, 0)
    pair = lidar((20, 1.0), (20, 0.2))
    fused = Li2021Fusion().fuse(pair, camera((left, top, right, bottom)), LOOK)
    assert fused.lidar_rows.tolist() == [1]


@pytest.mark.parametrize(
    ("shares", "number"), [((0.25,), 0), ((0.22, 0.25), -1), ((0.25, 0.35), 1), ((0.4, 0.35), 0)]
)
def test_of_several_lidar_boxes_one_above_threshold_2_lends(
    shares: tuple[float, ...], number: int
) -> None:
    """A camera box is laid over parts of LiDAR boxes of which it is known how much they cover."""
    pair = lidar((20, 1.3), (20, -1.3))
    boxes = projected_boxes(pair, LOOK)[0][: len(shares)]
    top, bottom = boxes[0, 1], boxes[0, 3]
    left, right = boxes[0, 2], boxes[-1, 0]
    if len(shares) == 1:
        width = (left - boxes[0, 0]) / shares[0]
        box = (left - shares[0] * width, top, left + (1 - shares[0]) * width, bottom)
    else:
        width = (right - left) / (1 - sum(shares))
        box = (left - shares[0] * width, top, right + shares[1] * width, bottom)
    fused = Li2021Fusion().fuse(pair.select(np.arange(len(shares))), camera(box), LOOK)
    assert fused.lidar_rows.tolist() == [number]
    assert fused.by_camera.tolist() == [True]
    assert (fused.distances_m >= 0).tolist() == [number >= 0]


def test_a_crowd_shares_one_number_and_distance() -> None:
    crowd = lidar((20, 0), size=(2.0, 4.0, 2.0), category=Category.PEDESTRIAN)
    left, top, right, bottom = projected_boxes(crowd, LOOK)[0][0]
    third = (right - left) / 3
    people = camera(
        *[(left + k * third, top, left + (k + 1) * third, bottom) for k in range(3)],
        category=Category.PEDESTRIAN,
    )
    fused = Li2021Fusion().fuse(crowd, people, LOOK)
    assert fused.lidar_rows.tolist() == [0, 0, 0]
    assert np.allclose(fused.distances_m, 20.0)
    assert (fused.categories == Category.PEDESTRIAN).all()


def test_a_box_beside_the_camera_is_cut_at_its_plane() -> None:
    long = lidar((2.0, 2.0), size=(12.0, 1.0, 2.0))
    boxes, visible = projected_boxes(long, LOOK)
    assert visible.tolist() == [True]
    assert boxes[0, 0] == 0.0
    near, _ = LOOK.project(np.array([8.0, 1.5, 2.0]))
    assert boxes[0, 2] == pytest.approx(near[0])
    _, visible = projected_boxes(lidar((-10, 0)), LOOK)
    assert visible.tolist() == [False]


def test_targets_are_ranked_by_their_class_or_by_being_any() -> None:
    box = tuple(box_of(20, 0))
    one, other = (
        Li2021Fusion(rank=rank).fuse(lidar((20, 0)), camera(box), LOOK) for rank in ("class", "any")
    )
    assert np.allclose(one.masses, other.masses)
    assert np.allclose(one.scores, one.masses[:, :3].max(axis=1))
    assert np.allclose(other.scores, 1 - other.masses[:, 3])
