from dataclasses import replace

import numpy as np
import pytest

from roadscope.benchmarks.metrics import (
    FALSE_ALARM,
    IGNORED,
    FusionTargets,
    fusion_rates,
    fusion_scores,
    match_targets,
    threshold_at,
)
from roadscope.core import Category, FusedDetections

CAR, PERSON = 0, 2


def targets(*rows: tuple[int, float, tuple[float, ...], bool]) -> FusionTargets:
    """Family, distance ahead, image box, eligible."""
    n = len(rows)
    return FusionTargets(
        np.array([r[0] for r in rows], np.int64),
        np.array([[r[1], 0.0, 1.0] for r in rows]).reshape(n, 3),
        np.array([r[2] for r in rows], float).reshape(n, 4),
        np.array([r[3] for r in rows], bool),
        np.zeros(n),
    )


def fused(*rows: tuple[float, float, tuple[float, ...], bool]) -> FusedDetections:
    """Score, distance ahead or -1, image box, found by the camera."""
    n = len(rows)
    far = np.array([r[1] for r in rows])
    camera = np.array([r[3] for r in rows])
    zero = np.zeros(n)
    return FusedDetections(
        np.full(n, Category.CAR, np.int8),
        np.array([r[0] for r in rows]),
        ~camera,
        camera,
        far >= 0,
        np.column_stack([far, zero, zero]),
        np.ones((n, 3)),
        zero,
        far,
        np.full(n, -1),
        np.ones(n, bool),
        np.array([r[2] for r in rows], float),
        np.tile([0.25, 0.25, 0.25, 0.25], (n, 1)),
        0.0,
    )


BOX, ELSEWHERE = (10.0, 10, 50, 60), (200.0, 10, 240, 60)


def test_the_camera_is_matched_in_the_image_and_lidar_in_space() -> None:
    real = targets((CAR, 20.0, BOX, True))
    for row, hit in (
        ((0.9, 40.0, BOX, True), True),
        ((0.9, 20.0, ELSEWHERE, True), False),
        ((0.9, 21.5, ELSEWHERE, False), True),
        ((0.9, 22.5, BOX, False), False),
    ):
        assert (match_targets([fused(row)], [real]).targets[0] == 0) == hit


def test_a_second_box_is_a_false_alarm_unless_on_what_does_not_count() -> None:
    real = targets((CAR, 20.0, BOX, True), (CAR, 30.0, ELSEWHERE, False))
    fused_targets = fused(
        (0.9, 20.0, BOX, True),
        (0.5, 20.0, BOX, True),
        (0.4, 30.0, ELSEWHERE, True),
        (0.3, 30.0, ELSEWHERE, True),
    )
    assert match_targets([fused_targets], [real]).targets.tolist() == [
        0,
        FALSE_ALARM,
        IGNORED,
        IGNORED,
    ]


def test_what_is_farther_than_sixty_metres_is_no_false_alarm() -> None:
    for distance, count in ((60.0, FALSE_ALARM), (60.1, IGNORED)):
        fused_targets = fused((0.9, distance, ELSEWHERE, True))
        assert match_targets([fused_targets], [targets((CAR, 20.0, BOX, True))]).targets == [count]


@pytest.mark.parametrize(
    ("reported_m", "true", "right"),
    [
        (20.9, 20.0, True),
        (22.1, 20.0, False),
        (5.9, 5.0, True),
        (6.1, 5.0, False),
        (-1.0, 20.0, False),
    ],
)
def test_a_distance_is_right_within_a_tenth_or_a_metre(
    reported_m: float, true: float, right: bool
) -> None:
    judged = match_targets([fused((0.9, reported_m, BOX, True))], [targets((CAR, true, BOX, True))])
    assert fusion_rates(judged).distance_right == float(right)


def test_rates_by_family_and_false_alarms_above_a_threshold() -> None:
    real = targets((CAR, 20.0, BOX, True), (PERSON, 30.0, ELSEWHERE, True))
    fused_targets = fused(
        (0.9, 20.0, BOX, True),
        (0.4, 30.0, ELSEWHERE, True),
        (0.6, 10.0, (500.0, 10, 520, 60), True),
    )
    judged = match_targets([fused_targets, fused_targets], [real, real])
    low, high = fusion_rates(judged), fusion_rates(judged, 0.5)
    assert (
        low.family_detection_rates[CAR],
        low.family_detection_rates[PERSON],
        low.false_alarms_per_scan,
    ) == (1.0, 1.0, 1.0)
    assert (
        high.family_detection_rates[CAR],
        high.family_detection_rates[PERSON],
        high.false_alarms_per_scan,
    ) == (1.0, 0.0, 1.0)
    assert high.detection_rate == 0.5
    assert high.target_counts == (2, 0, 2)
    assert np.isnan(high.family_detection_rates[1])
    assert low.family_right == 0.5
    strict = threshold_at(judged, 0.4)
    assert 0.6 < strict <= 0.9
    assert fusion_rates(judged, strict).false_alarms_per_scan == 0.0
    assert threshold_at(judged, 1.0) == 0.0


def test_scores_of_an_episode_by_hand() -> None:
    third = (300.0, 10, 340, 60)
    real = replace(
        targets((CAR, 20.0, BOX, True), (PERSON, 30.0, ELSEWHERE, True), (CAR, 40.0, third, True)),
        hidden=np.array([0.34, 0.0, 0.33]),
    )
    fused_targets = fused(
        (0.9, 20.0, BOX, True),
        (0.8, 10.0, (500.0, 10, 520, 60), True),
        (0.7, 10.0, (600.0, 10, 620, 60), True),
        (0.6, 50.0, third, True),
        (0.4, 30.0, ELSEWHERE, True),
    )
    scores = fusion_scores([fused_targets, fused_targets], [real, real])
    # From 0.5: two of three targets found, two false alarms, one miss.
    assert scores["detection_rate"].value == pytest.approx(2 / 3)
    assert scores["precision"].value == 0.5
    assert scores["f1"].value == pytest.approx(2 / (2 + 3 / 2))
    assert scores["false_alarms"].value == 2.0
    assert scores["distance_right"].value == 0.5
    # More than a third hidden is the first target alone.
    assert scores["hidden_distance_right"].value == 1.0
    assert scores["hidden_distance_right"].n == 2
    assert (scores["ap"].least, scores["ap"].most) == (0.0, 1.0)
    # Precision 1 at the recalls from 0 to 0.33, and 3 of 5 at those up to 1.
    assert scores["ap"].value == pytest.approx((34 + 67 * 3 / 5) / 101)
