from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Pose
from roadscope.envs.imaging import (
    Ground,
    Light,
    Pinhole,
    light_named,
    mounted,
    rasterise,
    solids_of,
)
from roadscope.envs.raycast import Columns, Scene, cast
from roadscope.envs.sensors import CameraMotion, CameraSpec, expose, exposed, image_truth
from roadscope.envs.world import Prisms, surface_of
from tests.envs.raycast.test_cast import random_scene
from tests.envs.worlds import straight

SPEC = CameraSpec("small", Pinhole.centred(320, 240, 240.0), period_s=0.05)
EMPTY = Scene.still(Prisms.empty(), Prisms.empty(), np.empty((0, 3)))
POSE = Pose.from_euler(0, 0, 1.5) @ mounted(0, 0, 0)
LINEAR = np.where(
    np.arange(256) / 255 <= 0.04045,
    np.arange(256) / 255 / 12.92,
    ((np.arange(256) / 255 + 0.055) / 1.055) ** 2.4,
)


def flat(value: float, spec: CameraSpec = SPEC, iso: float = 1.0, **options: object) -> np.ndarray:
    """Pixels of an evenly bright sky."""
    pinhole = spec.pinhole
    light = np.full((pinhole.height, pinhole.width, 3), value, np.float32)
    solids = solids_of(EMPTY, 0.0)
    raster = rasterise(EMPTY, pinhole, POSE, 0.0, solids=solids)
    return exposed(
        light,
        raster,
        solids,
        spec,
        Light(iso=iso, sun_azimuth=np.pi),
        world_from_camera=POSE,
        stamp_s=1.0,
        **options,
    )


def images(stamp_s: float = 3.04, spec: CameraSpec = SPEC, **options: object) -> np.ndarray:
    scene = random_scene(np.random.default_rng(4))
    image, _ = expose(
        scene,
        spec,
        POSE,
        stamp_s,
        ground=Ground(surface_of(straight()), "urban"),
        light=light_named("dusk", np.random.default_rng(1)),
        categories=np.zeros(len(scene.present), np.int8),
        **options,
    )
    return image.pixels


@pytest.mark.parametrize("value", [0.05, 0.2, 0.6])
@pytest.mark.parametrize("iso", [1.0, 8.0])
def test_noise_is_shot_and_read_noise(value: float, iso: float) -> None:
    spec = replace(SPEC, vignetting=0.0)
    light = LINEAR[flat(value, spec, iso)]
    rounding = (LINEAR[1:] - LINEAR[:-1])[flat(value, spec, iso).max() - 1] ** 2 / 12
    expected = iso * value / spec.full_well + (iso * spec.read_noise / spec.full_well) ** 2
    assert light.mean() == pytest.approx(value, rel=0.01)
    assert light.var() == pytest.approx(expected, rel=0.05, abs=1.5 * rounding)
    draws = light - light.mean()
    correlation = (draws[1:] * draws[:-1]).mean() / light.var()
    assert abs(correlation) < 0.03
    assert abs((draws[..., 0] * draws[..., 1]).mean() / light.var()) < 0.03


def test_a_shorter_exposure_is_as_bright_and_noisier() -> None:
    spec = replace(SPEC, vignetting=0.0)
    usual, short = (LINEAR[flat(0.2, replace(spec, exposure_s=s))] for s in (0.004, 0.001))
    assert short.mean() == pytest.approx(usual.mean(), rel=0.01)
    electrons = [
        iso * 0.2 / spec.full_well + (iso * spec.read_noise / spec.full_well) ** 2
        for iso in (1.0, 4.0)
    ]
    assert short.var() / usual.var() == pytest.approx(electrons[1] / electrons[0], rel=0.1)


def test_without_noise_the_bytes_are_srgb() -> None:
    spec = replace(SPEC, vignetting=0.0, full_well=1e12, read_noise=0.0)
    for value in np.linspace(0.0, 1.0, 60):
        byte = 255 * (12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055)
        assert np.abs(flat(value, spec) - byte).max() <= 0.6


def test_corners_lose_the_light_that_the_spec_says() -> None:
    spec = replace(SPEC, vignetting=0.4, full_well=1e9, read_noise=0.0)
    light = LINEAR[flat(0.5, spec)]
    assert light[120, 160].mean() == pytest.approx(0.5, rel=0.02)
    assert light[0, 0].mean() == pytest.approx(0.3, rel=0.02)
    assert light[0, 160].mean() == pytest.approx(0.5 * (1 - 0.4 * 120**2 / 200**2), rel=0.02)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("rain", [0.0, 25.0])
def test_same_seed_same_bytes(rain: float) -> None:
    first = images(noise_seed=3, rain_mm_h=rain, extinction_per_m=0.01)
    images(noise_seed=3, stamp_s=3.06)
    assert np.array_equal(first, images(noise_seed=3, rain_mm_h=rain, extinction_per_m=0.01))
    assert not np.array_equal(first, images(noise_seed=4, rain_mm_h=rain, extinction_per_m=0.01))


