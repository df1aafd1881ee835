import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import Polygon

from roadscope.core import box_overlaps, box_overlaps_3d, overlapping_pairs, pair_overlaps

LENGTHS = st.floats(0.2, 20.0)
BOXES = st.tuples(
    st.floats(-8, 8), st.floats(-8, 8), LENGTHS, LENGTHS, st.floats(-math.pi, math.pi)
)


def one(a, b) -> float:
    return float(box_overlaps(np.array([a], float), np.array([b], float))[0, 0])


def outline(box) -> Polygon:
    x, y, length, width, yaw = box
    c, s = math.cos(yaw), math.sin(yaw)
    corners = [(length, width), (-length, width), (-length, -width), (length, -width)]
    return Polygon([(x + (c * a - s * b) / 2, y + (s * a + c * b) / 2) for a, b in corners])


@given(BOXES, BOXES)
def test_as_shapely_has_it(a, b) -> None:
    one_area, other_area = outline(a), outline(b)
    expected = one_area.intersection(other_area).area / one_area.union(other_area).area
    assert one(a, b) == pytest.approx(expected, abs=1e-9)


def test_many_random_boxes_as_shapely_has_them() -> None:
    rng = np.random.default_rng(0)
    boxes = rng.uniform([-4, -4, 0.3, 0.3, -4], [4, 4, 9, 4, 4], (120, 5))
    overlaps = box_overlaps(boxes[:60], boxes[60:])
    outlines = [outline(box) for box in boxes]
    for i, j in np.ndindex(60, 60):
        a, b = outlines[i], outlines[60 + j]
        assert overlaps[i, j] == pytest.approx(a.intersection(b).area / a.union(b).area, abs=1e-12)
    assert 0.2 < (overlaps > 0).mean() < 0.9


def test_by_hand() -> None:
    square = (0, 0, 2, 2, 0)
    assert one(square, square) == 1.0
    assert one(square, (1, 0, 2, 2, 0)) == pytest.approx(1 / 3)
    assert one(square, (0, 0, 1, 1, 0.3)) == pytest.approx(1 / 4)
    assert one(square, (2, 0, 2, 2, 0)) == 0.0
    # A square and the same turned by 45 degrees share a regular octagon.
    octagon = 8 * (math.sqrt(2) - 1)
    assert one(square, (0, 0, 2, 2, math.pi / 4)) == pytest.approx(octagon / (8 - octagon))


@given(BOXES, BOXES, st.floats(-3000, 3000), st.floats(-3000, 3000), st.floats(-3, 3))
def test_motion_of_both_and_their_order_change_nothing(a, b, x, y, turn) -> None:
    c, s = math.cos(turn), math.sin(turn)

    def moved(box):
        return (x + c * box[0] - s * box[1], y + s * box[0] + c * box[1], *box[2:4], box[4] + turn)

    assert one(moved(a), moved(b)) == pytest.approx(one(a, b), abs=1e-9)
    assert one(a, b) == pytest.approx(one(b, a), abs=1e-9)


@given(BOXES, st.sampled_from([math.pi, 2 * math.pi]))
def test_a_box_is_itself_turned_by_half(box, turn) -> None:
    assert one(box, (*box[:4], box[4] + turn)) == pytest.approx(1.0)


SOLIDS = st.tuples(
    st.floats(-8, 8),
    st.floats(-8, 8),
    st.floats(-3, 3),
    LENGTHS,
    LENGTHS,
    LENGTHS,
    st.floats(-math.pi, math.pi),
)


def generalised_overlaps_3d(one_rows, other_rows, least=-1.0):
    """(N, M) generalised IoU, -1 where it does not exceed the least."""
    whole = np.full((len(one_rows), len(other_rows)), -1.0)
    rows, columns, shares = overlapping_pairs(one_rows, other_rows, generalised=True, least=least)
    whole[rows, columns] = shares
    return whole


def in_space(a, b) -> tuple[float, float]:
    """IoU and generalised IoU as shapely's areas give them."""
    flat, other = (outline((*box[:2], *box[3:5], box[6])) for box in (a, b))
    (low, high), (low_too, high_too) = ((x[2] - x[5] / 2, x[2] + x[5] / 2) for x in (a, b))
    common = flat.intersection(other).area * max(0.0, min(high, high_too) - max(low, low_too))
    whole = flat.area * a[5] + other.area * b[5] - common
    around = flat.union(other).convex_hull.area * (max(high, high_too) - min(low, low_too))
    return common / whole, common / whole - (around - whole) / around


