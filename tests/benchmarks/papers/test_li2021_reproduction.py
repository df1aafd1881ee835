import numpy as np
import pytest

from roadscope.benchmarks.metrics.fusion import FusionTargets, fusion_rates, match_targets
from roadscope.benchmarks.papers import li2021
from roadscope.benchmarks.papers.li2021_scene import Moment
from roadscope.benchmarks.papers.li2021_table import table_1
from roadscope.benchmarks.papers.reproduction_tables import MOST_COLUMNS
from roadscope.core import Calibration, Detections, Frame, ImageDetections, Pose, Truth
from roadscope.core.projection import Projection
from roadscope.fusion.overlap import projected_boxes

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LOOK = Projection.of(
    np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]),
    Pose.from_parts(OPTICAL, np.array([0.0, 0.0, 1.4])), 640, 480,
)  # fmt: skip


def test_table_1_is_the_papers_to_its_rounding_and_decides_as_printed() -> None:
    rows = table_1()
    decided = [row for row in rows if row.quantity == "decided as printed"]
    assert len(decided) == 6
    assert all(row.ours == 1.0 for row in decided)
    person = [r for r in rows if r.method == "pedestrian, fused" and r.unit == "share"]
    assert all(abs(row.ours - row.paper) < 0.0015 for row in person)


def moment() -> tuple[Moment, Detections]:
    """Two people beside one another: LiDAR has the left one, the camera the right one."""
    centres = np.array([[15.0, 0.5, 0.86], [15.0, -0.5, 0.86]])
    both = Detections(centres, np.tile([0.5, 0.6, 1.72], (2, 1)), np.zeros(2),
                      np.full(2, 6, np.int8), np.full(2, 0.95), "ego", 0.0)  # fmt: skip
    boxes, _ = projected_boxes(both, LOOK)
    camera = ImageDetections(boxes[1:], np.array([6], np.int8), np.array([0.9]), 0.0)
    targets = FusionTargets(np.array([2, 2]), centres, boxes, np.ones(2, bool), np.zeros(2))
    none = np.empty(0)
    truth = Truth(none, none, none.reshape(0, 3), none.reshape(0, 3), none, none.reshape(0, 2),
                  none, none, none, Pose.identity(), 0.0, none)  # fmt: skip
    return Moment(Frame(0.0, Calibration()), truth, camera, targets, LOOK), both.select(
        np.array([0])
    )


@pytest.mark.parametrize(
    ("method", "condition", "count"),
    [(li2021.LIDAR, "clear", 1), (li2021.CAMERA, "clear", 1), ("li2021", "clear", 2),
     ("li2021", "LiDAR fails", 1), ("consistent", "camera fails", 1)],
)  # fmt: skip
def test_who_is_asked_in_which_condition(method: str, condition: str, count: int) -> None:
    one, lidar = moment()
    fused = li2021.outcomes(method, [one], [lidar], condition)
    assert fused is not None
    assert len(fused[0]) == count
    assert li2021.outcomes(li2021.LIDAR, [one], [lidar], "LiDAR fails") is None


def test_a_note_says_whose_detections_the_cameras_are() -> None:
    for camera, words in ((li2021.IMAGES, "shipped network's"), (li2021.IMITATED, "imitation")):
        tables = (
            li2021.HIDDEN, li2021.CLASS, li2021.MORE_BOTH, li2021.MORE_ONE, li2021.CLAIMS,
            li2021.EVERY_SCORE,
        )  # fmt: skip
        for experiment in (*li2021.CONDITIONS, *tables):
            titled = li2021.titled(experiment, camera)
            assert li2021.split(titled) == (experiment, camera)
            assert words in str(li2021.note_of(titled))


def test_crowds_are_people_beside_people() -> None:
    one, _ = moment()
    assert li2021.crowded(one.targets).eligible.all()
    apart = FusionTargets(
        np.array([2, 2, 0]), np.array([[15.0, 0, 1], [20.0, 0, 1], [15.5, 0, 1]]),
        np.zeros((3, 4)), np.ones(3, bool), np.zeros(3),
    )  # fmt: skip
    assert not li2021.crowded(apart).eligible.any()


@pytest.mark.slow
def test_one_seed_gives_every_figure_of_the_paper() -> None:
    found = li2021.measure(10300)
    for camera in (li2021.IMAGES, li2021.IMITATED):
        clear = li2021.titled("clear", camera)
        assert {(li2021.titled(e, camera), *rest) for e, *rest in li2021.PAPER} <= set(found)
        right = [found[clear, each, li2021.DISTANCE] for each in ("consistent", "li2021")]
        assert right[0] > right[1]


def test_all_methods_of_a_condition_fit_one_table() -> None:
    judged = match_targets([], [])
    names = li2021.quantities(fusion_rates(judged))
    assert len(names) <= MOST_COLUMNS
    assert list(names)[-1] == li2021.FALSE
