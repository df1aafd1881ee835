"""The caster against a slow, obvious one."""

from __future__ import annotations

import numpy as np
import pytest

from roadscope.core import GROUND, Pose
from roadscope.envs.raycast import NOTHING, Columns, Hits, Scene, cast
from roadscope.envs.world import Prisms

MAX_RANGE_M = 90.0


def brute_force(scene: Scene, columns: Columns, slopes: np.ndarray) -> Hits:
    """One ray, one prism, one half-space at a time."""
    prisms = Prisms.join([scene.static, scene.moving])
    poses = scene.poses_at(columns.stamps_s)
    shape = (len(columns), len(slopes))
    ranges, cosines, reflectivity = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    owners = np.full(shape, NOTHING)
    reached = np.zeros((*shape, len(scene.present)), bool)
    faces = [faces_of(prisms, m) for m in range(len(prisms))]
    for c, origin in enumerate(columns.origins):
        from_world = [pose_of(poses[c], owner).inverse() for owner in prisms.owners]
        starts = [pose.apply(origin) for pose in from_world]
        for j, slope in enumerate(slopes):
            direction = columns.ahead[c] + slope * columns.up[c]
            direction = direction / np.linalg.norm(direction)
            best = MAX_RANGE_M
            if origin[2] > 0 and direction[2] < 0 and -origin[2] / direction[2] <= best:
                best = -origin[2] / direction[2]
                ranges[c, j], owners[c, j], cosines[c, j] = best, GROUND, -direction[2]
                reflectivity[c, j] = scene.ground_reflectivity
            for m, owner in enumerate(prisms.owners):
                if owner >= 0 and not scene.present[owner]:
                    continue
                enter, cosine = meet(faces[m], starts[m], from_world[m].rotation @ direction)
                if enter is None or enter > MAX_RANGE_M:
                    continue
                if owner >= 0:
                    reached[c, j, owner] = True
                if enter < best:
                    best = enter
                    ranges[c, j], owners[c, j], cosines[c, j] = enter, owner, cosine
                    reflectivity[c, j] = prisms.reflectivities[m]
    counts = reached.sum(axis=(0, 1))
    hits = np.array([(owners == actor).sum() for actor in range(len(scene.present))])
    return Hits(ranges, owners, cosines, reflectivity, counts, hits)


def pose_of(poses: np.ndarray, owner: int) -> Pose:
    """World from body."""
    return Pose.planar(*poses[owner]) if owner >= 0 else Pose.planar(0.0, 0.0, 0.0)


