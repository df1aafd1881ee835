"""How fast rays are cast, beside Open3D where it is installed."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from roadscope.benchmarks.speed.rows import SpeedRow, Step, interleaved
from roadscope.benchmarks.speed.scene import (
    driving_scene,
    parked_scene,
    ray_table,
    sensor_poses,
    triangulate,
)
from roadscope.envs.raycast.cast import NOTHING, Columns, Hits, cast
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.raycast.shapes import clear_shapes
from roadscope.envs.sensors.lidar import lidar_columns, sweep
from roadscope.envs.sensors.lidar_spec import SPECS

COUNTS = (10, 100, 250, 1000, 5000)
COMPARED = 250
TILTS = {"level": (0.0, 0.0), "tilted": (np.radians(2.0), np.radians(1.0))}
"""Pitch and roll: what a braking, cornering car does."""

GROUND_M = 400.0
MISMATCH_M = 0.01


def casting_steps(open3d: Any, counts: Sequence[int], compared: int, repeats: int) -> list[Step]:
    """Return what measures bare casts by number of bodies, whole sweeps and Open3D.

    open3d: the module, or None where it is not installed.
    """
    steps: list[Step] = [(f"{count} bodies", partial(_bare, count, repeats)) for count in counts]
    steps.append(("whole sweeps", partial(_sweeps, compared, repeats)))
    if open3d is not None:
        steps.extend(
            (f"Open3D, {tilt}", partial(_beside, open3d, tilt, compared, repeats)) for tilt in TILTS
        )
    return steps


def import_open3d() -> Any:
    """Return the module, or None where it cannot be imported."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import open3d
    except (ImportError, OSError):
        return None
    return open3d


def _bare(count: int, repeats: int) -> list[SpeedRow]:
    spec = SPECS["hdl32e"]
    slopes = np.tan(spec.elevations)
    scene = parked_scene(count)
    calls: dict[str, Callable[[], Any]] = {}
    for tilt, (pitch, roll) in TILTS.items():
        columns = lidar_columns(scene, spec, sensor_poses(pitch, roll, moving=False), 0.0)
        calls[tilt] = _caster(scene, columns, slopes, spec.range_max_m)
    times = interleaved(calls, repeats)
    rays = spec.columns * spec.beams
    return [
        SpeedRow(f"cast, {tilt}, {count} bodies", rays / seconds / 1e6, "Mray/s")
        for tilt, seconds in times.items()
    ]


def _sweeps(count: int, repeats: int) -> list[SpeedRow]:
    """Measure rolling shutter, noise, intensity, dropout, points and truth together."""
    spec, rng = SPECS["hdl32e"], np.random.default_rng(0)
    scene = driving_scene(count)
    calls: dict[str, Callable[[], Any]] = {}
    for tilt, (pitch, roll) in TILTS.items():
        poses = sensor_poses(pitch, roll, moving=True)
        calls[tilt] = partial(sweep, scene, spec, poses, 0.0, rng=rng)
    return [
        SpeedRow(f"whole sweep, {tilt}, {count} bodies", seconds * 1e3, "ms")
        for tilt, seconds in interleaved(calls, repeats).items()
    ]


def _beside(open3d: Any, tilt: str, count: int, repeats: int) -> list[SpeedRow]:
    """Run our cast, our sweep and Open3D's cast in turns on the same rays and bodies."""
    spec, rng = SPECS["hdl32e"], np.random.default_rng(0)
    slopes, scene, driving = np.tan(spec.elevations), parked_scene(count), driving_scene(count)
    columns = lidar_columns(scene, spec, sensor_poses(*TILTS[tilt], moving=False), 0.0)
    poses = sensor_poses(*TILTS[tilt], moving=True)
    vertices, triangles, owners = triangulate(scene, GROUND_M)
    rays = open3d.core.Tensor(ray_table(columns, slopes))
    embree = _embree(open3d, vertices, triangles)
    calls: dict[str, Callable[[], Any]] = {
        "ours": _caster(scene, columns, slopes, spec.range_max_m),
        "anew": _caster(scene, columns, slopes, spec.range_max_m, anew=True),
        "sweep": lambda: sweep(driving, spec, poses, 0.0, rng=rng),
        "embree": lambda: embree.cast_rays(rays, nthreads=1),
        "rebuilt": lambda: _embree(open3d, vertices, triangles).cast_rays(rays, nthreads=1),
    }
    times = interleaved(calls, repeats)
    found = calls["embree"]()
    ranges = found["t_hit"].numpy()
    source = np.append(owners, NOTHING)[np.minimum(found["primitive_ids"].numpy(), len(owners))]
    source[~(ranges <= spec.range_max_m)] = NOTHING
    name = f"{tilt}, {count} bodies"
    return [
        *_comparison(name, times, columns, slopes),
        *agreement(name, calls["ours"](), ranges, source.astype(np.int32)),
    ]


def _comparison(
    name: str, times: dict[str, float], columns: Columns, slopes: np.ndarray
) -> list[SpeedRow]:
    million = len(columns) * len(slopes) / 1e6
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
    apart = np.abs(ours.ranges[both] - ranges[both])
    mismatched = ours.owners != owners
    mismatched[both] |= apart > MISMATCH_M
    return [
        SpeedRow(f"median range difference, {name}", float(np.median(apart)), "m"),
        SpeedRow(f"largest range difference, {name}", float(apart.max()), "m"),
        SpeedRow(f"mismatched rays, {name}", float(mismatched.sum()), f"of {owners.size}"),
    ]


def _caster(
    scene: Scene, columns: Columns, slopes: np.ndarray, max_range_m: float, anew: bool = False
) -> Callable[[], Hits]:
    def run() -> Hits:
        if anew:
            clear_shapes()
        return cast(scene, columns, slopes, max_range_m=max_range_m)

    return run


def _embree(open3d: Any, vertices: np.ndarray, triangles: np.ndarray) -> Any:
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        open3d.core.Tensor(vertices.astype(np.float32)),
        open3d.core.Tensor(triangles.astype(np.uint32)),
    )
    return scene
