import numpy as np

from roadscope.core import Category
from roadscope.detectors.camera import UNIT_PX, Peaks
from roadscope.detectors.camera import decode as read

Maps = tuple[np.ndarray, np.ndarray, np.ndarray]


def blank(h: int = 8, w: int = 10) -> Maps:
    return np.full((3, h, w), -8.0), np.full((4, h, w), 6.0), np.zeros((5, h, w))


def decode(heat: np.ndarray, distances: np.ndarray, vehicles: np.ndarray, least: float) -> Peaks:
    """Read maps of every second pixel, packed as the network answers: four parts to a place."""
    maps = np.concatenate([heat, np.log(distances / UNIT_PX), vehicles])
    rows, columns = (n // 2 for n in heat.shape[1:])
    parts = maps.reshape(12, rows, 2, columns, 2).transpose(1, 3, 2, 4, 0)
    answers = parts.reshape(rows, columns, 4, 12)
    return read(answers, height_px=4 * rows, width_px=4 * columns, least_log_odds=least)


def test_a_peak_becomes_its_box() -> None:
    heat, distances, vehicles = blank()
    heat[0, 3, 5] = 2.0
    heat[0, 3, 6] = 1.0
    distances[:, 3, 5] = (10.0, 4.0, 12.0, 5.0)
    distances[:, 3, 6] = (12.0, 4.0, 10.0, 5.0)
    vehicles[Category.TRUCK, 3, 5] = 3.0
    peaks = decode(heat, distances, vehicles, 0.0)
    # The other answer names the same box; both end at the edge of the image.
    chances = 1 / (1 + np.exp(-np.array([2.0, 1.0])))
    np.testing.assert_allclose(peaks.boxes, [[11 - 10, 7 - 4, 20, 7 + 5]])
    assert peaks.categories.tolist() == [Category.TRUCK]
    assert peaks.log_odds.tolist() == [2.0]
    np.testing.assert_allclose(peaks.traits[0, 7:], [np.log1p(chances.sum()), 1.0])


def test_answers_that_name_about_the_same_box_are_averaged() -> None:
    heat, distances, vehicles = blank(16, 16)
    heat[0, 6, 6], heat[0, 6, 7] = 2.0, 1.0
    distances[:, 6, 6] = distances[:, 6, 7] = (10.0, 8.0, 10.0, 8.0)
    peaks = decode(heat, distances, vehicles, 0.0)
    weights = 1 / (1 + np.exp([-2.0, -1.0])) * [1.0, 18 / 22]
    left = np.average([13.0 - 10, 15.0 - 10], weights=weights)
    np.testing.assert_allclose(peaks.boxes, [[left, 5, left + 20, 21]])


def test_two_people_side_by_side_are_two() -> None:
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
