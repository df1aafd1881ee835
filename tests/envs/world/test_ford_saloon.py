from itertools import pairwise

import numpy as np
import pytest

from roadscope.envs.world import (
    CORNER_RADII_M,
    HEIGHT_M,
    LENGTH_M,
    NARROWING,
    SLABS,
    WIDTH_M,
    ford_saloon,
)


@pytest.fixture(params=CORNER_RADII_M)
def body(request):
    return ford_saloon(request.param)


def corners_of(body):
    return [f[:c] for f, c in zip(body.footprints, body.corners, strict=True)]


def section(body, z):
    """Outline points of all prisms at one height."""
    at = (body.bottoms < z) & (z < body.tops)
    return np.concatenate([c for c, inside in zip(corners_of(body), at, strict=True) if inside])


def test_it_is_inside_its_box_and_touches_every_face(body):
    points = np.concatenate(corners_of(body))
    assert points.max(axis=0) == pytest.approx([LENGTH_M / 2, WIDTH_M / 2])
    assert points.min(axis=0) == pytest.approx([-LENGTH_M / 2, -WIDTH_M / 2])
    assert body.tops.max() == HEIGHT_M
    assert body.bottoms.min() > 0


def test_footprints_are_convex_and_turn_left(body):
    for corners in corners_of(body):
        edges = np.roll(corners, -1, axis=0) - corners
        after = np.roll(edges, -1, axis=0)
        assert (edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0] > -1e-12).all()


def test_left_and_right_are_mirrored(body):
    for corners in corners_of(body):
        mirrored = {(round(x, 9), round(-y, 9)) for x, y in corners}
        assert mirrored == {(round(x, 9), round(y, 9)) for x, y in corners}


def test_bonnet_and_boot_are_lower_than_the_cabin(body):
    """From the side it is a saloon: at the height of the roof neither nose nor tail."""
    nose, tail = section(body, 0.95)[:, 0].max(), section(body, 0.95)[:, 0].min()
    cabin = section(body, 1.3)[:, 0]
    assert nose - cabin.max() > 0.8
    assert cabin.min() - tail > 0.7
    stacked = sorted((slab.bottom_m, slab.top_m) for slab in SLABS)
    assert all(a[1] == b[0] for a, b in pairwise(stacked))


def test_ends_are_narrower_than_the_middle_and_no_gap_between_the_halves():
    corners = section(ford_saloon("sharp"), 0.5)
    ends = corners[np.abs(corners[:, 0]) > 0.499 * LENGTH_M]
    assert np.unique(np.abs(ends[:, 1])).round(4).tolist() == [
        round(share * WIDTH_M / 2, 4) for share in sorted(NARROWING)
    ]
    for behind, ahead in zip(*[iter(corners_of(ford_saloon("rounded")))] * 2, strict=True):
        assert behind[:, 0].max() == pytest.approx(ahead[:, 0].min())


def test_rounding_takes_a_corner_away():
    """The arc's middle is (1 - sqrt(1/2)) radii from both faces, its chords up to 2 cm inside."""
    corners = section(ford_saloon("rounded"), 0.5)
    diagonal = (corners - (-LENGTH_M / 2, -NARROWING[0] * WIDTH_M / 2)).sum(1)
    assert diagonal.min() == pytest.approx(2 * 0.35 * (1 - np.sqrt(0.5)), abs=0.03)


def test_an_unknown_body_is_refused():
    with pytest.raises(ValueError, match="no body 'round'; known: sharp, rounded"):
        ford_saloon("round")
