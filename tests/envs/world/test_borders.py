import numpy as np
import pytest

from roadscope.envs.traffic import RoadMap
from roadscope.envs.world import (
    LaneDistances,
    border_sites,
    distances_to,
    rectangle,
    rounded,
    without_duplicates,
)
from tests.envs.worlds import circle, crossing, straight


def test_only_the_outer_borders_of_a_two_lane_road_are_outer():
    road = straight(lanes=2)
    sites = border_sites(road)
    outer = sites.select(LaneDistances(road).outer(sites))
    assert set(outer.middles[:, 1]) == {-2.0, 6.0}
    assert len(outer) == 2 * 75
    assert np.array_equal(np.sign(outer.normals[:, 1]), np.sign(outer.middles[:, 1]))


def test_no_border_runs_through_a_crossing():
    road = crossing()
    sites = border_sites(road)
    outer = sites.select(LaneDistances(road).outer(sites))
    assert (np.abs(outer.middles).max(axis=1) > 2.0).all()
    assert len(outer) < len(sites)


def test_a_ring_has_a_border_inside_and_outside():
    road = circle(25.0)
    sites = border_sites(road)
    outer = sites.select(LaneDistances(road).outer(sites))
    assert len(outer) == len(sites)
    radii = np.linalg.norm(outer.starts, axis=1)
    assert np.allclose(np.minimum(np.abs(radii - 23), np.abs(radii - 27)), 0, atol=0.05)
    away = (outer.normals * outer.middles).sum(1)
    assert np.array_equal(away > 0, radii > 25)


def test_borders_that_coincide_are_kept_once():
    once = straight(lanes=1)
    twice = RoadMap.from_lanes(once.lanes() * 2)
    assert without_duplicates(border_sites(once)).all()
    sites = border_sites(twice)
    assert without_duplicates(sites).sum() == len(border_sites(once))


@pytest.mark.parametrize(
    ("centre", "clearance"), [((50.0, -4.0), 1.0), ((50.0, -2.5), -0.5), ((50.0, 0.0), -2.0)]
)
def test_clearance_is_measured_from_the_edge_of_the_lane(centre, clearance):
    lanes = LaneDistances(straight())
    outline = rectangle(4.0, 2.0) + centre
    assert lanes.clearances(outline[None], 3.0)[0] == pytest.approx(clearance, abs=0.07)


def test_the_clearance_of_far_things_is_the_limit():
    lanes = LaneDistances(straight())
    far = rectangle(4.0, 2.0) - np.array([0.0, 40.0])
    assert lanes.clearances(far[None], 3.0)[0] == 3.0


def test_distances_to_an_outline_agree_with_dense_samples():
    rng = np.random.default_rng(0)
    outline = rounded(4.0, 2.0, 0.5)
    points = rng.uniform(-5, 5, (200, 2))
    t = np.linspace(0, 1, 400)[:, None]
    rim = np.concatenate(
        [a + t * (b - a) for a, b in zip(outline, np.roll(outline, -1, 0), strict=True)]
    )
    distances = distances_to(np.tile(outline, (200, 1, 1)), points)
    nearest = np.linalg.norm(points[:, None] - rim, axis=2).min(1)
    outside = distances > 0
    assert np.allclose(distances[outside], nearest[outside], atol=0.01)
    assert (np.abs(points[~outside]) <= (2.0, 1.0)).all()
    assert 5 < (~outside).sum() < 100


def test_lanes_without_length_have_no_border_but_are_kept_clear():
    here = np.array([[5.0, 5.0]])
    still = [(here, np.array([4.0])), (np.repeat(here, 2, 0), np.full(2, 4.0))]
    road = RoadMap.from_lanes([*still, (np.empty((0, 2)), np.empty(0))])
    assert len(border_sites(road)) == 0
    outline = rectangle(2.0, 2.0) + here
    assert LaneDistances(road).clearances(outline[None], 1.0)[0] < 0


def test_an_empty_lane_does_not_shift_the_numbers_of_others():
    empty = (np.empty((0, 2)), np.empty(0))
    road = RoadMap.from_lanes([empty, *straight(lanes=1).lanes()])
    assert LaneDistances(road).outer(border_sites(road)).all()
