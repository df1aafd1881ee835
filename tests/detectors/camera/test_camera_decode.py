import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.benchmarks.metrics.image_precision import box_ious
from roadscope.core import Category
from roadscope.detectors.camera.decode import SAME_IOU, UNIT_PX, Peaks, distinct
from roadscope.detectors.camera.decode import decode as read

Maps = tuple[np.ndarray, np.ndarray, np.ndarray]


def blank(h: int = 8, w: int = 10) -> Maps:
    return np.full((3, h, w), -8.0), np.full((4, h, w), 6.0), np.zeros((5, h, w))


def decode(heat: np.ndarray, distances: np.ndarray, vehicles: np.ndarray, least: float) -> Peaks:
    """Read maps of every second pixel, packed as the network answers: four parts to a place."""
    maps = np.concatenate([heat, np.log(distances / UNIT_PX), vehicles])
    rows, columns = (n // 2 for n in heat.shape[1:])
    parts = maps.reshape(12, rows, 2, columns, 2).transpose(1, 3, 2, 4, 0)
    return read(parts.reshape(rows, columns, 4, 12), least)


def test_a_peak_becomes_its_box() -> None:
    heat, distances, vehicles = blank()
    heat[0, 3, 5] = 2.0
    heat[0, 3, 6] = 1.0
    distances[:, 3, 5] = (10.0, 4.0, 12.0, 5.0)
    distances[:, 3, 6] = (12.0, 4.0, 10.0, 5.0)
    vehicles[Category.TRUCK, 3, 5] = 3.0
    peaks = decode(heat, distances, vehicles, 0.0)
    np.testing.assert_allclose(peaks.boxes, [[11 - 10, 7 - 4, 11 + 12, 7 + 5]])
    assert peaks.categories.tolist() == [Category.TRUCK]
    assert peaks.log_odds.tolist() == [2.0]


def test_two_who_stand_side_by_side_are_two() -> None:
    heat, distances, vehicles = blank()
    heat[2, 3, 5:8] = (2.0, 1.0, 1.5)
    distances[:, 3, 5:8] = np.array([[1.8, 5, 1.8, 5], [3.5, 5, 0.1, 5], [1.8, 5, 1.8, 5]]).T
    peaks = decode(heat, distances, vehicles, 0.0)
    assert peaks.log_odds.tolist() == [2.0, 1.5]


def test_families_keep_their_categories() -> None:
    heat, distances, vehicles = blank()
    heat[1, 1, 1], heat[2, 6, 8] = 1.0, 3.0
    vehicles[3] = 5.0
    peaks = decode(heat, distances, vehicles, 0.0)
    assert peaks.categories.tolist() == [Category.PEDESTRIAN, Category.CYCLIST]
    assert peaks.families.tolist() == [2, 1]


def test_low_peaks_and_empty_maps_give_nothing() -> None:
    assert len(decode(*blank(), 0.0)) == 0


def test_of_two_boxes_in_one_place_the_better_stays() -> None:
    boxes = np.array([[0, 0, 20, 20], [1, 1, 21, 21], [1, 1, 21, 21], [40, 0, 50, 9]], float)
    assert distinct(boxes, np.array([0, 0, 2, 0]), SAME_IOU).tolist() == [0, 2, 3]


def test_what_is_suppressed_suppresses_nothing() -> None:
    boxes = np.array([[0, 0, 20, 10], [5, 0, 25, 10], [10, 0, 30, 10]], float)
    assert distinct(boxes, np.zeros(3, int), 0.5).tolist() == [0, 2]


def slowly_distinct(boxes: np.ndarray, families: np.ndarray, most_iou: float) -> list[int]:
    """Take one after the other unless one that was taken overlaps it too much: the reference."""
    overlaps = box_ious(boxes, boxes)
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
