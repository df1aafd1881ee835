import numpy as np
import pytest
from toy_boxes import detections, image_detections, truth
from toy_camera import LOOK

from roadscope.benchmarks.metrics import FusionTargets, fusion_rates, match_targets
from roadscope.benchmarks.papers import (
    CAMERA,
    CAMERA_FAILS,
    CLAIMS,
    CLASS,
    CONDITIONS,
    EVERY_SCORE,
    FALSE,
    HIDDEN,
    IMAGES,
    IMITATED,
    LIDAR,
    LIDAR_FAILS,
    MORE_BOTH,
    MORE_ONE,
    MOST_COLUMNS,
    SensorPair,
    crowds_only,
    fuse,
    named_quantities,
    note_of,
    table_1,
    with_camera,
    without_camera,
)
from roadscope.core import Calibration, Category, Detections, Frame
from roadscope.fusion import projected_boxes


def test_table_1_is_the_papers_to_its_rounding_and_decides_as_printed() -> None:
    rows = table_1()
    decided = [row for row in rows if row.quantity == "decided as printed"]
    assert len(decided) == 6
    assert all(row.ours == 1.0 for row in decided)
    person = [r for r in rows if r.method == "pedestrian, fused" and r.unit == "share"]
    assert all(abs(row.ours - row.paper) < 0.0015 for row in person)


def a_pair() -> tuple[SensorPair, Detections]:
    """Two people beside one another: LiDAR has the left one, the camera the right one."""
    centres = np.array([[15.0, 0.5, 0.86], [15.0, -0.5, 0.86]])
    both = detections(
        centres, sizes=[0.5, 0.6, 1.72], categories=Category.PEDESTRIAN, scores=0.95, frame="ego"
    )
    boxes, _ = projected_boxes(both, LOOK)
    camera = image_detections(boxes[1:], categories=Category.PEDESTRIAN)
    targets = FusionTargets(np.array([2, 2]), centres, boxes, np.ones(2, bool), np.zeros(2))
    pair = SensorPair(Frame(0.0, Calibration()), truth([]), camera, targets, LOOK)
    return pair, both.select(np.array([0]))


@pytest.mark.parametrize(
    ("method", "condition", "count"),
    [
        (LIDAR, "clear", 1),
        (CAMERA, "clear", 1),
        ("li2021", "clear", 2),
        ("li2021", LIDAR_FAILS, 1),
        ("consistent", CAMERA_FAILS, 1),
    ],
)
def test_which_sensors_are_fused_in_which_condition(
    method: str, condition: str, count: int
) -> None:
    pair, lidar = a_pair()
    fused = fuse(method, [pair], [lidar], condition)
    assert fused is not None
    assert len(fused[0]) == count
    assert fuse(LIDAR, [pair], [lidar], LIDAR_FAILS) is None


def test_a_note_says_whose_detections_the_cameras_are() -> None:
    tables = (HIDDEN, CLASS, MORE_BOTH, MORE_ONE, CLAIMS, EVERY_SCORE)
    for camera, words in ((IMAGES, "shipped network's"), (IMITATED, "imitation")):
        for experiment in (*CONDITIONS, *tables):
            name = with_camera(experiment, camera)
            assert without_camera(name) == (experiment, camera)
            assert words in str(note_of("li2021", name))


def test_crowds_are_people_beside_people() -> None:
    pair, _ = a_pair()
    assert crowds_only(pair.targets).eligible.all()
    distant_targets = FusionTargets(
        np.array([2, 2, 0]),
        np.array([[15.0, 0, 1], [20.0, 0, 1], [15.5, 0, 1]]),
        np.zeros((3, 4)),
        np.ones(3, bool),
        np.zeros(3),
    )
    assert not crowds_only(distant_targets).eligible.any()


def test_all_methods_of_a_condition_fit_one_table() -> None:
    names = named_quantities(fusion_rates(match_targets([], [])))
    assert len(names) <= MOST_COLUMNS
    assert list(names)[-1] == FALSE
