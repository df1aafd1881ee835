import pickle
import subprocess
import sys
import warnings
from functools import lru_cache
from importlib import import_module
from zlib import crc32

import gymnasium as gym
import highway_env  # noqa: F401
import numpy as np
import pytest
from scipy.spatial import cKDTree

from roadscope.core import RecordError
from roadscope.envs.traffic import SCENARIOS, RoadMap, road_map
from roadscope.envs.world import KINDS, OVERHEAD, STYLES, Prisms, Scenery, grow, kinds_of
from tests.envs.worlds import circle, crossing, straight

IDS = sorted(
    name for name, spec in gym.registry.items() if str(spec.entry_point).startswith("highway_env")
)
NEAR_M = 1.0
GROWN = [style for style in STYLES if style != "bare"]


@lru_cache
def _foreign(name: str) -> RoadMap:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of old versions
        env = gym.make(name).unwrapped
    env.reset(seed=0)
    return road_map(env.road.network)


@lru_cache
def _own(name: str) -> RoadMap:
    scenario = SCENARIOS[name]
    module, _, function = scenario.builder.partition(":")
    build = getattr(import_module(module), function)
    if scenario.scripted:
        return build(name, 0, 1.0).road
    return build(np.random.default_rng(0)).flow.roads.map


def _some(road: RoadMap, style: str, seed: int = 0) -> Prisms:
    """Scenery near eight places along the road."""
    places = road.points[np.linspace(0, len(road.points) - 1, 8).astype(int)]
    return Scenery(road, style, seed).along(places, radius_m=60.0)


