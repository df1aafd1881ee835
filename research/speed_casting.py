"""How fast rays are cast beside Open3D (Intel's Embree), on the same rays and bodies."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from roadscope import Pose
from roadscope.benchmarks.speed.casting import (
    LIDAR,
    SWEPT,
    TILTS,
    Tilt,
    bare_cast,
    driving_scene,
    parked_scene,
    sensor_poses,
    whole_sweep,
)
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep, interleaved
from roadscope.envs.raycast.casting import NOTHING, Columns, Hits
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.raycast.shapes import clear_shapes
from roadscope.envs.sensors.lidar import lidar_columns
from roadscope.envs.sensors.lidar_spec import SPECS
from roadscope.envs.world.prisms import Prisms

REPEATS = 21
GROUND_M = 400.0
"""The ground of the triangles reaches this far to each side."""
MISMATCH_M = 0.01


class Triangles(NamedTuple):
    """A scene as triangles: vertices (V, 3), corners (T, 3) and owners (T,)."""

    vertices: np.ndarray
    corners: np.ndarray
    owners: np.ndarray


def casting_steps(repeats: int = REPEATS, bodies: int = SWEPT) -> list[SpeedStep]:
    """Return a step for each tilt of the sensor."""
    return [
        SpeedStep(f"Open3D, {name}", partial(beside_open3d, name, tilt, bodies, repeats=repeats))
        for name, tilt in TILTS.items()
    ]


def import_open3d() -> Any:
    """Return the module, or None where it cannot be imported."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import open3d
    except (ImportError, OSError):
        return None
    return open3d


def beside_open3d(name: str, tilt: Tilt, bodies: int, *, repeats: int) -> list[SpeedRow]:
    """Run our cast, our sweep and Open3D's cast by turns, and compare what they hit."""
    open3d = import_open3d()
    if open3d is None:
        return [SpeedRow("Open3D", None, "is not installed: pip install open3d")]
    spec, scene = SPECS[LIDAR], parked_scene(bodies)
    slopes = np.tan(spec.elevations)
    columns = lidar_columns(scene, spec, sensor_poses(tilt.pitch, tilt.roll, moving=False), 0.0)
    triangles = triangulate(scene, GROUND_M)
    rays = open3d.core.Tensor(ray_table(columns, slopes))
    embree = _embree_scene(open3d, triangles)
    cast = bare_cast(scene, tilt)
    calls: dict[str, Callable[[], Any]] = {
        "ours": cast,
        "anew": partial(_prepared_anew, cast),
        "sweep": whole_sweep(driving_scene(bodies), tilt),
        "embree": lambda: embree.cast_rays(rays, nthreads=1),
        "rebuilt": lambda: _embree_scene(open3d, triangles).cast_rays(rays, nthreads=1),
    }
    times = interleaved(calls, repeats)
    hits = calls["embree"]()
    ranges = hits["t_hit"].numpy()
    rows = np.minimum(hits["primitive_ids"].numpy(), len(triangles.owners))
    owners = np.append(triangles.owners, NOTHING)[rows]
    owners[~(ranges <= spec.range_max_m)] = NOTHING
    what = f"{name}, {bodies} bodies"
    return [
        *_comparison(what, times, rays=len(columns) * len(slopes)),
        *agreement(what, cast(), ranges, owners.astype(np.int32)),
    ]


def _prepared_anew(cast: Callable[[], Hits]) -> Hits:
    """Cast without what was prepared for the scene before."""
    clear_shapes()
    return cast()


def _comparison(name: str, times: dict[str, float], *, rays: int) -> list[SpeedRow]:
    million = rays / 1e6
    return [
        SpeedRow(f"Open3D cast, {name}", million / times["embree"], "Mray/s"),
        SpeedRow(f"Open3D cast with scene rebuilt, {name}", million / times["rebuilt"], "Mray/s"),
        SpeedRow(f"cast beside Open3D, {name}", million / times["ours"], "Mray/s"),
        SpeedRow(f"cast with scene prepared anew, {name}", million / times["anew"], "Mray/s"),
        SpeedRow(f"cast over Open3D cast, {name}", times["embree"] / times["ours"], "times"),
        SpeedRow(
            f"cast over Open3D cast, both with scene made anew, {name}",
            times["rebuilt"] / times["anew"],
            "times",
        ),
        SpeedRow(f"Open3D cast time, {name}", times["embree"] * 1e3, "ms"),
        SpeedRow(f"whole sweep beside Open3D, {name}", times["sweep"] * 1e3, "ms"),
    ]


def agreement(name: str, ours: Hits, ranges: np.ndarray, owners: np.ndarray) -> list[SpeedRow]:
    """Compare with (C, B) ranges and owners of another caster, `NOTHING` where it hits nothing.

    A ray is mismatched when owners differ or ranges differ by more than a centimetre.
    """
    both = (ours.owners != NOTHING) & (owners != NOTHING)
    differences = np.abs(ours.ranges[both] - ranges[both])
    mismatched = ours.owners != owners
    mismatched[both] |= differences > MISMATCH_M
    return [
        SpeedRow(f"median range difference, {name}", float(np.median(differences)), "m"),
        SpeedRow(f"largest range difference, {name}", float(differences.max()), "m"),
        SpeedRow(f"mismatched rays, {name}", float(mismatched.sum()), f"of {owners.size}"),
    ]


def _embree_scene(open3d: Any, triangles: Triangles) -> Any:
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        open3d.core.Tensor(triangles.vertices.astype(np.float32)),
        open3d.core.Tensor(triangles.corners.astype(np.uint32)),
    )
    return scene


def ray_table(columns: Columns, slopes: np.ndarray) -> np.ndarray:
    """Return (C, B, 6) float32 origins and unit directions."""
    directions = columns.ahead[:, None] + slopes[:, None] * columns.up[:, None]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    origins = np.broadcast_to(columns.origins[:, None], directions.shape)
    return np.concatenate([origins, directions], axis=-1).astype(np.float32)


def triangulate(scene: Scene, ground_m: float) -> Triangles:
    """Return a scene at its first knot as triangles.

    The ground, owner -1, is a square that reaches `ground_m` to each side.
    """
    square = ground_m * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = [np.column_stack([square, np.zeros(4)])]
    triangles, owners = [np.array([[0, 1, 2], [0, 2, 3]])], [np.full(2, -1)]
    start = 4
    prisms = Prisms.join([scene.static, scene.moving])
    for m, owner in enumerate(prisms.owners):
        corners = prisms.footprints[m, : prisms.corners[m]]
        if owner >= 0:
            if not scene.present[owner]:
                continue
            x, y, yaw = scene.poses[0, owner]
            corners = Pose.planar(x, y, yaw).apply(np.pad(corners, ((0, 0), (0, 1))))[:, :2]
        heights = np.repeat([prisms.bottoms[m], prisms.tops[m]], len(corners))
        vertices.append(np.column_stack([np.tile(corners, (2, 1)), heights]))
        faces = start + _prism_faces(len(corners))
        triangles.append(faces)
        owners.append(np.full(len(faces), owner))
        start += 2 * len(corners)
    return Triangles(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(owners))


def _prism_faces(corners: int) -> np.ndarray:
    """Return the triangles of a prism whose vertices are the bottom ring, then the top ring."""
    near = np.arange(corners)
    far = (near + 1) % corners
    lid = np.column_stack([np.zeros(corners - 2, np.int64), near[1:-1], near[2:]])
    return np.concatenate(
        [
            np.column_stack([near, far, near + corners]),
            np.column_stack([far, far + corners, near + corners]),
            lid,
            lid + corners,
        ]
    )
