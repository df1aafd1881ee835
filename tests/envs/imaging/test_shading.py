from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Category, Pose
from roadscope.envs.imaging import (
    LIGHTS,
    CameraView,
    Ground,
    Light,
    Pinhole,
    cast_shadows,
    lens_of,
    light_named,
    mounted,
    rasterise,
    shade,
    solids_of,
)
from roadscope.envs.raycast import Scene
from roadscope.envs.world import GREY, MATERIALS, RUBBER, Prisms, Surface, body_prisms, surface_of
from tests.envs.worlds import straight

PINHOLE = Pinhole.centred(160, 120, 120.0)
AHEAD = Pose.from_euler(0, 0, 1.4) @ mounted(0, 0, 0)
NONE = np.empty((0, 3))
LEVEL = Light(clouds=0.0, sun_azimuth=np.pi, sun_elevation=0.6)


def bare() -> Ground:
    return Ground(Surface(np.empty((0, 5)), np.empty((0, 6))), "bare")


def wall(x: float, y: float, material: int) -> Prisms:
    corners = np.array([[0, -1], [1, -1], [1, 1], [0, 1]], float) * [1.0, 0.05 * x] + [x, y]
    return Prisms.of(corners, 0.0, 0.3 * x, owner=-2 - int(x), material=material)


def shaded(
    scene: Scene,
    pose: Pose = AHEAD,
    light: Light = LEVEL,
    *,
    ground: Ground | None = None,
    pinhole: Pinhole = PINHOLE,
    **air: float,
) -> np.ndarray:
    solids = solids_of(scene, 0.0)
    raster = rasterise(scene, pinhole, pose, 0.0, solids=solids)
    categories = np.zeros(len(scene.present), np.int8)
    view = CameraView(raster, scene, solids, pinhole, pose, 0.0, categories)
    return shade(view, ground or bare(), light, **air).copy()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("visibility_m", [50.0, 120.0, 500.0])
def test_contrast_falls_by_koschmieders_law(visibility_m: float) -> None:
    extinction = 3.912 / visibility_m
    differences = []
    distances = np.array([8.0, 20.0, 40.0, 70.0])
    for x in distances:
        walls = [wall(x, 0.1 * x, GREY), wall(x, -0.1 * x, RUBBER)]
        scene = Scene.still(Prisms.join(walls), Prisms.empty(), NONE)
        image = shaded(scene, extinction_per_m=extinction)
        # Two walls at the same distance: the airlight is the same and cancels.
        differences.append(image[58, 68] - image[58, 91])
    expected = np.exp(-(extinction + 1.2e-4) * (distances - distances[0]) * np.hypot(1, 11.5 / 120))
    got = np.array(differences)[:, 0]
    assert np.allclose(got / got[0], expected, rtol=0.01)


def in_shadow(scene: Scene, place: np.ndarray, sun: np.ndarray) -> bool:
    """Walk towards the sun in small steps; return whether a prism contains any of these points."""
    for prism in range(len(scene.static)):
        corners = scene.static.footprints[prism, : scene.static.corners[prism]]
        sides = np.roll(corners, -1, axis=0) - corners
        for z in np.arange(0.01, 5.0, 0.02):
            arms = place + sun[:2] / sun[2] * z - corners
            inside = (sides[:, 0] * arms[:, 1] - sides[:, 1] * arms[:, 0] >= 0).all()
            if inside and scene.static.bottoms[prism] <= z <= scene.static.tops[prism]:
                return True
    return False


@pytest.mark.sampled(1)
@pytest.mark.parametrize("azimuth", [0.4, 2.0, -1.3])
def test_shadows_fall_where_a_ray_to_the_sun_is_stopped(azimuth: float) -> None:
    boxes = [
        Prisms.of(np.array([[9, -1], [11, -1], [11, 1], [9, 1.0]]), 0.0, 2.0, owner=-2),
        Prisms.of(np.array([[14, 3], [15, 3], [14.5, 4.0]]), 0.8, 3.0, owner=-3),
    ]
    scene = Scene.still(Prisms.join(boxes), Prisms.empty(), NONE)
    pose = Pose.from_euler(0, 0, 4.0, pitch=0.3) @ mounted(0, 0, 0)
    raster, solids = rasterise(scene, PINHOLE, pose, 0.0), solids_of(scene, 0.0)
    sun = Light(sun_azimuth=azimuth, sun_elevation=0.7).towards_sun
    lit, open_sky = np.empty((2, *raster.faces.shape), np.uint8)
    cast_shadows(lens_of(PINHOLE, pose), solids, raster.faces, sun, lit, open_sky)
    ground = np.argwhere(raster.faces == -1)
    rng = np.random.default_rng(0)
    wrong = 0
    picked = np.concatenate([rng.permutation(ground)[:150], np.argwhere(lit == 0)[::40]])
    for row, column in picked:
        ray = np.array([column + 0.5 - 80, row + 0.5 - 60, 120.0]) / 120.0
        place = pose.translation + pose.rotation @ ray / raster.q[row, column]
        wrong += in_shadow(scene, place[:2], sun) != (lit[row, column] == 0)
    assert (lit == 0).sum() > 100
    assert wrong <= 3