def test_rain_draws_streaks_and_its_amount_counts() -> None:
    spec = replace(SPEC, vignetting=0.0, full_well=1e9, read_noise=0.0)
    counts = []
    for rate in (2.0, 50.0):
        pinhole = spec.pinhole
        light = np.full((pinhole.height, pinhole.width, 3), 0.2, np.float32)
        light[:8] = 0.8
        solids = solids_of(EMPTY, 0.0)
        raster = rasterise(EMPTY, pinhole, POSE, 0.0, solids=solids)
        pixels = exposed(
            light,
            raster,
            solids,
            spec,
            Light(sun_azimuth=np.pi),
            world_from_camera=POSE,
            stamp_s=1.0,
            rain_mm_h=rate,
        )
        counts.append((pixels[10:] > pixels[10:].min()).sum())
    assert counts[1] > 3 * counts[0] > 0


def test_a_plain_camera_has_neither_noise_nor_shadow() -> None:
    spec = replace(SPEC, plain=True)
    plain = images(spec=spec, noise_seed=1)
    assert np.array_equal(plain, images(spec=spec, noise_seed=2, extinction_per_m=0.1))
    wall = Prisms.of(np.array([[5, -4], [6, -4], [6, 4], [5, 4.0]]), 0.0, 9.0, owner=-2)
    image, truth = expose(
        Scene.still(wall, Prisms.empty(), np.empty((0, 3))),
        spec,
        POSE,
        0.0,
        ground=Ground(surface_of(straight()), "urban"),
        light=Light(),
        categories=np.empty(0, np.int8),
    )
    assert len(np.unique(image.pixels[truth.owners == -2], axis=0)) == 1


def test_sideways_motion_smears_upright_edges_only() -> None:
    spec = replace(SPEC, vignetting=0.0, full_well=1e9, read_noise=0.0, exposure_s=0.02)
    spec = replace(spec, full_well=1e12)
    block = Prisms.of(np.array([[5, -60], [6, -60], [6, 0], [5, 0.0]]), 0.0, 20.0, owner=-2)
    scene = Scene.still(block, Prisms.empty(), np.empty((0, 3)))
    solids = solids_of(scene, 0.0)
    raster = rasterise(scene, spec.pinhole, POSE, 0.0, solids=solids)
    stripes = np.zeros((240, 320, 3), np.float32)
    stripes[:, 240:] = 0.49
    motion = CameraMotion(np.array([0.0, 5.0, 0.0]), np.zeros(3), np.empty((0, 2)))
    sharp, smeared = (
        exposed(
            stripes.copy(),
            raster,
            solids,
            spec,
            Light(sun_azimuth=np.pi),
            world_from_camera=POSE,
            stamp_s=0.0,
            motion=m,
        )
        for m in (None, motion)
    )
    # 5 m/s for 20 ms at 5 m: 0.1 m, or 4.8 pixels.
    steps = np.unique(smeared[60, 230:250, 0])
    assert len(np.unique(sharp[60, 230:250, 0])) == 2
    assert 5 <= len(steps) <= 8
    assert np.array_equal(sharp[60, :225], smeared[60, :225])


@pytest.mark.parametrize("seed", range(4))
def test_the_camera_shows_what_the_lidar_hits(seed: int) -> None:
    scene = random_scene(np.random.default_rng(seed), knots=1)
    hard = replace(scene.static, extinctions=np.zeros(len(scene.static)))
    soft = replace(scene.moving, extinctions=np.zeros(len(scene.moving)))
    scene = Scene(hard, soft, scene.knots_s, scene.poses, scene.present, scene.seed)
    stamp = float(scene.knots_s[0])
    pinhole = SPEC.pinhole
    solids = solids_of(scene, stamp)
    raster = rasterise(scene, pinhole, POSE, stamp, outlines=True, solids=solids)
    truth = image_truth(raster, solids, len(scene.present))
    yaws, slopes = np.linspace(-0.5, 0.5, 300), np.linspace(-0.35, 0.35, 60)
    ahead = np.column_stack([np.cos(yaws), np.sin(yaws), np.zeros(300)])
    up = np.tile([0.0, 0.0, 1.0], (300, 1))
    # A LiDAR in the camera's place: no parallax, so every return lies on the surface in its pixel.
    columns = Columns(np.tile(POSE.translation, (300, 1)), ahead, up, np.full(300, stamp))
    hits = cast(scene, columns, slopes, max_range_m=200.0)
    direction = ahead[:, None] + slopes[:, None] * up[:, None]
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    ranges, owners = (a if a.shape == (300, 60) else a.T for a in (hits.ranges, hits.owners))
    hit = np.isfinite(ranges) & (ranges > 0) & (owners >= -60)
    points = POSE.translation + ranges[hit][:, None] * direction[hit]
    camera_points = POSE.inverse().apply(points)
    pixels = np.floor(pinhole.project(camera_points)).astype(int)
    inside = ((pixels >= 1) & (pixels < [pinhole.width - 1, pinhole.height - 1])).all(axis=1)
    column, row = pixels[inside].T
    around = [truth.owners[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    settled = (np.array(around) == around[4]).all(axis=0)
    assert settled.sum() > 1000
    assert (around[4][settled] == owners[hit][inside][settled]).all()
    depth = truth.depth[row, column][settled]
    solid = owners[hit][inside][settled] != -1
    assert np.allclose(depth[solid], camera_points[inside, 2][settled][solid], rtol=0.15)
