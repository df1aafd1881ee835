from dataclasses import replace

import numpy as np

from roadscope.benchmarks.speed import parked_scene, sensor_poses
from roadscope.envs.raycast import CACHED_SHAPES, Scene, cast, clear_shapes, shapes_of
from roadscope.envs.sensors import SPECS, lidar_columns

SPEC = SPECS["vlp16"]


def ranges(scene: Scene) -> np.ndarray:
    columns = lidar_columns(scene, SPEC, sensor_poses(0.0, 0.0, moving=False), 0.0)
    return cast(scene, columns, np.tan(SPEC.elevations), max_range_m=100.0).ranges


def test_what_was_prepared_for_other_poses_gives_the_same_bytes() -> None:
    scene = parked_scene(30)
    moved = replace(scene, poses=scene.poses + np.array([3.0, -2.0, 0.3]))
    fewer = replace(scene, present=np.arange(len(scene.present)) % 2 == 0)
    reused = [ranges(s).tobytes() for s in (scene, moved, fewer, moved, scene)]
    fresh = []
    for s in (scene, moved, fewer, moved, scene):
        clear_shapes()
        fresh.append(ranges(s).tobytes())
    assert reused == fresh
    assert len(set(reused)) == 3


def test_scenes_of_the_same_prisms_share_their_preparation() -> None:
    scene = parked_scene(5)
    first = shapes_of(scene)
    assert shapes_of(replace(scene, poses=scene.poses + 1.0)) is first
    assert shapes_of(replace(scene, moving=scene.moving.select(np.arange(3)))) is not first
    for _ in range(CACHED_SHAPES):
        shapes_of(parked_scene(5))
    assert shapes_of(scene) is not first