def _standing(road: RoadMap, style: str, seed: int) -> Prisms:
    """What of it hangs over no lane."""
    things = _some(road, style, seed)
    overhead = [rank for rank, kind in enumerate(KINDS) if kind in OVERHEAD]
    return things.select(~np.isin(kinds_of(things.owners), overhead))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _to_segment(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = b - a
    t = ((points - a) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
    return np.linalg.norm(points - a - np.clip(t, 0, 1)[..., None] * along, axis=-1)


def _gap(outline: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Exact distance of a convex outline to (N, 2) segments: reference without sampling."""
    p, q = outline[None, :], np.roll(outline, -1, axis=0)[None, :]
    a, b = a[:, None], b[:, None]
    ends = np.minimum(_to_segment(a, p, q), _to_segment(b, p, q)).min(1)
    corners = _to_segment(p, a, b).min(1)
    meet = (_cross(b - a, p - a) * _cross(b - a, q - a) < 0) & (
        _cross(q - p, a - p) * _cross(q - p, b - p) < 0
    )
    inside = (_cross(q - p, a - p) >= 0).all(1)
    return np.where(meet.any(1) | inside, 0.0, np.minimum(ends, corners))


def _nearest_edge_m(things: Prisms, road: RoadMap) -> float:
    """Least distance of any outline to the edge of any lane strip; 0 width at worst.

    Exact up to `NEAR_M`; farther things are not checked.
    """
    lanes = [(p, w) for p, w in road.lanes() if len(p) > 1]
    a = np.concatenate([points[:-1] for points, _ in lanes])
    b = np.concatenate([points[1:] for points, _ in lanes])
    half = np.concatenate([np.maximum(w[:-1], w[1:]) / 2 for _, w in lanes])
    reach = float(np.linalg.norm(a - b, axis=1).max()) / 2 + float(half.max()) + NEAR_M
    outlines = [f[:corners] for f, corners in zip(things.footprints, things.corners, strict=True)]
    middles = np.array([outline.mean(0) for outline in outlines]).reshape(-1, 2)
    sizes = [np.linalg.norm(o - m, axis=1).max() for o, m in zip(outlines, middles, strict=True)]
    beside = cKDTree((a + b) / 2).query_ball_point(middles, np.array(sizes) + reach)
    worst = np.inf
    for outline, near in zip(outlines, beside, strict=True):
        if near:
            worst = min(worst, float((_gap(outline, a[near], b[near]) - half[near]).min()))
    return worst


@lru_cache
def _nearest_in_two_styles_m(pickled: bytes) -> float:
    """Likewise of what grows along a road; many names share one, which is looked at once.

    Each road has two of the styles: simple roads have them all.
    """
    road, first = pickle.loads(pickled), crc32(pickled)
    seeds = [(first + k) % len(GROWN) for k in (0, 2)]
    return min(_nearest_edge_m(_standing(road, GROWN[seed], seed), road) for seed in seeds)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("style", GROWN)
@pytest.mark.parametrize("road", [straight(), straight(3, width_m=3.5), crossing(), circle()])
def test_nothing_stands_on_a_lane_of_simple_roads(road, style):
    for seed in range(3):
        assert _nearest_edge_m(_standing(road, style, seed), road) > 0.1


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", IDS)
def test_nothing_stands_on_a_lane_of_highway_env(name):
    assert _nearest_in_two_styles_m(pickle.dumps(_foreign(name))) > 0.1


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SCENARIOS)
def test_nothing_stands_on_a_lane_of_our_scenarios(name):
    assert _nearest_in_two_styles_m(pickle.dumps(_own(name))) > 0.1


def test_the_reference_sees_a_thing_on_a_lane():
    on_lane = Prisms.of(np.array([[50.0, 1.0], [51.0, 1.0], [51.0, 2.0], [50.0, 2.0]]), 0, 1)
    assert _nearest_edge_m(on_lane, straight()) < 0


@pytest.mark.parametrize("style", GROWN)
def test_each_style_grows_every_kind_it_has_a_density_for(style):
    things = _some(straight(length_m=1500.0), style)
    grown = {list(KINDS)[k] for k in kinds_of(things.owners)}
    assert grown == {kind for kind in KINDS if getattr(STYLES[style], kind) > 0}


def test_bare_is_bare():
    assert len(_some(straight(), "bare")) == 0


def test_campus_has_bushes_in_the_plane_of_a_low_sensor_near_the_road():
    things = Scenery(straight(), "campus", 0).around(np.array([150.0, 2.0]))
    bushes = things.select(kinds_of(things.owners) == list(KINDS).index("bushes"))
    assert len(bushes) > 15
    assert (bushes.extinctions > 0).all()
    assert (bushes.bottoms == 0).all()
    assert ((bushes.tops >= 0.5) & (bushes.tops <= 2.0)).all()
    size = np.ptp(bushes.footprints, axis=1)
    assert ((size >= 0.4) & (size <= 2.1)).all()


def test_foliage_is_porous_and_all_else_solid():
    for style in GROWN:
        things = _some(straight(length_m=1000.0), style)
        kinds = np.array(list(KINDS))[kinds_of(things.owners)]
        porous = np.isin(kinds, ["bushes", "hedge"]) | ((kinds == "trees") & (things.bottoms > 0))
        assert np.array_equal(things.extinctions > 0, porous)


def test_outlines_are_convex_and_turn_left():
    things = Prisms.join([_some(road, s) for s in GROWN for road in (circle(), crossing())])
    for outline, corners in zip(things.footprints, things.corners, strict=True):
        sides = np.roll(outline[:corners], -1, axis=0) - outline[:corners]
        assert (_cross(sides, np.roll(sides, -1, axis=0)) > -1e-9).all()


def test_every_thing_has_an_owner_of_its_own_and_scenery_only():
    things = _some(straight(), "urban")
    assert (things.owners <= -2).all()
    for owner in np.unique(things.owners):
        corners = things.footprints[things.owners == owner].reshape(-1, 2)
        assert np.ptp(corners, axis=0).max() < 30.0


def test_scenery_does_not_depend_on_the_path_of_the_ego():
    road, here = straight(length_m=2000.0), np.array([1000.0, 0.0])
    fresh = Scenery(road, "motorway", 4).around(here)
    travelled = Scenery(road, "motorway", 4)
    for x in np.arange(100.0, 1000.0, 40.0):
        travelled.around(np.array([x, 0.0]))
    assert travelled.around(here) == fresh


def test_around_holds_all_that_comes_within_the_radius():
    road = straight(length_m=2000.0)
    scenery = Scenery(road, "urban", 4)
    whole = scenery.along(np.stack([np.arange(0, 2000.0, 50.0), np.zeros(40)], axis=1))
    for x in (503.0, 549.9, 777.0):
        gaps = np.linalg.norm(whole.footprints - (x, 0.0), axis=2).min(1)
        near = scenery.around(np.array([x, 0.0]), 100.0)
        assert set(whole.owners[gaps < 100.0]) <= set(near.owners)
        assert len(near) < len(whole) / 2


def test_the_same_tile_gives_the_same_object():
    scenery = Scenery(straight(), "campus", 0)
    assert scenery.around(np.array([101.0, 0.0])) is scenery.around(np.array([149.0, 0.0]))


def test_seeds_and_styles_differ():
    road, here = straight(), np.array([150.0, 0.0])
    grown = [Scenery(road, style, seed).around(here) for style in GROWN for seed in (0, 1)]
    assert all(a != b for i, a in enumerate(grown) for b in grown[:i])


def test_grow_follows_a_path_and_its_generator():
    road, path = straight(length_m=1000.0), np.array([[100.0, 0.0], [300.0, 0.0]])
    first = grow(road, path, "campus", np.random.default_rng(5))
    assert first == grow(road, path, "campus", np.random.default_rng(5))
    assert first.footprints[..., 0].min() < 30
    assert 450 < first.footprints[..., 0].max() < 700


def test_an_error_for_an_unknown_style_lists_known_ones():
    with pytest.raises(RecordError, match=r"'jungle'; known: motorway, urban, town, campus, bare"):
        Scenery(straight(), "jungle", 0)


def test_a_road_without_lanes_has_no_scenery():
    assert len(Scenery(RoadMap.from_lanes([]), "urban", 0).around(np.zeros(2))) == 0


def test_the_owner_determines_the_kind():
    assert kinds_of(np.array([5, 0, -1])).tolist() == [-1, -1, -1]


DIGEST = """
import hashlib, numpy as np
from tests.envs.worlds import crossing
from roadscope.envs.world.roadside import Scenery
things = Scenery(crossing(), "urban", 9).around(np.zeros(2))
print(hashlib.sha256(b"".join(getattr(things, n).tobytes() for n in things.__slots__)).hexdigest())
"""


@pytest.mark.slow
def test_another_process_with_another_hash_seed_grows_the_same_bytes(pytestconfig):
    digests = {
        subprocess.run(
            [sys.executable, "-c", DIGEST],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": "."},
            cwd=pytestconfig.rootpath,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(digests) == 1
