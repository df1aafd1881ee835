"""The search for a heading against a plain version of the paper, and the hull against all turns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.detectors.shape import (
    AREA,
    CLOSENESS,
    VARIANCE,
    hull_heading,
    line_heading,
    searched_heading,
)

SEARCHED = {"area": AREA, "closeness": CLOSENESS, "variance": VARIANCE}


def l_shape(yaw, seed=0, noise_m=0.02, length=4.4, width=1.8):
    rng = np.random.default_rng(seed)
    rear = np.column_stack([np.zeros(15), np.linspace(width, 0, 15)])
    flank = np.column_stack([np.linspace(0, length, 25), np.zeros(25)])
    points = np.concatenate([rear, flank[1:]]) + noise_m * rng.standard_normal((39, 2))
    return points @ turn(yaw).T + (12.0, 3.0)


def turn(yaw):
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def off_square(heading, yaw):
    """Angle to the nearest of the two axes."""
    return abs((heading - yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def plain_value(points, heading, criterion, near_m):
    c1 = points @ [np.cos(heading), np.sin(heading)]
    c2 = points @ [-np.sin(heading), np.cos(heading)]
    if criterion == "area":
        return -np.ptp(c1) * np.ptp(c2)
    d1, d2 = (
        min((c.max() - c, c - c.min()), key=lambda d: float(np.linalg.norm(d))) for c in (c1, c2)
    )
    if criterion == "closeness":
        return (1 / np.maximum(np.minimum(d1, d2), near_m)).sum()
    return -sum(np.var(a[a < b]) if (a < b).any() else 0.0 for a, b in ((d1, d2), (d2, d1)))


@pytest.mark.parametrize("criterion", SEARCHED)
@pytest.mark.parametrize("seed", range(4))
def test_search_is_as_good_as_every_quarter_degree(criterion, seed):
    points = l_shape(0.3 + seed, seed)
    heading = searched_heading(points, SEARCHED[criterion], 0.05)
    best = max(plain_value(points, h, criterion, 0.05) for h in np.radians(np.arange(0, 90, 0.25)))
    value = plain_value(points, heading, criterion, 0.05)
    assert value >= best - 0.08 * abs(best)
    # A right-angled triangle's least rectangle may as well lie on its longest side.
    assert criterion == "area" or off_square(heading, 0.3 + seed) < np.radians(4)


@given(yaw=st.floats(-3.2, 3.2))
@pytest.mark.parametrize("criterion", ["closeness", "variance"])
def test_search_turns_with_the_points(criterion, yaw):
    assert off_square(searched_heading(l_shape(yaw), SEARCHED[criterion], 0.05), yaw) < 0.02


@given(yaw=st.floats(-3.2, 3.2), seed=st.integers(0, 99), near_m=st.sampled_from([0.01, 0.05, 0.5]))
@pytest.mark.parametrize("criterion", SEARCHED)
def test_search_knows_no_left_and_right(criterion, yaw, seed, near_m):
    """Where everything is near a side, many headings are equally good."""
    points = l_shape(yaw, seed)
    here = searched_heading(points, SEARCHED[criterion], near_m)
    there = searched_heading(points[::-1] * [1.0, -1.0], SEARCHED[criterion], near_m)
    assert off_square(here, -there) < 1e-9


def test_of_headings_equally_good_the_middle_is_taken():
    """Tilted as far as the floor allows either way, the face is still on its side."""
    face = np.column_stack([np.linspace(0.0, 1.0, 40) ** 2, np.zeros(40)])
    for yaw in np.radians([0.0, 13.0, 44.9, 88.0]):
        heading = searched_heading(face @ turn(yaw).T, CLOSENESS, 0.05)
        assert off_square(heading, yaw) < np.radians(0.3)


@given(seed=st.integers(0, 10**6), count=st.integers(1, 30), grid=st.booleans())
def test_hull_rectangle_is_least_of_all_turns(seed, count, grid):
    """Duplicates, one, two and collinear points too."""
    points = np.random.default_rng(seed).uniform(-3, 3, (count, 2))
    points = np.round(points) if grid else points
    points = np.unique(points, axis=0)
    heading = hull_heading(points)
    assert 0 <= heading < np.pi / 2
    least = max(plain_value(points, h, "area", 0) for h in np.radians(np.arange(0, 90, 0.5)))
    assert plain_value(points, heading, "area", 0) >= least - 1e-9


@given(yaw=st.floats(-3.2, 3.2), count=st.integers(2, 20))
def test_collinear_points_give_their_line(yaw, count):
    points = np.column_stack([np.linspace(0, 2, count), np.zeros(count)]) @ turn(yaw).T
    assert off_square(line_heading(points), yaw) < 1e-6
    order = np.lexsort((points[:, 1], points[:, 0]))
    assert off_square(hull_heading(points[order]), yaw) < 1e-6
