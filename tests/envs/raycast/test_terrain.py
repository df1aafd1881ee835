"""Rays and bodies on uneven ground, against a slow and obvious caster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_cast import SLOPES, assert_same, column, faces_of, meet, random_columns, random_scene

from roadscope.core import GROUND, Category, Pose
from roadscope.envs.raycast import NOTHING, Columns, Hits, Scene, cast
from roadscope.envs.traffic import Terrain
from roadscope.envs.world import Prisms

WAVE, HUMP, RAMP = 0.0, 1.0, 2.0
MAX_RANGE_M = 90.0
AREA = (-100.0, -100.0, 100.0, 100.0)


def terrain(*terms: tuple[float, ...], area: tuple[float, ...] = AREA) -> Terrain:
    return Terrain(np.array(terms).reshape(-1, 7), np.array(area))


def rough(rng: np.random.Generator) -> Terrain:
    """Crests, sags, a slope and bumps, at places that are on no grid."""
    waves = [
        (WAVE, *rng.uniform(-50, 50, 2), rng.uniform(-4, 4), rng.uniform(0, 0.004) * b, b, 0.0)
        for b in rng.uniform(6, 120, 6)
    ]
    ramps = [
        (RAMP, *rng.uniform(-9, 9, 2), rng.uniform(-4, 4), rng.uniform(-0.1, 0.1), -20.0, 20.0)
        for _ in range(2)
    ]
    humps = [
        (HUMP, *rng.uniform(-30, 30, 2), rng.uniform(-4, 4), 0.15, rng.uniform(2, 6), 0.0)
        for _ in range(4)
    ]
    return terrain(*waves, *ramps, *humps)


def below(ground: Terrain, points: np.ndarray) -> np.ndarray:
    return points[..., 2] - ground.heights(points[..., :2])


def first_ground(ground: Terrain, origin: np.ndarray, direction: np.ndarray) -> float:
    """Range of the first ground along a unit ray: 2 cm steps, then halving; inf without one."""
    reaches = np.arange(0.0, MAX_RANGE_M + 0.02, 0.02)
    over = below(ground, origin + reaches[:, None] * direction)
    under = np.flatnonzero(over <= 0)
    if len(under) == 0:
        return np.inf
    low, high = reaches[under[0] - 1], reaches[under[0]]
    for _ in range(50):
        middle = (low + high) / 2
        if below(ground, origin + middle * direction) > 0:
            low = middle
        else:
            high = middle
    return float(high)


def with_stances(scene: Scene, ground: Terrain, rng: np.random.Generator) -> Scene:
    """Actors on the ground under their middle, pitched and rolled at random, as they move."""
    heights = ground.heights(scene.poses[..., :2])
    tilts = rng.uniform(-0.15, 0.15, (*heights.shape, 2))
    return replace(
        scene, terrain=ground, stances=np.concatenate([heights[..., None], tilts], axis=-1)
    )


def brute_force(scene: Scene, columns: Columns, slopes: np.ndarray) -> Hits:
    ground = scene.terrain
    assert ground is not None
    prisms = Prisms.join([scene.static, scene.moving])
    shape = (len(columns), len(slopes))
    ranges, cosines, reflectivity = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    owners = np.full(shape, NOTHING)
    reached = np.zeros((*shape, len(scene.present)), bool)
    faces = [faces_of(prisms, m) for m in range(len(prisms))]
    knots, fractions = scene.segments(columns.stamps_s)
    after = np.minimum(knots + 1, len(scene.knots_s) - 1)
    poses = scene.poses_at(columns.stamps_s)
    stances = scene.stances[knots] + fractions[:, None, None] * (
        scene.stances[after] - scene.stances[knots]
    )
    middles = np.array(
        [
            (low + high) / 2
            for p, n in zip(prisms.footprints, prisms.corners, strict=True)
            for low, high in [(p[:n].min(axis=0), p[:n].max(axis=0))]
        ]
    )
    shears = ground.shears(middles)
    for c, origin in enumerate(columns.origins):
        maps = []
        for m, owner in enumerate(prisms.owners):
            if owner >= 0:
                (x, y, yaw), (z, rise, lean) = poses[c, owner], stances[c, owner]
                pitch, roll = -np.arctan(rise), np.arctan(lean / np.hypot(1, rise))
                body = Pose.from_euler(x, y, z, yaw=yaw, pitch=pitch, roll=roll).inverse()
                maps.append((body.rotation, body.translation))
            else:
                z, along, across = shears[m]
                linear = np.array([[1, 0, 0], [0, 1, 0], [-along, -across, 1]], float)
                lift = along * middles[m, 0] + across * middles[m, 1] - z
                maps.append((linear, np.array([0.0, 0.0, lift])))
        for j, slope in enumerate(slopes):
            direction = columns.ahead[c] + slope * columns.up[c]
            direction = direction / np.linalg.norm(direction)
            best = first_ground(ground, origin, direction)
            if best <= MAX_RANGE_M:
                foot = (origin + best * direction)[:2]
                step = np.array([[1e-6, 0], [-1e-6, 0], [0, 1e-6], [0, -1e-6]])
                east, west, north, south = ground.heights(foot + step)
                normal = np.array([(west - east) / 2e-6, (south - north) / 2e-6, 1.0])
                cosines[c, j] = -direction @ normal / np.linalg.norm(normal)
                ranges[c, j], owners[c, j] = best, GROUND
                reflectivity[c, j] = scene.ground_reflectivity
            else:
                best = MAX_RANGE_M
            for m, owner in enumerate(prisms.owners):
                if owner >= 0 and not scene.present[owner]:
                    continue
                linear, shift = maps[m]
                enter, _ = meet(faces[m], linear @ origin + shift, linear @ direction)
                if enter is None or enter > MAX_RANGE_M:
                    continue
                if owner >= 0:
                    reached[c, j, owner] = True
                if enter < best:
                    best = enter
                    ranges[c, j], owners[c, j] = enter, owner
                    cosines[c, j] = face_cosine(faces[m], linear, shift, origin, direction)
                    reflectivity[c, j] = prisms.reflectivities[m]
    counts = reached.sum(axis=(0, 1))
    hits = np.array([(owners == actor).sum() for actor in range(len(scene.present))])
    return Hits(ranges, owners, cosines, reflectivity, counts, hits)


def face_cosine(faces, linear, shift, origin, direction) -> float:
    """Cosine of incidence on the face by which a ray enters, from its normal in the world."""
    start, ray = linear @ origin + shift, linear @ direction
    entries = [
        (normal @ (point - start) / (normal @ ray), normal)
        for normal, point in faces
        if normal @ ray < 0
    ]
    normal = max(entries, key=lambda entry: entry[0])[1] @ linear
    return float(-direction @ normal / np.linalg.norm(normal))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(6))
def test_random_scenes_on_uneven_ground_as_brute_force(seed: int) -> None:
    rng = np.random.default_rng([seed, 9])
    ground = rough(rng)
    scene = with_stances(random_scene(rng), ground, rng)
    flat = random_columns(rng, tilt=0.1)
    lift = np.array([0.0, 0.0, 1.0]) * ground.heights(flat.origins[:, :2])[:, None]
    columns = Columns(flat.origins + lift, flat.ahead, flat.up, flat.stamps_s)
    theirs = brute_force(scene, columns, SLOPES)
    assert (theirs.owners >= 0).sum() > 5
    assert (theirs.owners < -2).sum() > 5
    assert (theirs.owners == GROUND).sum() > 100
    ours = cast(scene, columns, SLOPES, max_range_m=MAX_RANGE_M, outlines=True)
    assert_same(ours, theirs)


def empty(ground: Terrain) -> Scene:
    return replace(
        Scene.still(Prisms.empty(), Prisms.empty(), np.empty((0, 3))),
        terrain=ground,
        stances=np.empty((1, 0, 3)),
    )


@pytest.mark.parametrize("seed", range(3))
def test_hits_lie_on_the_ground_and_nothing_before_them_lies_below_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = rough(rng)
    count, slopes = 400, np.tan(np.radians(np.linspace(-25, 3, 33)))
    places = rng.uniform(-40, 40, (count, 2))
    origins = np.column_stack([places, ground.heights(places) + rng.uniform(0.3, 3, count)])
    turns = rng.uniform(-np.pi, np.pi, count)
    # Some columns run along the sides of cells.
    turns[:40] = np.pi / 2 * rng.integers(-2, 3, 40)
    origins[:20, :2] = np.round(origins[:20, :2])
    origins[:20, 2] += 1.0
    ahead = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(count)])
    up = np.tile([0.0, 0, 1], (count, 1))
    hits = cast(
        empty(ground), Columns(origins, ahead, up, np.zeros(count)), slopes, max_range_m=80.0
    )
    directions = ahead[:, None] + slopes[:, None] * up[:, None]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    ground_hit = hits.owners == GROUND
    assert 0.5 < ground_hit.mean() < 1
    ends = origins[:, None] + hits.ranges[..., None] * directions
    # Ranges are float32.
    assert np.abs(below(ground, ends[ground_hit])).max() < 1e-5
    reaches = np.where(ground_hit, hits.ranges, 80.0)
    for share in np.linspace(0.0, 1.0, 400, endpoint=False):
        before = origins[:, None] + (share * reaches)[..., None] * directions
        inside = (np.abs(before[..., :2]) <= 100).all(axis=-1)
        assert below(ground, before)[inside].min() > -1e-5


def test_rays_that_graze_a_crest_meet_it_or_pass_as_they_should() -> None:
    # The top of a hump of 1 m lies at x = 20, on corners of cells; it falls by 5 % at first.
    ground = terrain((HUMP, 20.0, 0.0, 0.0, 1.0, 10.0, 0.0))
    drops = np.array([-1e-6, 1e-6])
    for height in (1.2, 1.6, 1.9):
        slopes = (1.0 - height + drops) / 20.0
        rays = column(origin=(0, 0.2, height))
        hits = cast(empty(ground), rays, slopes, max_range_m=60.0)
        lengths = np.sqrt(1 + slopes**2)
        assert hits.ranges[0, 0] == pytest.approx(20.0 * lengths[0], abs=0.01)
        # Past the crest the ray meets the plane behind the hump, or nothing in range.
        beyond = -height / slopes[1] * lengths[1]
        expected = beyond if beyond <= 60 else 0.0
        assert hits.ranges[0, 1] == pytest.approx(expected, rel=1e-5)


def test_a_slope_is_a_plane() -> None:
    ground = terrain((RAMP, 0.0, 0.0, 0.3, 0.1, -1e4, 1e4))
    normal = np.array([-0.1 * np.cos(0.3), -0.1 * np.sin(0.3), 1.0])
    columns = random_columns(np.random.default_rng(1), tilt=0.0)
    hits = cast(empty(ground), columns, SLOPES, max_range_m=MAX_RANGE_M)
    directions = columns.ahead[:, None] + SLOPES[:, None] * columns.up[:, None]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    rates = directions @ normal
    reaches = -(columns.origins @ normal)[:, None] / rates
    ground_hit = (rates < 0) & (reaches <= MAX_RANGE_M)
    np.testing.assert_array_equal(hits.owners == GROUND, ground_hit)
    np.testing.assert_allclose(hits.ranges[ground_hit], reaches[ground_hit], rtol=1e-6)
    cosines = -rates[ground_hit] / np.linalg.norm(normal)
    np.testing.assert_allclose(hits.cosines[ground_hit], cosines, rtol=1e-5)


def test_a_level_terrain_gives_what_the_plane_gives() -> None:
    rng = np.random.default_rng(4)
    scene, columns = random_scene(rng), random_columns(rng, tilt=0.05)
    level = replace(
        scene, terrain=terrain((RAMP, 0, 0, 0, 0.0, -1.0, 1.0)), stances=np.zeros(scene.poses.shape)
    )
    plane = cast(scene, columns, SLOPES, max_range_m=MAX_RANGE_M, outlines=True)
    assert_same(cast(level, columns, SLOPES, max_range_m=MAX_RANGE_M, outlines=True), plane)


def test_vehicles_stand_on_their_wheels_and_people_upright() -> None:
    ground = terrain((RAMP, 0.0, 0.0, 0.0, 0.1, -1e4, 1e4))
    centres, sizes = np.tile([5.0, 0.0], (3, 1)), np.tile([4.0, 2.0, 1.5], (3, 1))
    categories = np.array([Category.CAR, Category.PEDESTRIAN, Category.CYCLIST])
    ahead = ground.stances(centres, np.zeros(3), sizes, categories)
    np.testing.assert_allclose(ahead, [(0.5, 0.1, 0), (0.5, 0, 0), (0.5, 0.1, 0)], atol=1e-12)
    across = ground.stances(centres, np.full(3, np.pi / 2), sizes, categories)
    np.testing.assert_allclose(across, [(0.5, 0, -0.1), (0.5, 0, 0), (0.5, 0, 0)], atol=1e-12)


def test_bad_ground_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="slopes of at most"):
        terrain((HUMP, 0, 0, 0, 3.0, 4.0, 0))
    with pytest.raises(ValueError, match="longer than 0 m"):
        terrain((WAVE, 0, 0, 0, 0.1, 0.0, 0))
    with pytest.raises(ValueError, match="kinds"):
        terrain((7, 0, 0, 0, 0.1, 5.0, 0))
    with pytest.raises(ValueError, match="area"):
        terrain((WAVE, 0, 0, 0, 0.1, 5.0, 0), area=(0, 0, 1, 50))
    scene = Scene.still(Prisms.empty(), Prisms.empty(), np.empty((0, 3)))
    with pytest.raises(ValueError, match="stances"):
        replace(scene, terrain=terrain((WAVE, 0, 0, 0, 0.1, 5.0, 0)))
