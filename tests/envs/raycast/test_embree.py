"""The caster against Intel's Embree, which works in single precision on triangles."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from research.speed_casting import import_open3d, ray_table, triangulate
from roadscope.benchmarks.speed import parked_scene, sensor_poses
from roadscope.envs.raycast import NOTHING, Hits, Scene, cast
from roadscope.envs.sensors import SPECS, lidar_columns

TILTS = [(0.0, 0.0), (0.035, 0.0175), (-0.3, 0.2)]
EDGE_CASES = 2e-4
"""Share of rays that may be on the other side of an edge in single precision."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parked_scene(120, seed=4)


def ours(scene: Scene, tilt: tuple[float, float]) -> tuple[Hits, np.ndarray]:
    spec = SPECS["hdl32e"]
    columns = lidar_columns(scene, spec, sensor_poses(*tilt, moving=False), 0.0)
    slopes = np.tan(spec.elevations)
    hits = cast(scene, columns, slopes, max_range_m=spec.range_max_m)
    return hits, ray_table(columns, slopes)


def compare(hits: Hits, ranges: np.ndarray, owners: np.ndarray) -> None:
    owners = np.where(ranges <= SPECS["hdl32e"].range_max_m, owners, NOTHING)
    both = (hits.owners != NOTHING) & (owners != NOTHING)
    differences_m = np.abs(hits.ranges[both] - ranges[both])
    assert both.sum() > 10_000
    assert np.median(differences_m) < 1e-5
    assert (differences_m > 0.01).sum() + (hits.owners != owners).sum() <= EDGE_CASES * owners.size


@pytest.mark.slow
@pytest.mark.parametrize("tilt", TILTS)
def test_as_embree_through_trimesh(scene: Scene, tilt: tuple[float, float]) -> None:
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("embreex")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    hits, table = ours(scene, tilt)
    vertices, triangles, owners = triangulate(scene, 400.0)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    rays = table[::4].reshape(-1, 6).astype(float)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        embree = RayMeshIntersector(mesh, scale_to_box=False)
        faces = embree.intersects_first(rays[:, :3], rays[:, 3:])
        points, index, _ = embree.intersects_location(rays[:, :3], rays[:, 3:], multiple_hits=False)
    ranges = np.full(len(rays), np.inf)
    ranges[index] = np.linalg.norm(points - rays[index, :3], axis=1)
    source = np.where(faces >= 0, owners[faces], NOTHING)
    shape = table[::4].shape[:2]
    every = Hits(hits.ranges[::4], hits.owners[::4], hits.cosines[::4], hits.reflectivity[::4])
    compare(every, ranges.reshape(shape), source.reshape(shape))


@pytest.mark.parametrize("tilt", TILTS)
def test_as_embree_through_open3d(scene: Scene, tilt: tuple[float, float]) -> None:
    open3d = import_open3d()
    if open3d is None:
        pytest.skip("Open3D cannot be imported")
    hits, table = ours(scene, tilt)
    vertices, triangles, owners = triangulate(scene, 400.0)
    embree = open3d.t.geometry.RaycastingScene(nthreads=1)
    embree.add_triangles(
        open3d.core.Tensor(vertices.astype(np.float32)),
        open3d.core.Tensor(triangles.astype(np.uint32)),
    )
    cast_result = embree.cast_rays(open3d.core.Tensor(table), nthreads=1)
    ranges = cast_result["t_hit"].numpy()
    faces = np.minimum(cast_result["primitive_ids"].numpy(), len(owners))
    compare(hits, ranges, np.append(owners, NOTHING)[faces])
