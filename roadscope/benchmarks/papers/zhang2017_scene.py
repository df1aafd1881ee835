"""Zhang 2017's experiments as scans: a Ford Fusion before an HDL-32E, with the truth beside it.

Seeds vary noise, lost returns and where in its azimuth steps each sweep begins, and for
`following` the road and the distances; never the simulated drives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from roadscope.benchmarks.papers.zhang2017_drives import DRIVES, FRAME_S, Drive, drive_of
from roadscope.core import LidarScan, Pose
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.lidar_spec import SPECS, LidarSpec
from roadscope.envs.world.ford_saloon import ford_saloon
from roadscope.envs.world.prisms import Prisms

__all__ = [
    "DRIVES",
    "SENSOR_HEIGHT_M",
    "Run",
    "Shot",
    "film",
    "hdl32e",
    "shots_of",
    "target_body",
]

SENSOR_HEIGHT_M = 0.8
"""On the roof of the small robot that carries it. The paper does not give the height; at 1.9 m,
on a car, no beam meets the target in half of the frames beyond 40 m."""
KNOT_S = 0.001
"""Between knots the car goes straight: at 40 m/s and 2 rad/s, 10 ms would cut a millimetre off."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One sweep.

    scan: all returns, the ground's too, lidar frame.
    target: (N,) bool, which returns are the car's.
    truth: (3,) float64, x, y (metres) and yaw (radians) of the car's box centre at the scan's
        stamp, world frame.
    world_from_lidar: at the stamp.
    phase: radians by which the sweep's azimuths are turned against those of the spec; already
        part of world_from_lidar.
    """

    scan: LidarScan
    target: np.ndarray
    truth: np.ndarray
    world_from_lidar: Pose
    phase: float

    @property
    def points_xy(self) -> np.ndarray:
        """(P, 2) float64 returns of the car, world frame, metres."""
        return self.world_from_lidar.apply(self.scan.points[self.target])[:, :2]

    @property
    def origin_xy(self) -> np.ndarray:
        """(2,) place of the sensor, world frame, metres."""
        return self.world_from_lidar.translation[:2]


@dataclass(frozen=True, slots=True)
class Run:
    """One drive with one seed, frame by frame."""

    drive: Drive
    seed: int
    body: str
    spec: LidarSpec
    sensor_height_m: float
    shots: tuple[Shot, ...]

    @property
    def truth(self) -> np.ndarray:
        """(K, 3) x, y, yaw of the car, world frame."""
        return np.array([shot.truth for shot in self.shots])


def film(
    name: str,
    seed: int,
    *,
    body: str = "sharp",
    noise: float = 1.0,
    sensor_height_m: float = SENSOR_HEIGHT_M,
    rolling: bool | None = None,
    frames: int | None = None,
) -> Run:
    """Sense a drive of `DRIVES`, one sweep every 0.1 s.

    body: `sharp` or `rounded`.
    noise: factor on the range noise of the data sheet, 2 cm.
    rolling: whether car and sensor move while a sweep goes round, the truth being that of its
        middle; otherwise, as in the paper's simulation, each sweep is a snapshot. By default
        simulated drives are snapshots and `following` is not.
    frames: how many are taken from the beginning, all if left out.
    """
    drive = drive_of(name, seed)
    if rolling is not None:
        drive = replace(drive, rolling=rolling)
    spec = hdl32e(noise)
    taken = drive.frames if frames is None else min(frames, drive.frames)
    phases, noises = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    turned = phases.uniform(0.0, abs(spec.azimuth_span) / spec.columns, taken)
    shots = shots_of(drive, spec, target_body(body), (sensor_height_m, turned), noises)
    return Run(drive, seed, body, spec, sensor_height_m, shots)


def shots_of(
    drive: Drive,
    spec: LidarSpec,
    car: Prisms,
    sensor: tuple[float, np.ndarray],
    rng: np.random.Generator,
) -> tuple[Shot, ...]:
    """Sense a drive, a shot for each of the sensor's phases.

    sensor: its height, metres, and (K,) radians by which each sweep's azimuths are turned.
    """
    height_m, phases = sensor
    return tuple(
        _shot(drive, spec, car, (FRAME_S * k, height_m, float(phase)), rng)
        for k, phase in enumerate(phases)
    )


@cache
def hdl32e(noise: float = 1.0) -> LidarSpec:
    """Return the paper's LiDAR with its range noise multiplied."""
    spec = SPECS["hdl32e"]
    return replace(spec, range_noise_m=noise * spec.range_noise_m)


@cache
def target_body(body: str) -> Prisms:
    """Return the car, made once: the ray caster keeps what it prepared for it."""
    return ford_saloon(body)


def sensor_path(
    drive: Drive, height_m: float, phase: float
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return rotations (T, 3, 3) and positions (T, 3) of the sensor as a function of stamps."""

    def path(stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y, yaw = drive.sensor(stamps_s).T
        c, s, zero = np.cos(yaw + phase), np.sin(yaw + phase), np.zeros(len(yaw))
        turns = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1.0], axis=-1)
        return turns.reshape(-1, 3, 3), np.column_stack([x, y, zero + height_m])

    return path


def _shot(
    drive: Drive,
    spec: LidarSpec,
    car: Prisms,
    taken: tuple[float, float, float],
    rng: np.random.Generator,
) -> Shot:
    """Take one sweep at (stamp, sensor height, azimuth phase)."""
    stamp_s, height_m, phase = taken
    moving = sensor_path(drive, height_m, phase)
    rotations, positions = moving(np.array([stamp_s]))
    half = spec.sweep_s / 2
    if drive.rolling:
        knots = np.linspace(stamp_s - half, stamp_s + half, int(np.ceil(2 * half / KNOT_S)) + 1)
        path = moving
    else:
        knots = np.array([stamp_s])
        path = _frozen(rotations[0], positions[0])
    poses = drive.car(knots)[:, None, :]
    scene = Scene(Prisms.empty(), car, knots, poses, np.ones(1, bool))
    scan, seen = sweep(scene, spec, path, stamp_s, rng=rng)
    truth = drive.car(np.array([stamp_s]))[0]
    return Shot(scan, seen.owners == 0, truth, Pose.from_parts(rotations[0], positions[0]), phase)


def _frozen(
    rotation: np.ndarray, position: np.ndarray
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    def path(stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = len(stamps_s)
        return np.broadcast_to(rotation, (n, 3, 3)), np.broadcast_to(position, (n, 3))

    return path