def faces_of(prisms: Prisms, m: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Normals that point outwards, and a point of each face."""
    corners = prisms.footprints[m, : prisms.corners[m]]
    edges = np.roll(corners, -1, axis=0) - corners
    faces = [
        (np.array([edge[1], -edge[0], 0.0]) / np.hypot(*edge), np.array([*corner, 0.0]))
        for corner, edge in zip(corners, edges, strict=True)
    ]
    faces.append((np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, prisms.tops[m]])))
    faces.append((np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, prisms.bottoms[m]])))
    return faces


def meet(
    faces: list[tuple[np.ndarray, np.ndarray]], start: np.ndarray, ray: np.ndarray
) -> tuple[float | None, float]:
    """Distance to where the ray enters the prism, and the cosine of incidence there."""
    enter, leave, cosine = -np.inf, np.inf, 0.0
    for normal, point in faces:
        distance, rate = normal @ (point - start), normal @ ray
        if rate == 0:
            if distance < 0:
                return None, 0.0
        elif rate < 0:
            if distance / rate > enter:
                enter, cosine = distance / rate, -rate
        else:
            leave = min(leave, distance / rate)
    return (enter, cosine) if 0 < enter <= leave else (None, 0.0)


def random_prism(rng: np.random.Generator, owner: int, centre: np.ndarray) -> Prisms:
    count = int(rng.integers(3, 13))
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    sizes = rng.uniform(0.3, 6.0, 2)
    footprint = centre + sizes * np.column_stack([np.cos(angles), np.sin(angles)])
    bottom = rng.choice([0.0, 0.3, 1.0, 2.5])
    return Prisms.of(
        footprint,
        bottom,
        bottom + rng.uniform(0.1, 4),
        owner=owner,
        reflectivity=float(rng.uniform(0.05, 0.9)),
    )


def random_scene(rng: np.random.Generator, *, knots: int = 3) -> Scene:
    actors = 6
    static = [random_prism(rng, -2 - i, rng.uniform(-40, 40, 2)) for i in range(7)]
    moving = [
        random_prism(rng, actor, rng.uniform(-0.5, 0.5, 2))
        for actor in range(actors)
        for _ in range(2)
    ]
    order = rng.permutation(len(moving))
    poses = np.empty((knots, actors, 3))
    poses[0] = rng.uniform((-40, -40, -7), (40, 40, 7), (actors, 3))
    for k in range(1, knots):
        poses[k] = poses[k - 1] + rng.normal(0, (1.0, 1.0, 0.2), (actors, 3))
    knots_s = 0.05 * np.arange(knots) + 3.0
    present = rng.random(actors) > 0.15
    joined = Prisms.join(moving).select(order)
    return Scene(Prisms.join(static), joined, knots_s, poses, present, 5)


def random_columns(rng: np.random.Generator, *, tilt: float, count: int = 70) -> Columns:
    """A spinning, driving sensor whose tilt changes on the way."""
    yaws = np.linspace(np.pi, -np.pi, count, endpoint=False) + rng.uniform(0, 0.01)
    origins = np.array([0.0, 0.0, 1.7]) + np.linspace(0, 1, count)[:, None] * rng.normal(
        0, (2, 2, 0.02)
    )
    pitch, roll = rng.uniform(-tilt, tilt, 2)
    rotations = [
        Pose.from_euler(0, 0, 0, yaw=0.1, pitch=pitch * f, roll=roll).rotation
        for f in np.linspace(0.5, 1, count)
    ]
    ahead = np.array(
        [r @ (np.cos(a), np.sin(a), 0.0) for r, a in zip(rotations, yaws, strict=True)]
    )
    up = np.array([r[:, 2] for r in rotations])
    return Columns(origins, ahead, up, np.linspace(2.98, 3.12, count))


SLOPES = np.tan(np.radians(np.linspace(-24, 12, 9)))


def assert_same(ours: Hits, theirs: Hits) -> None:
    assert np.array_equal(ours.owners, theirs.owners)
    np.testing.assert_allclose(ours.ranges, theirs.ranges, rtol=2e-7, atol=1e-6)
    np.testing.assert_allclose(ours.cosines, theirs.cosines, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours.reflectivity, theirs.reflectivity, rtol=1e-6)
    assert np.array_equal(ours.outline_rays, theirs.outline_rays)
    assert np.array_equal(ours.outline_hits, theirs.outline_hits)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("tilt", [0.0, 0.05, 0.6])
def test_random_scenes_as_brute_force(seed: int, tilt: float) -> None:
    rng = np.random.default_rng([seed, int(tilt * 100)])
    scene, columns = random_scene(rng), random_columns(rng, tilt=tilt)
    theirs = brute_force(scene, columns, SLOPES)
    assert (theirs.owners >= 0).sum() > 5
    ours = cast(scene, columns, SLOPES, max_range_m=MAX_RANGE_M, outlines=True)
    assert_same(ours, theirs)
    bare = cast(scene, columns, SLOPES, max_range_m=MAX_RANGE_M)
    for name in ("ranges", "owners", "cosines", "reflectivity"):
        assert np.array_equal(getattr(bare, name), getattr(ours, name))


def still(*prisms: Prisms) -> Scene:
    return Scene.still(Prisms.join(prisms), Prisms.empty(), np.empty((0, 3)))


def square(x: float, y: float, half: float, **kinds: float) -> Prisms:
    corners = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    bottom, top = kinds.pop("bottom", 0.0), kinds.pop("top", 3.0)
    owner = int(kinds.pop("owner", -2))
    return Prisms.of(half * corners + (x, y), bottom, top, owner=owner, **kinds)


def column(*, origin: tuple[float, float, float] = (0, 0, 1), azimuth: float = 0.0) -> Columns:
    ahead = np.array([[np.cos(azimuth), np.sin(azimuth), 0.0]])
    return Columns(np.array([origin]), ahead, np.array([[0.0, 0, 1]]), np.zeros(1))


def single(scene: Scene, rays: Columns, slope: float = 0.0) -> tuple[float, int, float]:
    hits = cast(scene, rays, np.array([slope]), max_range_m=MAX_RANGE_M)
    return float(hits.ranges[0, 0]), int(hits.owners[0, 0]), float(hits.cosines[0, 0])


def test_axis_parallel_rays() -> None:
    assert single(still(square(10, 0, 2)), column()) == (8.0, -2, 1.0)
    assert single(still(square(10, 2.5, 2)), column())[1] == NOTHING
    sideways = column(azimuth=np.pi / 2)
    distance, owner, cosine = single(still(square(0, 10, 2)), sideways)
    assert (distance, owner) == (pytest.approx(8.0), -2)
    assert cosine == pytest.approx(1.0)


def test_ray_along_a_face_in_its_plane_is_decided_like_the_others() -> None:
    # The face y = 0 of the square contains the ray: it touches, so it hits the front face.
    assert single(still(square(10, 2, 2)), column())[:2] == (8.0, -2)


def test_top_and_bottom_faces() -> None:
    slab = square(10, 0, 4, bottom=1.5, top=2.0)
    from_above = single(still(slab), column(origin=(0, 0, 4)), slope=-0.25)
    assert from_above == (pytest.approx(8 * np.hypot(1, 0.25)), -2, pytest.approx(0.2425, abs=1e-4))
    from_below = single(still(slab), column(origin=(0, 0, 0.5)), slope=0.125)
    assert from_below == (pytest.approx(8 * np.hypot(1, 0.125)), -2, pytest.approx(0.124, abs=1e-3))


def test_a_prism_around_the_origin_is_not_hit() -> None:
    around, ahead = square(0, 0, 2), square(10, 0, 1, owner=-3)
    assert single(still(around, ahead), column())[:2] == (9.0, -3)
    assert single(still(around), column(), slope=-1.0)[1] == GROUND


def test_nothing_beyond_the_greatest_range() -> None:
    assert single(still(square(MAX_RANGE_M + 3, 0, 2)), column()) == (0.0, NOTHING, 0.0)
    assert single(still(square(MAX_RANGE_M + 1, 0, 2)), column())[1] == -2


def test_nearest_wins_whatever_the_order() -> None:
    near, far = square(10, 0, 2), square(20, 0, 6, owner=-3, top=9.0)
    for scene in (still(near, far), still(far, near)):
        assert single(scene, column())[1] == -2
        assert single(scene, column(), slope=0.4)[1] == -3


def test_absent_actors_are_not_hit() -> None:
    body = square(0, 0, 2, owner=0)
    poses = np.array([[[10.0, 0, 0]]])
    for present, owner in ((True, 0), (False, NOTHING)):
        scene = Scene(Prisms.empty(), body, np.zeros(1), poses, np.array([present]))
        assert single(scene, column())[1] == owner


@pytest.mark.parametrize("order", ["turned", "shuffled"])
def test_order_of_columns_does_not_matter(order: str) -> None:
    rng = np.random.default_rng(8)
    scene, columns = random_scene(rng), random_columns(rng, tilt=0.05)
    index = np.arange(len(columns))[::-1] if order == "turned" else rng.permutation(len(columns))
    moved = Columns(*(getattr(columns, name)[index] for name in Columns.__slots__))
    straight = cast(scene, columns, SLOPES, max_range_m=MAX_RANGE_M)
    other = cast(scene, moved, SLOPES, max_range_m=MAX_RANGE_M)
    assert np.array_equal(straight.owners[index], other.owners)
    assert np.array_equal(straight.ranges[index], other.ranges)


@pytest.mark.parametrize("pitch", [0.0, 0.3, 1.2])
def test_pinhole_camera_as_brute_force(pitch: float) -> None:
    rng = np.random.default_rng(3)
    scene = random_scene(rng, knots=1)
    world = Pose.from_euler(0, 0, 1.5, yaw=2.0, pitch=pitch).rotation
    across = np.linspace(-0.7, 0.7, 40)
    ahead = world[:, 0] - across[:, None] * world[:, 1]
    up = np.broadcast_to(-world[:, 2], ahead.shape)
    columns = Columns(np.full((40, 3), (0.0, 0.0, 1.5)), ahead, up, np.zeros(40))
    slopes = np.linspace(-0.5, 0.5, 15)
    theirs = brute_force(scene, columns, slopes)
    assert_same(cast(scene, columns, slopes, max_range_m=MAX_RANGE_M, outlines=True), theirs)


def test_porous_prisms_let_through_by_the_exponential_law() -> None:
    extinction, depth = 0.3, 4.0
    tree = square(20, 0, depth / 2, top=60.0, extinction=extinction)
    azimuths = np.linspace(-0.05, 0.05, 200)
    columns = Columns(
        np.full((200, 3), (0.0, 0, 1)),
        np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(200)]),
        np.full((200, 3), (0.0, 0, 1)),
        np.zeros(200),
    )
    slopes = np.linspace(0.01, 0.1, 100)
    hits = cast(still(tree), columns, slopes, max_range_m=MAX_RANGE_M)
    hit = hits.owners == -2
    lengths = depth * np.sqrt(1 + slopes**2) / np.cos(azimuths)[:, None]
    expected = 1 - np.exp(-extinction * lengths).mean()
    assert hit.mean() == pytest.approx(expected, abs=5 * np.sqrt(0.25 / hit.size))
    paths = hits.ranges - (20 - depth / 2) * np.sqrt(1 + slopes**2) / np.cos(azimuths)[:, None]
    assert paths[hit].min() >= 0
    assert (paths[hit] < 1).mean() == pytest.approx((1 - np.exp(-extinction)) / expected, abs=0.03)
    assert set(hits.cosines[hit]) == {0.5}


def test_porous_paths_depend_on_seed_and_stamp_alone() -> None:
    tree = square(10, 0, 2, top=9.0, extinction=0.4)
    columns = column()
    slopes = np.linspace(0.0, 0.3, 64)

    def ranges(seed: int, stamp_s: float) -> np.ndarray:
        scene = Scene.still(tree, Prisms.empty(), np.empty((0, 3)), seed)
        timed = Columns(columns.origins, columns.ahead, columns.up, np.array([stamp_s]))
        return cast(scene, timed, slopes, max_range_m=MAX_RANGE_M).ranges

    assert np.array_equal(ranges(1, 0.5), ranges(1, 0.5))
    assert not np.array_equal(ranges(1, 0.5), ranges(2, 0.5))
    assert not np.array_equal(ranges(1, 0.5), ranges(1, 0.6))


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="increasing slopes"):
        cast(still(), column(), np.array([0.2, 0.1]), max_range_m=10.0)
    with pytest.raises(ValueError, match="max_range_m"):
        cast(still(), column(), np.array([0.2]), max_range_m=0.0)
    with pytest.raises(ValueError, match="owners below 1"):
        Scene(Prisms.empty(), square(0, 0, 1, owner=3), np.zeros(1), np.zeros((1, 1, 3)), [True])
    with pytest.raises(ValueError, match="owners of -2 and below"):
        still(square(0, 0, 1, owner=0))
