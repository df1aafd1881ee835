"""How fast rays are cast: bare casts by number of bodies, and whole sweeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep, interleaved
from roadscope.core import Category, Pose
from roadscope.envs.raycast.casting import Hits, cast
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar import lidar_columns, sweep
from roadscope.envs.sensors.lidar_spec import SPECS
from roadscope.envs.world.bodies import body_prisms
from roadscope.envs.world.prisms import Prisms

LIDAR = "hdl32e"
COUNTS = (10, 100, 250, 1000, 5000)
"""Bodies in the scenes of bare casts."""
SWEPT = 250
"""Bodies in the scene of whole sweeps."""


class Tilt(NamedTuple):
    """Pitch and roll of the sensor, radians."""

    pitch: float
    roll: float


TILTS: Mapping[str, Tilt] = {
    "level": Tilt(0.0, 0.0),
    "tilted": Tilt(float(np.radians(2.0)), float(np.radians(1.0))),
}
"""A car tilts this much when it brakes and corners."""
SENSOR_HEIGHT_M = 1.9
CLEARANCE_M = 9.0
"""No body is nearer to the sensor."""
RADIUS_M = 95.0
SPEED_M_S = 20.0
KNOTS_S = np.linspace(-0.05, 0.05, 6)
_SIZES = {
    Category.CAR: (4.5, 1.8, 1.5),
    Category.VAN: (5.5, 2.0, 2.4),
    Category.TRUCK: (12.0, 2.5, 3.6),
}
_MIX = (Category.CAR, Category.CAR, Category.CAR, Category.VAN, Category.TRUCK)


def casting_steps(
    repeats: int, counts: Sequence[int] = COUNTS, swept: int = SWEPT
) -> list[SpeedStep]:
    """Return the steps: bare casts for each number of bodies, then whole sweeps."""
    steps = [SpeedStep(f"{count} bodies", partial(_bare, count, repeats)) for count in counts]
    return [*steps, SpeedStep("whole sweeps", partial(_sweeps, swept, repeats))]


def _bare(count: int, repeats: int) -> list[SpeedRow]:
    spec, scene = SPECS[LIDAR], parked_scene(count)
    calls = {name: bare_cast(scene, tilt) for name, tilt in TILTS.items()}
    rays = spec.columns * spec.beams
    return [
        SpeedRow(f"cast, {name}, {count} bodies", rays / seconds / 1e6, "Mray/s")
        for name, seconds in interleaved(calls, repeats).items()
    ]


def bare_cast(scene: Scene, tilt: Tilt) -> Callable[[], Hits]:
    """Return a call that casts all rays of a standing LiDAR."""
    spec = SPECS[LIDAR]
    columns = lidar_columns(scene, spec, sensor_poses(tilt.pitch, tilt.roll, moving=False), 0.0)
    slopes = np.tan(spec.elevations)
    return partial(cast, scene, columns, slopes, max_range_m=spec.range_max_m)


def _sweeps(count: int, repeats: int) -> list[SpeedRow]:
    """Measure rolling shutter, noise, intensity, dropout, points and truth together."""
    scene = driving_scene(count)
    calls = {name: whole_sweep(scene, tilt) for name, tilt in TILTS.items()}
    return [
        SpeedRow(f"whole sweep, {name}, {count} bodies", seconds * 1e3, "ms")
        for name, seconds in interleaved(calls, repeats).items()
    ]


def whole_sweep(scene: Scene, tilt: Tilt) -> Callable[[], Any]:
    """Return a call that senses one sweep of a moving LiDAR."""
    poses = sensor_poses(tilt.pitch, tilt.roll, moving=True)
    return partial(sweep, scene, SPECS[LIDAR], poses, 0.0, rng=np.random.default_rng(0))


def parked_scene(bodies: int, seed: int = 0) -> Scene:
    """Return bodies scattered evenly over a disc around the sensor; nothing moves."""
    rng = np.random.default_rng([seed, bodies])
    parts, poses = [], np.empty((bodies, 3))
    for row in range(bodies):
        category = _MIX[rng.integers(len(_MIX))]
        body = body_prisms(category, np.array(_SIZES[category]), rng)
        parts.append(replace(body, owners=np.full(len(body), row, np.int32)))
        distance = np.sqrt(rng.uniform(CLEARANCE_M**2, RADIUS_M**2))
        bearing, yaw = rng.uniform(-np.pi, np.pi, 2)
        poses[row] = distance * np.cos(bearing), distance * np.sin(bearing), yaw
    return Scene.still(Prisms.empty(), Prisms.join(parts), poses)


def driving_scene(bodies: int) -> Scene:
    """Return the parked scene with every body driving at up to 20 m/s and turning."""
    scene = parked_scene(bodies)
    rng = np.random.default_rng([0, bodies, 1])
    yaws = scene.poses[0, :, 2]
    speeds, turns = rng.uniform(-SPEED_M_S, SPEED_M_S, bodies), rng.uniform(-0.3, 0.3, bodies)
    rates = np.column_stack([speeds * np.cos(yaws), speeds * np.sin(yaws), turns])
    return replace(scene, knots_s=KNOTS_S, poses=scene.poses + KNOTS_S[:, None, None] * rates)


def sensor_poses(pitch: float, roll: float, *, moving: bool) -> list[Pose]:
    """Return the sensor's poses: at the origin, or driving through it at 20 m/s.

    pitch, roll: radians.
    """
    places = SPEED_M_S * KNOTS_S if moving else np.zeros(1)
    return [Pose.from_euler(x, 0.0, SENSOR_HEIGHT_M, pitch=pitch, roll=roll) for x in places]
