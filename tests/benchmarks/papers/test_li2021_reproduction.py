import numpy as np
import pytest

from roadscope.benchmarks.metrics.fusion import Targets, judge, rates
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
    targets = Targets(np.array([2, 2]), centres, boxes, np.ones(2, bool), np.zeros(2))
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


def test_crowds_are_people_beside_people() -> None:
    one, _ = moment()
    assert li2021.crowded(one.targets).eligible.all()
    apart = Targets(
        np.array([2, 2, 0]), np.array([[15.0, 0, 1], [20.0, 0, 1], [15.5, 0, 1]]),
        np.zeros((3, 4)), np.ones(3, bool), np.zeros(3),
    )  # fmt: skip
    assert not li2021.crowded(apart).eligible.any()


@pytest.mark.slow
def test_one_seed_gives_every_figure_of_the_paper() -> None:
    found = li2021.measure(10300)
    assert set(li2021.PAPER) <= set(found)
    assert found["clear", "consistent", li2021.DISTANCE] > found["clear", "li2021", li2021.DISTANCE]


def test_all_methods_of_a_condition_fit_one_table() -> None:
    judged = judge([], [])
    names = li2021.quantities(rates(judged))
    assert len(names) <= MOST_COLUMNS
    assert list(names)[-1] == li2021.FALSE