def test_shadows_point_away_from_the_sun() -> None:
    box = Prisms.of(np.array([[9, -1], [11, -1], [11, 1], [9, 1.0]]), 0.0, 2.0, owner=-2)
    scene = Scene.still(box, Prisms.empty(), NONE)
    pose = Pose.from_euler(0, 0, 4.0, pitch=0.3) @ mounted(0, 0, 0)
    left = shaded(scene, pose, Light(sun_azimuth=np.pi / 2, sun_elevation=0.5, clouds=0.0))
    right = shaded(scene, pose, Light(sun_azimuth=-np.pi / 2, sun_elevation=0.5, clouds=0.0))
    # A sun on the left darkens the ground right of the box, and the other way round.
    assert left[67:73, 103:112].mean() < 0.7 * right[67:73, 103:112].mean()
    assert right[67:73, 48:57].mean() < 0.7 * left[67:73, 48:57].mean()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize("beta", [0.0, 0.05])
def test_light_is_finite_in_random_scenes(kind: str, beta: float) -> None:
    rng = np.random.default_rng(3)
    sizes = {c: np.array([4.5 if c < 3 else 0.8, 0.9, 1.7]) for c in Category}
    bodies = Prisms.join(
        [replace_owner(body_prisms(c, sizes[c], rng), row) for row, c in enumerate(Category)]
    )
    poses = np.array([[6.0 + 3 * k, 2.0 * (k % 3) - 2, 0.7 * k] for k in range(len(Category))])
    every = [replace_material(wall(12.0 + k, 9.0 - 0.4 * k, 0), k) for k in range(len(MATERIALS))]
    scene = Scene.still(Prisms.join(every), bodies, poses)
    light = light_named(kind, rng)
    for pose in (AHEAD, Pose.from_euler(0, 0, 3, pitch=1.5) @ mounted(0, 0, 0)):
        image = shaded(scene, pose, light, extinction_per_m=beta, wet=1.0)
        assert np.isfinite(image).all()
        assert (image >= 0).all()


def replace_owner(prisms: Prisms, row: int) -> Prisms:
    return replace(prisms, owners=np.full(len(prisms), row, np.int32))


def replace_material(prisms: Prisms, material: int) -> Prisms:
    return replace(prisms, materials=np.full(len(prisms), material, np.int16))


def test_an_empty_scene_is_sky_and_ground() -> None:
    image = shaded(Scene.still(Prisms.empty(), Prisms.empty(), NONE))
    assert np.isfinite(image).all()
    assert image[5].mean() > 2 * image[110].mean()


def test_a_camera_inside_a_body_does_not_see_it() -> None:
    box = Prisms.of(np.array([[-2, -1], [2, -1], [2, 1], [-2, 1.0]]), 0.0, 3.0, owner=-2)
    image = shaded(Scene.still(box, Prisms.empty(), NONE))
    assert np.isfinite(image).all()
    assert image[5].mean() > 0.2


def test_only_lamps_are_bright_at_night() -> None:
    scene = Scene.still(Prisms.empty(), Prisms.empty(), NONE)
    night = replace(light_named("night", np.random.default_rng(0)), clouds=0.0)
    lit = shaded(scene, light=night)
    unlit = shaded(scene, light=replace(night, lamps=False))
    assert unlit.max() < 0.05
    # Headlights light the ground ahead of the car and not the far ground.
    assert lit[90, 80].mean() > 20 * unlit[90, 80].mean()
    assert lit[62, 80].mean() < 2 * unlit[62, 80].mean() + 0.01


def looking(x: float, *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    return Pose.from_euler(x, 3.0, 1.4, yaw=yaw, pitch=pitch, roll=roll) @ mounted(0, 0, 0)


def test_images_do_not_depend_on_the_path_of_the_camera() -> None:
    surface = surface_of(straight())
    ground, empty = Ground(surface, "urban"), Scene.still(Prisms.empty(), Prisms.empty(), NONE)
    for x in (-200.0, 0.0, 90.0, 40.0):
        image = shaded(empty, looking(x), ground=ground)
    assert np.array_equal(image, shaded(empty, looking(40.0), ground=Ground(surface, "urban")))


@given(
    yaw=st.floats(-3.0, 3.0),
    pitch=st.floats(-0.6, 1.5),
    roll=st.floats(-1.0, 1.0),
    focal=st.sampled_from([40.0, 120.0, 400.0]),
)
@settings(max_examples=25, deadline=None)
def test_no_ground_is_shown_that_was_not_painted(
    yaw: float, pitch: float, roll: float, focal: float
) -> None:
    pose, pinhole = looking(0.0, yaw=yaw, pitch=pitch, roll=roll), Pinhole.centred(160, 120, focal)
    empty = Scene.still(Prisms.empty(), Prisms.empty(), NONE)
    black, white = (Ground(surface_of(straight()), "urban") for _ in range(2))
    white.cells[:] = 0xFFFFFF
    images = [shaded(empty, pose, ground=each, pinhole=pinhole) for each in (black, white)]
    assert np.array_equal(*images)


def test_an_unknown_light_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"noon.*night"):
        light_named("noon", np.random.default_rng(0))
    assert light_named(LEVEL, np.random.default_rng(0)) is LEVEL
    assert light_named("dusk", np.random.default_rng(4)) == light_named(
        "dusk", np.random.default_rng(4)
    )
