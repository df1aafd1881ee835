import numpy as np
import pytest
from toy_boxes import detections, image_detections
from toy_camera import LOOK

from roadscope.core import Detections
from roadscope.fusion import IcpBoxFusion, WeightedBoxFusion, projected_boxes


def cars(*places: tuple[float, float]) -> Detections:
    return detections(places, scores=0.6, frame="ego")


def test_boxes_become_their_mean_by_scores() -> None:
    lidar = cars((20.0, 0.0))
    box = projected_boxes(lidar, LOOK)[0][0]
    shifted = box + np.array([6.0, 0, 6, 0])
    fused = WeightedBoxFusion().fuse(lidar, image_detections(shifted[None]), LOOK)
    assert np.allclose(fused.image_boxes[0], (0.6 * box + 0.9 * shifted) / 1.5)
    assert fused.scores.tolist() == pytest.approx([0.75])


def test_what_one_of_two_sensors_saw_counts_half_and_of_one_whole() -> None:
    lidar, far = cars((20.0, 0.0)), image_detections(np.array([[10.0, 200, 60, 260]]))
    both = WeightedBoxFusion().fuse(lidar, far, LOOK)
    assert sorted(both.scores) == pytest.approx([0.3, 0.45])
    assert WeightedBoxFusion().fuse(None, far, LOOK).scores.tolist() == pytest.approx([0.9])


def test_icp_takes_out_a_shift_that_all_boxes_share() -> None:
    lidar = cars((20.0, 5.0), (25.0, 0.0), (30.0, -6.0))
    boxes = projected_boxes(lidar, LOOK)[0]
    wide = (boxes[:, 2] - boxes[:, 0]).min()
    moved = image_detections(boxes + np.array([0.8 * wide, 0, 0.8 * wide, 0]))
    assert IcpBoxFusion().fuse(lidar, moved, LOOK).lidar_rows.tolist() == [0, 1, 2]
    assert (IcpBoxFusion(turns=0).fuse(lidar, moved, LOOK).lidar_rows == -1).any()
