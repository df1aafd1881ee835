import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope.benchmarks import Eligibility
from roadscope.benchmarks.nodes import oracle_detections
from roadscope.core import Pose, RecordError


def test_range_is_the_horizontal_distance_from_the_ego() -> None:
    rule = Eligibility(range_m=(5.0, 20.0), min_returns=1)
    there = truth(
        [[104, 50], [105, 50], [120, 50], [121, 50]],
        world_from_ego=Pose.planar(100.0, 50.0, 1.0, z_m=7.0),
    )
    assert rule.of(there).tolist() == [False, True, True, False]
    assert rule.within(np.array([[100.0, 70.0, 0.0]]), there).tolist() == [True]


def test_families() -> None:
    people = truth([[10, 0], [11, 0], [12, 0]], categories=np.array([3, 5, 6]))
    assert Eligibility().of(people).tolist() == [True, False, False]
    both = Eligibility(families=("cyclist", "pedestrian"))
    assert both.of(people).tolist() == [False, True, True]


def test_parked_cars_come_after_the_objects_and_are_not_eligible() -> None:
    pairing = Eligibility().pairing(
        detections([[10, 0], [80, 0]]), truth([[10, 0]]), np.array([[10.0, 3.0]])
    )
    assert pairing.distances[0].tolist() == [0.0, 3.0]
    assert pairing.eligible.tolist() == [True, False]
    assert pairing.counted.tolist() == [True, False]


def test_the_oracle_finds_what_is_eligible() -> None:
    oracle = oracle_detections(truth([[10, 0], [20, 0]], returns=[50, 3]), Eligibility())
    assert oracle.centres[:, 0].tolist() == [10.0]
    assert oracle.frame == "world"


@pytest.mark.parametrize(
    "fields",
    [{"range_m": (-1.0, 5.0)}, {"range_m": (5.0, 5.0)}, {"min_returns": 0}, {"families": ()}],
)
def test_rules_that_make_no_sense_are_refused(fields) -> None:
    with pytest.raises(RecordError, match=next(iter(fields))):
        Eligibility(**fields)
