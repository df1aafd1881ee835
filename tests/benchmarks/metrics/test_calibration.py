import math

import numpy as np
import pytest

from roadscope.benchmarks.metrics import calibration_error, excess, pooled_calibration, score_bins


def test_bins_take_in_both_ends() -> None:
    assert score_bins(np.array([0.0, 0.05, 0.1, 0.999, 1.0])).tolist() == [0, 0, 1, 9, 9]


def test_by_hand() -> None:
    # Bin 8: mean score 0.85, half right; bin 2: 0.25, none right.
    bins = excess(np.array([0.8, 0.9 - 1e-9, 0.25]), np.array([True, False, False]))
    assert bins[8].value == pytest.approx(0.35)
    assert bins[2].value == pytest.approx(0.25)
    assert math.isnan(bins[0].value)
    assert {(gap.least, gap.most) for gap in bins} == {(-1.0, 1.0)}
    assert calibration_error(bins).value == pytest.approx((2 * 0.35 + 0.25) / 3)
    assert calibration_error(bins).n == 3


def test_scores_that_say_how_often_they_are_right_have_no_error_when_pooled() -> None:
    rng = np.random.default_rng(0)
    episodes = []
    for _ in range(400):
        scores = rng.random(40)
        episodes.append(excess(scores, rng.random(40) < scores))
    single = np.mean([calibration_error(bins).value for bins in episodes])
    parts = pooled_calibration(episodes)
    pooled = sum(p.value * p.weight for p in parts) / sum(p.weight for p in parts)
    assert single > 0.12
    assert 0 <= pooled < 0.015


def test_pooled_error_is_that_of_all_detections_together() -> None:
    rng = np.random.default_rng(1)
    scores, right = rng.random((3, 50)), rng.random((3, 50)) < 0.3
    parts = pooled_calibration([excess(s, r) for s, r in zip(scores, right, strict=True)])
    pooled = sum(p.value * p.weight for p in parts) / sum(p.weight for p in parts)
    whole = calibration_error(excess(scores.ravel(), right.ravel()))
    assert pooled == pytest.approx(whole.value)


def test_nothing_detected() -> None:
    assert math.isnan(calibration_error(excess(np.empty(0), np.empty(0, bool))).value)
