"""What is scored of a followed vehicle says what it should, and the weights fit it."""

import numpy as np
import pytest

from roadscope.core import Pose
from roadscope.detectors import MOVING_FEATURES, moving_features, moving_score_model, unsteadiness
from roadscope.detectors.moving import Candidate, Chain, Sighting
from roadscope.detectors.pose import VehiclePose


def sighting(k, y=0.0):
    """A flank 4 m long that goes by with 10 m/s, 20 m to the right."""
    x = np.linspace(0.0, 4.0, 9) + k
    points = np.column_stack([x, np.full(9, y - 20.0), np.linspace(0.3, 1.4, 9)])
    times, box = np.zeros(9), np.zeros(3)
    candidate = Candidate(points, np.arange(9), times, 0.0, np.zeros(2), box, 6.0)
    return Sighting.of(candidate, k / 10, Pose.identity())


def chain(sideways=0.0):
    made = Chain()
    for k in range(4):
        made.add(sighting(k, sideways * (-1) ** k))
    return made


def valued(made, pose):
    row = moving_features(made, made.sightings[-1], (np.arange(9) // 3).astype(np.int16), pose)
    return dict(zip(MOVING_FEATURES, row, strict=True))


def test_visible_parts_and_the_course_are_features():
    value = valued(chain(), VehiclePose(5.0, -20.9, 0.0, 4.4, 1.8))
    assert value["log_returns"] == pytest.approx(np.log(9))
    assert (value["levels"], value["sightings"], value["outside"]) == (3, 4, 0)
    assert value["speed_m_s"] == pytest.approx(10.0)
    assert value["unsteady_m"] == pytest.approx(0.0, abs=1e-9)
    assert value["askew_deg"] == pytest.approx(0.0, abs=1e-4)
    assert (value["long_m"], value["wide_m"]) == pytest.approx((4.0, 0.0))
    assert (value["bottom_m"], value["top_m"]) == pytest.approx((0.3, 1.4))


def test_a_box_across_the_course_is_askew_and_leaves_returns_outside():
    value = valued(chain(), VehiclePose(5.0, -20.9, np.pi / 2, 4.4, 1.8))
    assert value["askew_deg"] == pytest.approx(90.0)
    assert value["outside"] > 0.3


def test_what_jumps_about_is_unsteady():
    assert unsteadiness(chain(0.5)) > 0.3


def test_shipped_weights_fit_the_features():
    model = moving_score_model()
    assert set(model.curves) == set(model.names) == set(MOVING_FEATURES)
    for knots, weights in model.curves.values():
        assert len(knots) == len(weights) >= 2
        assert (np.diff(knots) > 0).all()
        assert np.isfinite(weights).all()


def test_one_steady_car_is_more_probable_than_one_that_jumps():
    pose = VehiclePose(5.0, -20.9, 0.0, 4.4, 1.8)
    rows = [
        moving_features(c, c.sightings[-1], (np.arange(9) // 3).astype(np.int16), pose)
        for c in (chain(), chain(0.7))
    ]
    steady, jumping = moving_score_model().probabilities(np.array(rows))
    assert steady > jumping
