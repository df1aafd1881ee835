"""Our own fusion beside Li 2021's, with the shipped network, on validation seeds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadscope.benchmarks.papers import li2021
from roadscope.detectors.camera import CAMERA_DETECTORS

SEEDS = range(10300, 10306)
OURS, THEIRS = "consistent", "li2021"
FAMILIES = (li2021.VEHICLES, li2021.CYCLISTS, li2021.PEDESTRIANS)

Mean = Callable[[str, str, str], float]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def mean() -> Mean:
    """Return a figure's mean over the seeds by condition, method and quantity."""
    network = CAMERA_DETECTORS.make("network")
    measured = [li2021.measure_with(network, seed) for seed in SEEDS]
    return lambda *key: float(np.nanmean([found[key] for found in measured]))


def test_all_are_compared_at_as_many_false_alarms(mean: Mean) -> None:
    for condition in li2021.WITH_BOTH:
        for method in li2021.METHODS:
            assert mean(condition, method, li2021.FALSE) <= li2021.EQUAL_FALSE + 1e-9


@pytest.mark.parametrize("condition", ["clear", "fog", "night"])
def test_ours_finds_more_of_every_family_and_at_the_right_distance(
    mean: Mean, condition: str
) -> None:
    more = [mean(condition, OURS, f) - mean(condition, THEIRS, f) for f in FAMILIES]
    assert min(more) > -1.0
    assert np.mean(more) > 10.0
    right = [mean(condition, each, li2021.DISTANCE) for each in (OURS, THEIRS)]
    assert right[0] > right[1] + 3.0


def test_crowds_are_told_apart_better(mean: Mean) -> None:
    for quantity, by in ((li2021.PEDESTRIANS, 10.0), (li2021.DISTANCE, 3.0)):
        assert mean("crowds", OURS, quantity) > mean("crowds", THEIRS, quantity) + by


@pytest.mark.parametrize("condition", li2021.WITH_BOTH)
def test_distance_stays_right_of_what_is_partly_hidden(mean: Mean, condition: str) -> None:
    ours, theirs = (mean(li2021.HIDDEN, each, condition) for each in (OURS, THEIRS))
    assert ours > theirs + 10.0
    assert ours > 70.0


@pytest.mark.parametrize("family", [li2021.VEHICLES, li2021.PEDESTRIANS])
def test_fog_costs_no_more_than_five_points(mean: Mean, family: str) -> None:
    assert mean("clear", OURS, family) - mean("fog", OURS, family) < 5.0


def test_fog_leaves_the_distance_right(mean: Mean) -> None:
    cost = [mean("clear", m, li2021.DISTANCE) - mean("fog", m, li2021.DISTANCE)
            for m in (OURS, THEIRS)]  # fmt: skip
    assert cost[0] < 12.0 < cost[1]


@pytest.mark.parametrize(
    ("condition", "left"), [("LiDAR fails", li2021.CAMERA), ("camera fails", li2021.LIDAR)]
)
def test_a_sensor_that_fails_leaves_no_less_than_the_other_alone(
    mean: Mean, condition: str, left: str
) -> None:
    more = [mean(condition, OURS, f) - mean(condition, left, f) for f in FAMILIES]
    assert min(more) > -3.0  # a rate over six seeds is known to 4 points or so
    assert np.mean(more) > 0.0


@pytest.mark.parametrize("condition", li2021.WITH_BOTH)
def test_both_sensors_find_more_than_the_better_one(mean: Mean, condition: str) -> None:
    families = FAMILIES if condition != "crowds" else (li2021.PEDESTRIANS,)
    for family in families:
        alone = max(mean(condition, one, family) for one in (li2021.LIDAR, li2021.CAMERA))
        assert mean(condition, OURS, family) > alone
