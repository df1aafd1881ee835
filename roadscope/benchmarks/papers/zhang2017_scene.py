"""Zhang 2017's drives as scans: a Ford Fusion before an HDL-32E, with the truth beside it.

The world frame is fixed; its origin is where the sensor stands, or starts. Stamps are in seconds.
Planar poses are x, y (metres) and yaw (radians) of the centre of the car's box, or of the sensor.

Seeds vary noise, lost returns and where in its azimuth steps each sweep begins; for `following`
also the road and the distances. They never vary the simulated drives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.lidar_spec import SPECS, LidarSpec
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.saloon_body import ford_saloon

# --------------------------------------------------------------------------------------------------
# Drives of the car and of the sensor, in closed form.

FRAME_S = 0.1
"""From frame to frame: the sensor's 10 Hz."""
STEP_M = 2.0
TURN = -np.pi / 36
"""Distance and turn (radians) of the car from frame to frame in the simulated drives."""
ROBOT_M_S = 3.0
"""Speed of the robot that follows a car."""
DEVIATION_M = 3.0
"""Most by which the car's distance from the robot differs from the nominal one."""
FOLLOWED_M = (10, 20, 30, 40, 50)
"""Nominal distances."""
FOLLOWING_FRAMES = 500

Path = Callable[[np.ndarray], np.ndarray]
"""Returns (T, 3) planar poses at (T,) stamps."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Where car and sensor are at any time, and how many frames are taken.

    rolling: whether both move while a sweep goes round; otherwise each sweep is a snapshot.
    """

    name: str
    car: Path
    sensor: Path
    frames: int
    rolling: bool = False


def drive_of(name: str, seed: int) -> Drive:
    """Return a drive of `DRIVES`; only `following` depends on the seed."""
    if name not in DRIVES:
        raise ValueError(f"no drive '{name}'; known: {', '.join(DRIVES)}")
    return DRIVES[name](name, seed)


class PlanarPose(NamedTuple):
    """A pose on the ground."""

    x_m: float
    y_m: float
    yaw_rad: float


def _straight(name: str, _: int) -> Drive:
    """Straight away from the sensor: 40 to 112 m.

    The paper starts at (40, 3.75, -pi) and speaks of a far vehicle; going ahead, a car with that
    heading would meet the sensor. Here it is read as a heading known up to half a turn, with the
    tail in view; the other reading is `straight-past`.
    """
    return Drive(name, partial(_arc, PlanarPose(40.0, 3.75, 0.0), 0.0), _standing, 37)


def _straight_past(name: str, _: int) -> Drive:
    """Towards the sensor and past it: 40 to -32 m, the paper's (40, 3.75, -pi) as it stands."""
    return Drive(name, partial(_arc, PlanarPose(40.0, 3.75, -np.pi), 0.0), _standing, 37)


def _curve(name: str, _: int) -> Drive:
    """Along a circle of 23 m radius to the right, 34 to 74 m; 2 m a frame are its arc."""
    return Drive(name, partial(_arc, PlanarPose(34.0, 0.0, np.pi / 2), TURN), _standing, 27)


def _following(distance_m: int, name: str, seed: int) -> Drive:
    """Robot and car on the same winding road, the distance held within 3 m.

    The paper gives neither road nor deviations. Here the road is a sine of 60 to 120 m with
    slopes up to 0.1, and the deviation is two slow sines of 15 to 50 s, all drawn by the seed.
    """
    rng = np.random.default_rng([seed, distance_m])
    wave, phase = 2 * np.pi / rng.uniform(60.0, 120.0), rng.uniform(0.0, 2 * np.pi)
    road = _Road(rng.uniform(0.02, 0.1) / wave, wave, phase)
    share = rng.uniform(0.3, 0.7)
    deviation = _Deviation(
        DEVIATION_M * np.array([share, 1.0 - share]),
        2 * np.pi / rng.uniform(15.0, 50.0, 2),
        rng.uniform(0.0, 2 * np.pi, 2),
    )
    car = partial(_car_ahead, road, float(distance_m), deviation)
    return Drive(name, car, partial(_robot_on, road), FOLLOWING_FRAMES, rolling=True)


