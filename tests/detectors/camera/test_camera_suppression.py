import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.benchmarks.metrics import image_overlaps
from roadscope.detectors.camera import SAME_IOU, distinct


def test_of_two_boxes_in_one_place_the_better_stays() -> None:
    boxes = np.array([[0, 0, 20, 20], [1, 1, 21, 21], [1, 1, 21, 21], [40, 0, 50, 9]], float)
    assert distinct(boxes, np.array([0, 0, 2, 0]), SAME_IOU).tolist() == [0, 2, 3]


def test_what_is_suppressed_suppresses_nothing() -> None:
    boxes = np.array([[0, 0, 20, 10], [5, 0, 25, 10], [10, 0, 30, 10]], float)
    assert distinct(boxes, np.zeros(3, int), 0.5).tolist() == [0, 2]


def slowly_distinct(boxes: np.ndarray, families: np.ndarray, most_iou: float) -> list[int]:
    """Take one after the other unless one that was taken overlaps it too much: the reference."""
    overlaps = image_overlaps(boxes, boxes)
    taken: list[int] = []
    for i in range(len(boxes)):
        rivals = [k for k in taken if families[k] == families[i]]
        if not (overlaps[i, rivals] > most_iou).any():
            taken.append(i)
    return taken


@given(
    arrays(np.float64, (12, 4), elements=st.integers(0, 12).map(float)),
    arrays(np.int64, 12, elements=st.integers(0, 2)),
    st.sampled_from([0.3, SAME_IOU, 0.9]),
)
def test_suppression_is_that_of_its_definition(
    drawn: np.ndarray, families: np.ndarray, most_iou: float
) -> None:
    boxes = np.concatenate([drawn[:, :2], drawn[:, :2] + drawn[:, 2:] + 1], axis=1)
    expected = slowly_distinct(boxes, families, most_iou)
    assert distinct(boxes, families, most_iou).tolist() == expected
