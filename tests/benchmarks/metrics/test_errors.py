import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_boxes import detections, truth

from roadscope.benchmarks.metrics.errors import axis_error_deg, box_errors
from roadscope.benchmarks.metrics.matching import Match

NONE = np.empty(0, np.int64)


def paired(*pairs) -> Match:
    rows, columns = np.array(pairs, np.int64).reshape(-1, 2).T
    return Match(rows, columns, NONE, NONE, NONE)


def test_front_and_rear_are_not_told_apart() -> None:
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
    assert errors.along == pytest.approx([along], abs=1e-9)
    assert errors.across == pytest.approx([across], abs=1e-9)


def test_pairs_are_compared_as_matched() -> None:
    there = truth([[0, 0], [9, 0]], categories=np.array([1, 0]))
    errors = box_errors(
        [detections([[9, 0], [0, 0]], sizes=(5.0, 1.8, 1.5))], [there], [paired((0, 1), (1, 0))]
    )
    assert errors.size.tolist() == [[0.5, 0.0], [0.5, 0.0]]
    assert errors.right_category.tolist() == [True, False]
    assert np.abs(errors.along).max() == 0.0


def test_no_pairs() -> None:
    errors = box_errors([detections([])], [truth([[0, 0]])], [paired()])
    assert errors.size.shape == (0, 2)
    assert box_errors([], [], []).along.shape == (0,)