@given(SOLIDS, SOLIDS)
def test_in_space_as_shapely_has_it(a, b) -> None:
    one_row, other_row = np.array([a]), np.array([b])
    expected, generalised = in_space(a, b)
    assert box_overlaps_3d(one_row, other_row)[0, 0] == pytest.approx(expected, abs=1e-9)
    overlap = generalised_overlaps_3d(one_row, other_row)[0, 0]
    assert overlap == pytest.approx(generalised, abs=1e-9)
    assert generalised_overlaps_3d(other_row, one_row)[0, 0] == pytest.approx(overlap, abs=1e-9)


def test_in_space_by_hand() -> None:
    cube, beside, above = [0, 0, 0, 1, 1, 1, 0], [2, 0, 0, 1, 1, 1, 0], [0, 0, 0.5, 1, 1, 1, 0]
    boxes = np.array([cube, beside, above], float)
    expected = [[1, 0, 1 / 3], [0, 1, 0], [1 / 3, 0, 1]]
    assert box_overlaps_3d(boxes, boxes) == pytest.approx(np.array(expected))
    # Two cubes with one missing between them; then a prism of 3 x 1 x 1.5 around two cubes.
    overlaps = generalised_overlaps_3d(boxes, boxes)
    assert overlaps[0] == pytest.approx([1, -1 / 3, 1 / 3])
    assert overlaps[2, 1] == pytest.approx(-2.5 / 4.5)
    assert generalised_overlaps_3d(boxes[:0], boxes).shape == (0, 3)


@given(st.integers(0, 10_000), st.floats(-0.9, 0.5))
def test_pairs_left_out_lie_below_the_least(seed, least) -> None:
    rng = np.random.default_rng(seed)
    low, high = [-15, -15, -2, 0.3, 0.3, 0.5, -4], [15, 15, 2, 12, 4, 4, 4]
    one_row, other_row = rng.uniform(low, high, (6, 7)), rng.uniform(low, high, (6, 7))
    whole = generalised_overlaps_3d(one_row, other_row)
    overlaps = generalised_overlaps_3d(one_row, other_row, least)
    assert ((overlaps == whole) | ((overlaps == -1) & (whole <= least))).all()


@given(st.integers(0, 10_000), st.booleans(), st.floats(0.0, 0.5))
def test_pairs_come_in_order_and_are_all_there_are(seed, generalised, least) -> None:
    """More of them than there is room for at first, and some in a column along x."""
    rng = np.random.default_rng(seed)
    low, high = [-9, -9, -1, 2, 2, 1, -4], [9, 9, 1, 9, 4, 3, 4]
    one_row, other_row = rng.uniform(low, high, (24, 7)), rng.uniform(low, high, (30, 7))
    other_row[::2, 0] = 0.0
    alone = [
        overlapping_pairs(a[None], other_row, generalised=generalised, least=least) for a in one_row
    ]
    rows, columns, shares = overlapping_pairs(
        one_row, other_row, generalised=generalised, least=least
    )
    assert rows.tolist() == [i for i, of_one_row in enumerate(alone) for _ in of_one_row[0]]
    assert columns.tolist() == [j for of_one_row in alone for j in of_one_row[1].tolist()]
    assert np.array_equal(shares, np.concatenate([of_one_row[2] for of_one_row in alone]))
    assert (np.diff(rows * 30 + columns) > 0).all()
    if not generalised:
        slow = np.array([[in_space(a, b)[0] for b in other_row[:5]] for a in one_row[:5]])
        overlaps = box_overlaps_3d(one_row[:5], other_row[:5])
        np.testing.assert_allclose(overlaps, slow, atol=1e-9)


def test_far_pairs_are_left_out() -> None:
    near, far = (0, 0, 0, 4.6, 1.9, 1.5, 0), (30, 0, 0, 4.6, 1.9, 1.5, 0)
    boxes = np.array([near, far], float)
    assert generalised_overlaps_3d(boxes[:1], boxes)[0, 1] > -1
    assert generalised_overlaps_3d(boxes[:1], boxes, -0.5)[0].tolist() == [1.0, -1.0]


@given(st.integers(0, 10_000), st.booleans(), st.floats(-0.9, 0.5))
def test_overlaps_of_given_pairs_are_those_of_all(seed, generalised, least) -> None:
    rng, least = np.random.default_rng(seed), least if generalised else abs(least)
    low, high = [-9, -9, -1, 2, 2, 1, -4], [9, 9, 1, 9, 4, 3, 4]
    one_row, other_row = rng.uniform(low, high, (8, 7)), rng.uniform(low, high, (9, 7))
    rows, columns = np.divmod(np.arange(72), 9)
    shares = pair_overlaps(one_row, other_row, rows, columns, generalised, least)
    above_least = shares > least
    every = overlapping_pairs(one_row, other_row, generalised=generalised, least=least)
    assert np.array_equal(rows[above_least], every[0])
    assert np.array_equal(columns[above_least], every[1])
    assert np.array_equal(shares[above_least], every[2])
