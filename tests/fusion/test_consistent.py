"""Fusion of our own on scenes whose answer is known."""

import numpy as np
import pytest
from toy_boxes import detections, image_detections
from toy_camera import LOOK

from roadscope.core import Category, Detections, ImageDetections
from roadscope.fusion import FUSIONS, depths_of, places_at, projected_boxes

PERSON = (0.5, 0.6, 1.72)


def people(*places: tuple[float, float], size: tuple[float, ...] = PERSON) -> Detections:
    centres = np.array([[x, y, size[2] / 2] for x, y in places])
    return detections(
        centres, sizes=size, categories=Category.PEDESTRIAN, scores=0.7, frame="ego", stamp_s=1.0
    )


def image_boxes_of(*places: tuple[float, float]) -> ImageDetections:
    boxes, _ = projected_boxes(people(*places), LOOK)
    return image_detections(boxes, categories=Category.PEDESTRIAN, scores=0.8, stamp_s=1.01)


def test_of_two_in_line_each_keeps_its_own_distance() -> None:
    """The nearer hides part of the farther: overlap alone gives both boxes one number."""
    places = (10.0, 0.0), (19.0, 0.25)
    ours = FUSIONS.make("consistent").fuse(people(*places), image_boxes_of(*places), LOOK)
    both = ours.by_lidar & ours.by_camera
    assert sorted(ours.lidar_rows[both].tolist()) == [0, 1]
    assert np.allclose(np.sort(ours.distances_m[both]), [10.0, np.hypot(19.0, 0.25)])
    paper = FUSIONS.make("li2021").fuse(people(places[0]), image_boxes_of(*places), LOOK)
    only_near = FUSIONS.make("consistent").fuse(people(places[0]), image_boxes_of(*places), LOOK)
    assert paper.distances_m.max() < 11.0, "the paper lends the nearer one's distance to both"
    assert only_near.distances_m.max() == pytest.approx(19.0, rel=0.15)


def test_a_crowd_that_is_one_cluster_shares_its_distance() -> None:
    crowd = people((15.0, 0.0), size=(0.8, 2.6, 1.7))
    fused = FUSIONS.make("consistent").fuse(
        crowd, image_boxes_of((15.0, -0.9), (15.0, 0.0), (15.0, 0.9)), LOOK
    )
    detected = fused.by_camera
    assert detected.sum() == 3
    assert (fused.lidar_rows[detected] == 0).sum() >= 2
    assert np.allclose(fused.distances_m[detected], 15.0, atol=1.0)


def test_every_target_has_a_place_even_without_lidar() -> None:
    fused = FUSIONS.make("consistent").fuse(None, image_boxes_of((12.0, 2.0), (30.0, -4.0)), LOOK)
    assert fused.has_box.all()
    assert np.allclose(fused.centres[:, :2], [[12.0, 2.0], [30.0, -4.0]], atol=1.5)
    assert len(fused.detections()) == 2


def test_what_both_see_is_believed_more_than_what_one_sees() -> None:
    places = (12.0, 2.0), (18.0, -3.0)
    fused = FUSIONS.make("consistent").fuse(people(*places), image_boxes_of(places[0]), LOOK)
    both = fused.by_lidar & fused.by_camera
    assert fused.scores[both].min() > fused.scores[~both].max() + 0.2


@pytest.mark.parametrize("place", [(8.0, 1.0), (20.0, -3.0), (45.0, 5.0)])
def test_depth_from_height_and_foot(place: tuple[float, float]) -> None:
    view = image_boxes_of(place)
    logs, spreads = depths_of(view.boxes, view.categories, LOOK)
    assert np.exp(logs[0]) == pytest.approx(place[0], rel=0.06)
    assert 0.01 < spreads[0] < 0.15
    pixel, depth = LOOK.project(np.array([*place, 0.9]))
    assert np.allclose(places_at(pixel[None], depth[None], LOOK)[0], [*place, 0.9])


def test_a_box_cut_by_the_lower_edge_is_known_to_be_uncertain() -> None:
    whole = image_boxes_of((10.0, 0.0))
    cut = whole.boxes + np.array([0.0, 180.0, 0.0, 180.0])
    cut[:, 3] = 480.0
    _, spreads = depths_of(cut, whole.categories, LOOK)
    assert spreads[0] > 0.5
