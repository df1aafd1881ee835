"""When steps from scan to scan are accepted."""

import numpy as np
import pytest

from roadscope.odometry import exp_se3
from roadscope.odometry.loam import PATIENCE, SURE, FeatureMatch, ImuPrediction, Progress

PERIOD_S, WAY_M = 0.1, 0.8


def stepped(progress, ways_m, turn=0.0):
    """Poses' x and reasons after steps of given lengths by features, one for each scan."""
    progress_log = []
    for distance_m in ways_m:
        stamp_s = 0.0 if np.isnan(progress.stamp_s) else progress.stamp_s + PERIOD_S
        predicted = progress.predicted(stamp_s)
        if not stamp_s:
            progress.carry_on(predicted, stamp_s, counts=True)
            continue
        motion = exp_se3(np.array([distance_m, 0, 0, 0, 0, turn]))
        feature_match = FeatureMatch(motion, 1e6 * np.eye(6), 0.01, 100)
        _, reason = progress.step(predicted, feature_match, stamp_s)
        progress_log.append((progress.pose[0, 3], reason))
    return [x for x, _ in progress_log], [reason for _, reason in progress_log]


def driving(steps):
    progress = Progress(ImuPrediction(None))
    # The first scan begins; before a step there is no speed, and the first one leaps.
    stepped(progress, [0.0, *[WAY_M] * (1 + steps)])
    return progress


def test_a_leap_from_a_sure_prediction_is_rejected_at_first():
    progress = driving(SURE)
    start = progress.pose[0, 3]
    places, reasons = stepped(progress, [0.0] * (PATIENCE + 2))
    assert all("a leap of 0.8 m" in reason for reason in reasons[: PATIENCE + 1])
    assert reasons[-1] == ""
    travelled_m = WAY_M * np.minimum(np.arange(1, PATIENCE + 3), PATIENCE)
    assert places == pytest.approx(start + travelled_m)


def test_a_leap_that_ends_leaves_no_trace():
    progress = driving(SURE)
    start = progress.pose[0, 3]
    for _ in range(3):
        places, reasons = stepped(progress, [0.0] * PATIENCE + [WAY_M] * SURE)
        assert not any(reasons[PATIENCE:])
    assert places[-1] == pytest.approx(start + 3 * WAY_M * (PATIENCE + SURE))


def test_leaps_are_accepted_before_predictions_are_sure():
    progress = driving(SURE - 1)
    start = progress.pose[0, 3]
    places, reasons = stepped(progress, [0.0, 0.0])
    assert places == pytest.approx([start, start])
    assert reasons == ["", ""]


def test_a_turn_leaps_too():
    _, reasons = stepped(driving(SURE), [WAY_M], turn=0.2)
    assert "a leap of 0.2 rad" in reasons[0]
