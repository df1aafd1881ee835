from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import box
from toy_boxes import tracks, truth

from roadscope.benchmarks.metrics import image_overlaps
from roadscope.benchmarks.metrics.tracking import SIMILARITIES, similarity_by_distance
from roadscope.metrics import clear, hota, tracked_sequence

EDGE = st.floats(0, 100)
IMAGE_BOXES = st.tuples(EDGE, EDGE, EDGE, EDGE).map(
    lambda b: (min(b[0], b[2]), min(b[1], b[3]), max(b[0], b[2]) + 1, max(b[1], b[3]) + 1)
)


@given(IMAGE_BOXES, IMAGE_BOXES)
def test_image_boxes_as_shapely_has_them(a, b) -> None:
    one, other = box(*a), box(*b)
    expected = one.intersection(other).area / one.union(other).area
    assert image_overlaps([a], [b])[0, 0] == pytest.approx(expected, abs=1e-9)


def test_image_boxes_without_extent_have_nothing_in_common() -> None:
    assert image_overlaps([[1, 1, 1, 1]], [[1, 1, 1, 1]]).tolist() == [[0.0]]
    assert image_overlaps(np.empty((0, 4)), np.ones((2, 4))).shape == (0, 2)


def test_distances() -> None:
    assert similarity_by_distance(np.array([0.0, 1.0, 2.0, 4.0, 9.0])).tolist() == [
        1.0,
        0.75,
        0.5,
        0.0,
        0.0,
    ]


def test_by_hand() -> None:
    """Boxes of 4.5 x 1.8 x 1.5 m, the track half a length ahead."""
    there, reported_tracks = [truth([[10, 0], [30, 0]], ids=[1, 2])], [tracks([[12.25, 0]], [7])]
    values = {
        name: tracked_sequence(reported_tracks, there, name).similarities for name in SIMILARITIES
    }
    assert values["centre"].tolist() == [1 - 2.25 / 4, 0.0]
    assert values["iou_bev"] == pytest.approx([1 / 3, 0.0])
    assert values["iou_3d"] == pytest.approx([1 / 3, 0.0])
    wide = tracked_sequence(reported_tracks, there, gate_m=4.5)
    assert wide.similarities.tolist() == [0.75, 0.0]
    assert wide.distances_m.tolist() == [2.25, 17.75]


@pytest.mark.parametrize("name", SIMILARITIES)
def test_metrics_work_on_any_of_them(name) -> None:
    there = [truth([[x, 0], [x, 9]], ids=[1, 2]) for x in range(5)]
    reported_tracks = [tracks([[x, 0.0], [x, 9.0]], [7, 8]) for x in range(5)]
    s = tracked_sequence(reported_tracks, there, name)
    assert hota(s).hota == pytest.approx(np.ones(19))
    assert clear(s).mota == 1.0


def test_a_function_of_ones_own_and_unknown_names() -> None:
    there, reported_tracks = [truth([[10, 0]])], [tracks([[10, 0]], [7])]
    own = tracked_sequence(reported_tracks, there, lambda g, t: np.full((len(g), len(t)), 0.25))
    assert own.similarities.tolist() == [0.25]
    with pytest.raises(ValueError, match="no similarity 'iou'; known: centre, iou_bev, iou_3d"):
        tracked_sequence(reported_tracks, there, "iou")
