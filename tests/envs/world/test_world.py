from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Category, RecordError
from roadscope.envs.world import World, actor_bodies, body_prisms, build_world
from tests.envs.worlds import platoon


def _body_of(world: World, row: int) -> list[bytes]:
    rows = world.moving.owners == row
    return [
        world.moving.footprints[rows].tobytes(),
        world.moving.tops[rows].tobytes(),
        world.moving.reflectivities[rows].tobytes(),
    ]


def test_every_actor_has_a_body_of_its_size_under_its_row():
    timeline = platoon(4)
    timeline = replace(timeline, categories=np.array([0, 1, 5, 6], np.int8))
    world = build_world(timeline, 0)
    for row in range(4):
        corners = world.moving.footprints[world.moving.owners == row].reshape(-1, 2)
        assert np.allclose(np.ptp(corners, axis=0), timeline.sizes[row, :2])
    assert set(world.moving.owners) == {0, 1, 2, 3}


def test_a_body_stays_the_same_when_others_join():
    few, many = platoon(2), platoon(5)
    before, after = build_world(few, 3), build_world(few, 3).with_actors(many)
    assert len(set(after.moving.owners)) == 5
    assert after == replace(build_world(many, 3), scenery=after.scenery)
    for row in range(2):
        assert _body_of(before, row) == _body_of(after, row)


def test_a_body_follows_its_actor_to_another_row():
    timeline = platoon(3)
    swapped = replace(timeline, ids=timeline.ids[[0, 2, 1]])
    first, second = build_world(timeline, 3), build_world(swapped, 3)
    assert _body_of(first, 1) == _body_of(second, 2)
    assert _body_of(first, 2) == _body_of(second, 1)


def test_the_same_actors_keep_the_same_world():
    timeline = platoon(3)
    world = build_world(timeline, 3)
    assert world.with_actors(timeline) is world


def test_a_changed_size_changes_the_body():
    timeline = platoon(2)
    grown = replace(timeline, sizes=timeline.sizes * 1.1)
    world = build_world(timeline, 3).with_actors(grown)
    corners = world.moving.footprints[world.moving.owners == 1].reshape(-1, 2)
    assert np.allclose(np.ptp(corners, axis=0), grown.sizes[1, :2])


def test_paint_varies_between_actors_and_seeds():
    paints = [actor_bodies(platoon(30), seed).reflectivities for seed in (0, 1)]
    assert len(np.unique(paints[0])) > 4
    assert not np.array_equal(paints[0], paints[1])


def test_the_world_does_not_share_random_numbers_with_its_users():
    timeline = platoon(1)
    drawn = body_prisms(Category.CAR, timeline.sizes[0], np.random.default_rng(0))
    worlds = {actor_bodies(timeline, seed).reflectivities.tobytes() for seed in range(20)}
    assert len(worlds) > 1
    assert len(drawn) == len(actor_bodies(timeline, 0))


def test_scenery_has_the_style_of_the_timeline_or_of_the_argument():
    timeline = platoon(style="bare")
    here = np.array([100.0, 0.0])
    assert len(build_world(timeline, 0).static_around(here)) == 0
    campus = build_world(timeline, 0, style="campus").static_around(here)
    assert len(campus) > 0
    assert campus == build_world(platoon(style="campus"), 0).static_around(here)


def test_live_and_recorded_worlds_agree():
    """A live environment sees the timeline grow, a recording has all of it from the start."""
    timeline = platoon(3)
    recorded = build_world(timeline, 8)
    live = build_world(platoon(1), 8)
    for stamp_s in np.arange(0.0, 10.0, 0.5):
        live = live.with_actors(timeline if stamp_s > 4 else platoon(2))
        ego = timeline.at(np.array([stamp_s])).axles[0, 0]
        assert live.static_around(ego) == recorded.static_around(ego)
    assert live.moving == recorded.moving


def test_an_unknown_style_is_refused():
    with pytest.raises(RecordError, match="no roadside style 'jungle'"):
        build_world(platoon(style="jungle"), 0)


def test_ids_and_seeds_may_be_any_integer():
    timeline = replace(platoon(2), ids=np.array([-5, 2**62]))
    assert len(build_world(timeline, 2**63 - 1).moving) > 0
