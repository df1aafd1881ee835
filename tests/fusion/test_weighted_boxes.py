import numpy as np
import pytest

from roadscope.core import Category, Detections, ImageDetections, Pose, Projection
from roadscope.fusion import IcpBoxFusion, WeightedBoxFusion, projected_boxes

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LOOK = Projection.of(
    np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]),
    Pose.from_parts(OPTICAL, np.array([0.0, 0.0, 1.4])),
    640,
    480,
)


def cars(*places: tuple[float, float]) -> Detections:
    n = len(places)
    return Detections(
        np.array([[x, y, 0.75] for x, y in places]),
        np.tile((4.5, 1.8, 1.5), (n, 1)),
        np.zeros(n),
        np.zeros(n, np.int8),
        np.full(n, 0.6),
        "ego",
        0.0,
    )


def image(boxes: np.ndarray, score: float = 0.9) -> ImageDetections:
    n = len(boxes)
    return ImageDetections(boxes, np.full(n, Category.CAR, np.int8), np.full(n, score), 0.0)


def test_boxes_become_their_mean_by_scores() -> None:
    lidar = cars((20.0, 0.0))
    box = projected_boxes(lidar, LOOK)[0][0]
    shifted = box + np.array([6.0, 0, 6, 0])
    fused = WeightedBoxFusion().fuse(lidar, image(shifted[None]), LOOK)
    assert np.allclose(fused.image_boxes[0], (0.6 * box + 0.9 * shifted) / 1.5)
    assert fused.scores.tolist() == pytest.approx([0.75])


def test_what_one_of_two_sensors_saw_counts_half_and_of_one_whole() -> None:
    lidar, far = cars((20.0, 0.0)), image(np.array([[10.0, 200, 60, 260]]))
    both = WeightedBoxFusion().fuse(lidar, far, LOOK)
    assert sorted(both.scores) == pytest.approx([0.3, 0.45])
    assert WeightedBoxFusion().fuse(None, far, LOOK).scores.tolist() == pytest.approx([0.9])


def test_icp_takes_out_a_shift_that_all_boxes_share() -> None:
    lidar = cars((20.0, 5.0), (25.0, 0.0), (30.0, -6.0))
    boxes = projected_boxes(lidar, LOOK)[0]
    wide = (boxes[:, 2] - boxes[:, 0]).min()
    moved = image(boxes + np.array([0.8 * wide, 0, 0.8 * wide, 0]))
    assert IcpBoxFusion().fuse(lidar, moved, LOOK).lidar_rows.tolist() == [0, 1, 2]
    assert (IcpBoxFusion(turns=0).fuse(lidar, moved, LOOK).lidar_rows == -1).any()