@dataclass(frozen=True, slots=True)
class _Road:
    """A road y = height * (sin(wave x + phase) - sin(phase)), metres."""

    height: float
    wave: float
    phase: float

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return (T, 3) planar poses along the road."""
        y = self.height * (np.sin(self.wave * x + self.phase) - np.sin(self.phase))
        slope = self.height * self.wave * np.cos(self.wave * x + self.phase)
        return np.column_stack([x, y, np.arctan(slope)])


@dataclass(frozen=True, slots=True)
class _Deviation:
    """Sines whose sum is the deviation, metres; (2,) amplitudes, rad/s and phases."""

    amplitudes: np.ndarray
    rates: np.ndarray
    phases: np.ndarray

    def at(self, stamps_s: np.ndarray) -> np.ndarray:
        """Return (T,) deviations."""
        sines = np.sin(np.multiply.outer(stamps_s, self.rates) + self.phases)
        deviations: np.ndarray = sines @ self.amplitudes
        return deviations


def _robot_on(road: _Road, stamps_s: np.ndarray) -> np.ndarray:
    return road.at(ROBOT_M_S * stamps_s)


def _car_ahead(
    road: _Road, distance_m: float, deviation: _Deviation, stamps_s: np.ndarray
) -> np.ndarray:
    return road.at(ROBOT_M_S * stamps_s + distance_m + deviation.at(stamps_s))


def _standing(stamps_s: np.ndarray) -> np.ndarray:
    return np.zeros((len(stamps_s), 3))


def _arc(start: PlanarPose, turn: float, stamps_s: np.ndarray) -> np.ndarray:
    """Return planar poses at constant speed along the heading and at constant turn rate."""
    k = stamps_s / FRAME_S
    yaw = start.yaw_rad + turn * k
    # sin(u) / u at half the turn: the chord of an arc.
    chord = STEP_M * k * np.sinc(turn * k / 2 / np.pi)
    middle = start.yaw_rad + turn * k / 2
    x, y = start.x_m + chord * np.cos(middle), start.y_m + chord * np.sin(middle)
    return np.column_stack([x, y, yaw])


DRIVES: Mapping[str, Callable[[str, int], Drive]] = MappingProxyType(
    {
        "straight": _straight,
        "straight-past": _straight_past,
        "curve": _curve,
        **{f"following-{metres}": partial(_following, metres) for metres in FOLLOWED_M},
    }
)

# --------------------------------------------------------------------------------------------------
# Sensing.

SENSOR_HEIGHT_M = 0.8
"""On the roof of the small robot that carries it. The paper does not give the height; at 1.9 m,
on a car, no beam meets the target in half of the frames beyond 40 m."""
KNOT_S = 0.001
"""Between knots the car goes straight: at 40 m/s and 2 rad/s, 10 ms would cut a millimetre off."""


@dataclass(frozen=True, slots=True)
class DriveSweep:
    """One sweep.

    scan: all returns, the ground's too, lidar frame.
    target: (N,) bool, which returns are the car's.
    truth: (3,) float64, planar pose of the car's box centre at the scan's stamp.
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
        """(2,) position of the sensor, world frame, metres."""
        return self.world_from_lidar.translation[:2]


@dataclass(frozen=True, slots=True)
class SensedDrive:
    """One drive with one seed, sweep by sweep."""

    drive: Drive
    seed: int
    body: str
    spec: LidarSpec
    sensor_height_m: float
    sweeps: tuple[DriveSweep, ...]

    @property
    def truth(self) -> np.ndarray:
        """(K, 3) planar poses of the car, world frame."""
        return np.array([each.truth for each in self.sweeps])


class RobotLidar(NamedTuple):
    """The LiDAR and its height above the ground, metres."""

    spec: LidarSpec
    height_m: float = SENSOR_HEIGHT_M


def sense_drive(
    name: str,
    seed: int,
    *,
    body: str = "sharp",
    noise: float = 1.0,
    sensor_height_m: float = SENSOR_HEIGHT_M,
    rolling: bool | None = None,
    frames: int | None = None,
) -> SensedDrive:
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
    count = drive.frames if frames is None else min(frames, drive.frames)
    phase_rng, rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    phases = phase_rng.uniform(0.0, abs(spec.azimuth_span) / spec.columns, count)
    lidar = RobotLidar(spec, sensor_height_m)
    sweeps = sense_sweeps(drive, lidar, target_body(body), phases, rng)
    return SensedDrive(drive, seed, body, spec, sensor_height_m, sweeps)


def sense_sweeps(
    drive: Drive, lidar: RobotLidar, car: Prisms, phases: np.ndarray, rng: np.random.Generator
) -> tuple[DriveSweep, ...]:
    """Sense a drive, a sweep for each of the (K,) phases.

    phases: radians by which each sweep's azimuths are turned.
    """
    return tuple(
        _sense_sweep(drive, lidar, car, FRAME_S * k, phase=float(phase), rng=rng)
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
        rotations = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1.0], axis=-1)
        return rotations.reshape(-1, 3, 3), np.column_stack([x, y, zero + height_m])

    return path


def _sense_sweep(
    drive: Drive,
    lidar: RobotLidar,
    car: Prisms,
    stamp_s: float,
    *,
    phase: float,
    rng: np.random.Generator,
) -> DriveSweep:
    moving = sensor_path(drive, lidar.height_m, phase)
    rotations, positions = moving(np.array([stamp_s]))
    half_s = lidar.spec.sweep_s / 2
    if drive.rolling:
        knots = int(np.ceil(2 * half_s / KNOT_S)) + 1
        knots_s = np.linspace(stamp_s - half_s, stamp_s + half_s, knots)
        path = moving
    else:
        knots_s = np.array([stamp_s])
        path = _at_rest(rotations[0], positions[0])
    poses = drive.car(knots_s)[:, None, :]
    scene = Scene(Prisms.empty(), car, knots_s, poses, np.ones(1, bool))
    scan, returns = sweep(scene, lidar.spec, path, stamp_s, rng=rng)
    truth = drive.car(np.array([stamp_s]))[0]
    world_from_lidar = Pose.from_parts(rotations[0], positions[0])
    return DriveSweep(scan, returns.owners == 0, truth, world_from_lidar, phase)


def _at_rest(
    rotation: np.ndarray, position: np.ndarray
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    def path(stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = len(stamps_s)
        return np.broadcast_to(rotation, (n, 3, 3)), np.broadcast_to(position, (n, 3))

    return path
