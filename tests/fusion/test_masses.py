"""Evidence is worth what it says: masses on families are the shares that are right."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from toy_boxes import detections

from roadscope.benchmarks import Episode
from roadscope.benchmarks.papers import SensorPair, sense_pairs
from roadscope.core import ImageDetections
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import MOST, ClusterBoxes, camera_masses, ious, lidar_masses, masses_of

SEEDS = range(10320, 10322)
FEWEST = 60

Judged = tuple[np.ndarray, np.ndarray]


def test_what_the_score_leaves_open_is_ignorance_and_confusion_shares_the_rest() -> None:
    boxes = np.array([[0.0, 0, 10, 20], [30, 0, 40, 20]])
    image_detections = ImageDetections(boxes, np.array([0, 6], np.int8), np.array([0.5, 1.0]), 0.0)
    split = np.array([[0.9, 0.1, 0.0], [0.2, 0.7, 0.1], [0.05, 0.05, 0.9]])
    masses = masses_of(image_detections, split)
    np.testing.assert_allclose(masses[0], [0.45 * MOST, 0.05 * MOST, 0.0, 1 - 0.5 * MOST])
    np.testing.assert_allclose(masses[1], [*(MOST * split[2]), 1 - MOST])


@pytest.fixture(scope="module")
def moments() -> list[SensorPair]:
    network = CAMERA_DETECTORS.make("network")
    return [
        moment
        for seed in SEEDS
        for scenario in ("street", "town-crossing")
        for moment in sense_pairs(Episode(scenario, seed, "li2021", 8.0), every=8, detector=network)
    ]


def in_images(moment: SensorPair) -> Judged:
    assert moment.camera is not None
    near = ious(moment.camera.boxes, moment.targets.image_boxes) >= 0.5
    return camera_masses(moment.camera), families_among(near, moment)


def in_scans(moment: SensorPair) -> Judged:
    lidar_boxes = ClusterBoxes().detect(moment.scan)
    distances_m = np.linalg.norm(
        lidar_boxes.centres[:, None, :2] - moment.targets.centres[None, :, :2], axis=-1
    )
    return lidar_masses(lidar_boxes), families_among(distances_m <= 2.0, moment)


def families_among(near: np.ndarray, moment: SensorPair) -> np.ndarray:
    """(N, 3) bool, whether a target of each family may be meant."""
    columns = [near[:, moment.targets.families == k].any(axis=1) for k in range(3)]
    return np.column_stack(columns)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("judged", "edges"), [(in_images, (0.5, 0.65, 0.85)), (in_scans, (0.35, 0.65))]
)
def test_masses_are_the_shares_that_are_right(
    judged: Callable[[SensorPair], Judged], edges: tuple[float, ...], moments: list[SensorPair]
) -> None:
    parts = [judged(moment) for moment in moments]
    masses, real = (np.concatenate(column) for column in zip(*parts, strict=True))
    best = masses[:, :3].argmax(axis=1)
    best_masses, right = (each[np.arange(len(best)), best] for each in (masses, real))
    bins = np.digitize(best_masses, edges)
    for number in range(len(edges) + 1):
        inside = bins == number
        assert inside.sum() >= FEWEST
        assert right[inside].mean() == pytest.approx(best_masses[inside].mean(), abs=0.12)


def test_own_masses_go_before_scores() -> None:
    own = np.array([[0.1, 0.2, 0.3, 0.4]])
    with_masses = replace(detections([[0.0, 0.0]], frame="ego"), masses=own)
    np.testing.assert_array_equal(lidar_masses(with_masses), own)
