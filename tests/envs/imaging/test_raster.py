import numpy as np
import pytest

from roadscope.core import Pose
from roadscope.envs.imaging import FACES, Pinhole, mounted, rasterise, solids_of
from roadscope.envs.raycast import GROUND, NOTHING, Columns, Scene, cast
from roadscope.envs.world import Prisms
from tests.envs.raycast.test_cast import random_scene

PINHOLE = Pinhole(160, 90, (110.0, 120.0), (77.5, 48.0))
STAMP_S = 3.04


def cameras(seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    pose = Pose.from_euler(
        *rng.uniform(-5, 5, 2),
        rng.uniform(0.5, 3.0),
        yaw=rng.uniform(-4, 4),
        pitch=rng.uniform(-0.3, 0.3),
        roll=rng.uniform(-0.3, 0.3),
    )
    return pose @ mounted(0.0, 0.0, 0.0)


def rays(scene: Scene, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """The ray caster's owners and depths, ray by ray."""
    u = (np.arange(PINHOLE.width) + 0.5 - PINHOLE.centre_px[0]) / PINHOLE.focal_px[0]
    v = (np.arange(PINHOLE.height) + 0.5 - PINHOLE.centre_px[1]) / PINHOLE.focal_px[1]
    right, down, ahead = pose.rotation.T
    columns = Columns(
        np.tile(pose.translation, (len(u), 1)),
        ahead + u[:, None] * right,
        np.tile(-down, (len(u), 1)),
        np.full(len(u), STAMP_S),
    )
    hits = cast(scene, columns, np.sort(-v), max_range_m=1e5)
    ranges, owners = np.flipud(hits.ranges.T), np.flipud(hits.owners.T)
    return owners, ranges / np.linalg.norm(PINHOLE.rays(), axis=2)


def owners_of(raster, scene: Scene) -> np.ndarray:
    table = np.concatenate([np.repeat(solids_of(scene, STAMP_S).owners, FACES), [NOTHING, GROUND]])
    return table[raster.faces]


@pytest.mark.parametrize("seed", range(12))
def test_every_pixel_equals_the_cast_of_its_ray(seed: int) -> None:
    scene, pose = random_scene(np.random.default_rng(seed)), cameras(seed)
    raster = rasterise(scene, PINHOLE, pose, STAMP_S)
    owners, depths = rays(scene, pose)
    drawn = owners_of(raster, scene)
    # A ray that grazes an edge may fall to either side of it by rounding.
    assert (drawn != owners).sum() <= 2
    same = (drawn == owners) & (owners != NOTHING)
    assert same.sum() > 1000
    assert np.allclose(1 / raster.q[same], depths[same], rtol=2e-6)
    assert (raster.q[drawn == NOTHING] == 0).all()


@pytest.mark.parametrize("seed", range(6))
def test_an_outline_is_what_the_actor_covers_alone(seed: int) -> None:
    scene, pose = random_scene(np.random.default_rng(seed)), cameras(seed)
    raster = rasterise(scene, PINHOLE, pose, STAMP_S, outlines=True)
    for actor in range(len(scene.present)):
        alone = Scene(
            Prisms.empty(),
            scene.moving,
            scene.knots_s,
            scene.poses,
            scene.present & (np.arange(len(scene.present)) == actor),
        )
        covered = owners_of(rasterise(alone, PINHOLE, pose, STAMP_S), alone) == actor
        assert raster.outline_pixels[actor] == covered.sum()
        if not covered.any():
            continue
        rows, columns = np.nonzero(covered)
        left, top, right, bottom = raster.boxes[actor]
        assert left <= columns.min() + 0.5 <= columns.max() + 0.5 <= right
        assert top <= rows.min() + 0.5 <= rows.max() + 0.5 <= bottom
        assert 0 <= left < right <= PINHOLE.width
        assert 0 <= top < bottom <= PINHOLE.height


def test_transmission_of_foliage_follows_the_beer_lambert_law() -> None:
    hedge = np.array([[20.0, -40.0], [22.0, -40.0], [22.0, 40.0], [20.0, 40.0]])
    leaves = Prisms.of(hedge, 0.0, 60.0, owner=-2, extinction=0.7)
    scene = Scene.still(leaves, Prisms.empty(), np.empty((0, 3)))
    pinhole = Pinhole.centred(400, 300, 1200.0)
    pose = Pose.from_euler(0, 0, 10.0) @ mounted(0, 0, 0)
    raster = rasterise(scene, pinhole, pose, 0.0)
    stretch = np.linalg.norm(pinhole.rays(), axis=2) / pinhole.rays()[..., 2]
    assert (raster.faces < 0).mean() == pytest.approx(np.exp(-0.7 * 2.0 * stretch).mean(), abs=0.02)
    assert rasterise(scene, pinhole, pose, 0.0) == raster


def test_a_face_across_the_image_plane_is_cut() -> None:
    wall = np.array([[-20.0, 2.0], [20.0, 2.0], [20.0, 3.0], [-20.0, 3.0]])
    scene = Scene.still(Prisms.of(wall, 0.0, 4.0, owner=-2), Prisms.empty(), np.empty((0, 3)))
    raster = rasterise(scene, PINHOLE, Pose.from_euler(0, 0, 1.5) @ mounted(0, 0, 0), 0.0)
    left = 1 / raster.q[48, 0]
    ray = (0.5 - PINHOLE.centre_px[0]) / PINHOLE.focal_px[0]
    assert left * -ray == pytest.approx(2.0, rel=1e-5)


def test_projected_points_lie_on_their_rays() -> None:
    rays = PINHOLE.rays()
    points = 7.0 * rays.reshape(-1, 3)
    pixels = PINHOLE.project(points).reshape(PINHOLE.height, PINHOLE.width, 2)
    assert np.allclose(pixels[10, 20], (20.5, 10.5))
    assert np.allclose(
        points @ PINHOLE.intrinsics.T / points[:, 2:],
        np.insert(pixels.reshape(-1, 2), 2, 1.0, axis=1),
    )
