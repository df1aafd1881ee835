import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_boxes import detections, truth

from roadscope.benchmarks.metrics import Match, axis_error_deg, box_errors, box_overlaps_from_above

NONE = np.empty(0, np.int64)


def paired(*pairs) -> Match:
    rows, columns = np.array(pairs, np.int64).reshape(-1, 2).T
    return Match(rows, columns, NONE, NONE, NONE)


def test_front_and_rear_are_not_distinguished() -> None:
    errors = axis_error_deg(np.array([0.0, math.pi, math.pi / 4, -0.1]), np.zeros(4))
    assert np.abs(errors) == pytest.approx([0, 0, 45, math.degrees(0.1)], abs=1e-9)


@given(st.floats(-math.pi, math.pi), st.floats(-1, 1), st.floats(-1, 1))
def test_position_errors_turn_with_the_object(yaw, along, across) -> None:
    c, s = math.cos(yaw), math.sin(yaw)
    place = [[30 + c * along - s * across, 40 + s * along + c * across]]
    errors = box_errors(
        [detections(place)],
        [truth([[0, 0], [30, 40]], yaws=np.array([0.0, yaw]))],
        [paired((0, 1))],
    )
    assert errors.longitudinal_m == pytest.approx([along], abs=1e-9)
    assert errors.lateral_m == pytest.approx([across], abs=1e-9)


def test_pairs_are_compared_as_matched() -> None:
    there = truth([[0, 0], [9, 0]], categories=np.array([1, 0]))
    errors = box_errors(
        [detections([[9, 0], [0, 0]], sizes=(5.0, 1.8, 1.5))], [there], [paired((0, 1), (1, 0))]
    )
    assert errors.size_m.tolist() == [[0.5, 0.0], [0.5, 0.0]]
    assert errors.category_is_right.tolist() == [True, False]
    assert np.abs(errors.longitudinal_m).max() == 0.0


def test_no_pairs() -> None:
    errors = box_errors([detections([])], [truth([[0, 0]])], [paired()])
    assert errors.size_m.shape == (0, 2)
    assert box_errors([], [], []).longitudinal_m.shape == (0,)


def test_overlaps_from_above() -> None:
    objects = truth([[0, 0.9], [4.5, 0], [50, 0]])
    overlaps = box_overlaps_from_above(detections([[0, 0], [50, 0]]), objects)
    assert overlaps == pytest.approx(np.array([[1 / 3, 0, 0], [0, 0, 1]]))
    assert box_overlaps_from_above(detections([]), truth([[0, 0]])).shape == (0, 1)
