import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.detectors.shape import fit_iepf

finite = st.floats(-50, 50)
outlines = st.integers(1, 25).flatmap(lambda n: arrays(float, (n, 2), elements=finite))


@given(arrays(float, 2, elements=finite), finite, st.floats(-5, 5))
def test_distance_is_eq_4_where_there_is_a_slope(point, b, k):
    expected = abs(k * point[0] - point[1] + b) / np.sqrt(k**2 + 1)
    points = np.array([[0.0, b], point, [1.0, k + b]])
    assert len(fit_iepf(points, split_m=expected + 1e-9)) == 1
    assert len(fit_iepf(points, split_m=expected - 1e-9)) == 2


def test_vertical_line_and_equal_ends():
    aside, around = np.array([[0.0, 0], [3, 4], [0, 9]]), np.array([[0.0, 0], [3, 4], [0, 0]])
    assert [len(fit_iepf(aside, split_m=s)) for s in (2.99, 3.01)] == [2, 1]
    assert [len(fit_iepf(around, split_m=s)) for s in (4.99, 5.01)] == [2, 1]


def splits_by_recursion(points, limit):
    """Section 2.2 as it is said; indices of the ends of segments."""
    chord = points[-1] - points[0]
    length = np.linalg.norm(chord)

    def away(p):
        if length == 0:
            return np.linalg.norm(p - points[0])
        return abs(chord[0] * (p - points[0])[1] - chord[1] * (p - points[0])[0]) / length

    distances = [away(p) for p in points[1:-1]]
    if not distances or max(distances) <= limit:
        return [len(points)]
    at = 1 + int(np.argmax(distances))
    return splits_by_recursion(points[: at + 1], limit) + splits_by_recursion(points[at:], limit)


@given(outlines, st.sampled_from([0.1, 0.5, 5.0]))
def test_splits_as_in_the_paper(points, limit):
    segments = fit_iepf(points, split_m=limit)
    assert [len(s) for s in segments] == splits_by_recursion(points, limit)


@given(outlines)
def test_segments_cover_the_outline_and_share_their_ends(points):
    segments = fit_iepf(points, split_m=0.3)
    joined = np.concatenate([segments[0].points, *(s.points[1:] for s in segments[1:])])
    assert np.array_equal(joined, points)


def test_a_point_at_the_threshold_stays_on_the_line():
    points = np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 0.0]])
    assert len(fit_iepf(points, split_m=0.5)) == 1
    assert len(fit_iepf(points, split_m=0.49)) == 2


def test_corner_is_split_at_the_corner():
    flank = np.column_stack([np.linspace(24.6, 20, 12), np.full(12, 2.0)])
    rear = np.column_stack([np.full(8, 20.0), np.linspace(1.8, 0.2, 8)])
    turned = np.concatenate([flank, rear])
    angle = 0.7
    turned = turned @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    first, second = fit_iepf(turned, split_m=0.3)
    assert (len(first), len(second)) == (12, 9)
    assert abs(first.direction @ second.direction) < 0.05


@pytest.mark.parametrize(
    "points", [np.zeros((1, 2)), np.zeros((6, 2)), np.arange(12).reshape(6, 2)]
)
def test_single_duplicate_and_collinear_points_are_one_segment(points):
    (segment,) = fit_iepf(points.astype(float))
    assert len(segment) == len(points)
    assert np.abs(segment.residuals).max() < 1e-9


def test_nothing_gives_nothing():
    assert fit_iepf(np.empty((0, 2))) == []
