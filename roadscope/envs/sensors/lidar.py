"""One sweep of a scanning LiDAR through a moving scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose, RecordError
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.envs.raycast.cast import Columns, Hits, cast
from roadscope.envs.raycast.depth import Surfaces
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.backscatter import LEAST_POWER, echoes
from roadscope.envs.sensors.backscatter_kernels import cloud_over
from roadscope.envs.sensors.lidar_kernels import Firings, Way, collect, interpolate_columns
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.sensors.weather import CLEAR, Weather

Path = Sequence[Pose] | Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""`world_from_lidar` at the scene's knots, or a function from (T,) stamps to (T, 3, 3) rotations
and (T, 3) positions."""


@dataclass(frozen=True, slots=True, eq=False)
class SweepTruth(Record):
    """Where the returns of a scan came from.

    owners: (N,) int32, per return the actor's row, `GROUND`, `WEATHER`, or otherwise -2 and
        below for scenery.
    returns: (A,) int64, returns per actor.
    occluded_fraction: (A,) float64, share of the rays that would meet the actor alone which meet
        something else first; 1 when there are none.
    """

    owners: np.ndarray
    returns: np.ndarray
    occluded_fraction: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            owners=(np.int32, ("N",)),
            returns=(np.int64, ("A",)),
            occluded_fraction=(np.float64, ("A",)),
        )


def sweep(
    scene: Scene,
    spec: LidarSpec,
    world_from_lidar: Path,
    stamp_s: float,
    *,
    sensor: str = "lidar",
    rng: np.random.Generator,
    weather: Weather = CLEAR,
    weather_seed: int = 0,
) -> tuple[LidarScan, SweepTruth]:
    """Measure one sweep whose middle is at the stamp; sensor and bodies move meanwhile.

    All beams of a column are cast at the column's start and azimuth: within a column of tens of
    microseconds nothing on a road moves by more than 2 mm. A real Velodyne also turns by about
    0.13 deg while the beams of a column fire one after the other, 0.1 m across at 50 m; here the
    points are where the column looks, so scans agree with the geometry that they are given in.
    Noise depends on `rng` alone, and each ray's noise does not depend on the scene; what rain
    and fog add to a ray depends on weather, its seed and the stamp.
    """
    columns = lidar_columns(scene, spec, world_from_lidar, stamp_s)
    hits = cast(
        scene, columns, np.tan(spec.elevations), max_range_m=spec.range_max_m, outlines=True
    )
    if weather.kind != "clear":
        nanoseconds = int(np.rint(stamp_s * 1e9)) % 2**64
        key = np.random.SeedSequence([weather_seed, nanoseconds]).generate_state(1, np.uint64)[0]
        _cloud_over(spec, hits, weather, key)
    return _measure(spec, hits, stamp_s, sensor, rng)


def lidar_columns(scene: Scene, spec: LidarSpec, world_from_lidar: Path, stamp_s: float) -> Columns:
    """Return the columns of a sweep, in firing order, world frame.

    Between the scene's knots the sensor moves and turns at constant rates.
    """
    stamps_s = stamp_s + spec.column_offsets_s()
    azimuths = _directions(spec.azimuths())
    if callable(world_from_lidar):
        rotations, positions = world_from_lidar(stamps_s)
        ahead = np.einsum("cij,cj->ci", rotations[:, :, :2], azimuths)
        return Columns(positions, ahead, rotations[:, :, 2], stamps_s)
    if len(world_from_lidar) != len(scene.knots_s):
        raise RecordError(
            f"one pose a knot: {len(scene.knots_s)} knots, {len(world_from_lidar)} poses"
        )
    matrices = np.stack([pose.matrix for pose in world_from_lidar])
    starts = matrices[:, :3, :3]
    turns, angles = _turns(np.swapaxes(starts, 1, 2) @ np.concatenate([starts[1:], starts[-1:]]))
    columns = np.empty((3, len(stamps_s), 3))
    knots, fractions = scene.segments(stamps_s)
    interpolate_columns(Way(matrices, turns, angles), knots, fractions, azimuths, columns)
    return Columns(columns[0], columns[1], columns[2], stamps_s)


def _turns(rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cross-product matrices of the unit axes, and angles in radians below half a turn."""
    skew = 0.5 * (rotations - np.swapaxes(rotations, 1, 2))
    sines = np.sqrt(0.5 * (skew**2).sum(axis=(1, 2)))
    cosines = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1)
    return skew / np.where(sines > 0, sines, 1)[:, None, None], np.arctan2(sines, cosines)


def _cloud_over(spec: LidarSpec, hits: Hits, weather: Weather, key: np.uint64) -> None:
    """Let the weather take what it takes of the hits, in place, and put its echoes there."""
    least = max(spec.detection_limit / spec.range_max_m**2, LEAST_POWER)
    cloud_over(
        _surfaces(hits), echoes(weather, spec.range_min_m, spec.range_max_m, least),
        (weather.extinction_per_m, least), key,
    )  # fmt: skip


def _surfaces(hits: Hits) -> Surfaces:
    """Turn the hits beam by beam, as they are stored; what is written there is theirs."""
    return Surfaces(hits.ranges.T, hits.owners.T, hits.cosines.T, hits.reflectivity.T)


def _measure(
    spec: LidarSpec, hits: Hits, stamp_s: float, sensor: str, rng: np.random.Generator
) -> tuple[LidarScan, SweepTruth]:
    shape = hits.ranges.T.shape
    noise = rng.standard_normal(shape, np.float32)
    chances = rng.random(shape, np.float32)
    order = np.argsort(spec.firing_offsets_s, kind="stable")
    limits = np.array(
        [
            spec.range_min_m, spec.range_max_m, spec.range_noise_m, spec.range_resolution_m,
            spec.dropout, spec.detection_limit,
        ]
    )  # fmt: skip
    firings = Firings(_directions(spec.azimuths()), _directions(spec.elevations), order)
    points, intensity, ring, column, owners = collect(
        _surfaces(hits), noise, chances, firings, limits
    )
    times = spec.column_offsets_s()[column] + spec.firing_offsets_s[ring]
    scan = LidarScan(
        points, intensity, ring, column, times.astype(np.float32), stamp_s, sensor
    )  # fmt: skip
    assert hits.outline_rays is not None
    assert hits.outline_hits is not None
    actors = len(hits.outline_rays)
    hidden = 1 - hits.outline_hits / np.maximum(hits.outline_rays, 1)
    return scan, SweepTruth(owners, np.bincount(owners[owners >= 0], minlength=actors), hidden)


def _directions(angles: np.ndarray) -> np.ndarray:
    """Cosines and sines, (N, 2)."""
    return np.column_stack([np.cos(angles), np.sin(angles)])
