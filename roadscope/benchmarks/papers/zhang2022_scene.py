"""Zhang 2022's corridor with its robot and people as sensor data, with the truth beside it.

The paper gives no sizes of its corridor, no speeds and no numbers of people. Those here are of an
ordinary office building and were fixed before anything was measured.

World frame: x and y along the sides of the building. The middle line of the corridor runs
counter-clockwise around a rectangle whose first corner is the origin. The LiDAR stands level on a
robot that does not sway. Seeds vary noise, biases of the IMU, doors, furniture and the people;
they never vary how the robot drives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, ImuSamples, LidarScan, Pose
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.ego_motion import EgoMotion
from roadscope.envs.sensors.imu import ImuNoise, measure, samples_of
from roadscope.envs.sensors.imu_spec import IMUS, ImuSpec
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.lidar_spec import SPECS, LidarSpec
from roadscope.envs.sensors.rig import ImuMount, LidarMount
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.prisms import Prisms, placed, rectangle
from roadscope.envs.world.world import actor_bodies

# --------------------------------------------------------------------------------------------------
# The building. All sizes and reflectivities are chosen by hand.

LENGTH_M, DEPTH_M = 26.0, 14.0
"""Sides of the rectangle that the middle line goes around."""
WIDTH_M, CEILING_M = 3.0, 2.8
"""Of the corridor."""
WALL_M = 0.2
"""Thickness of walls and ceiling."""
TURN_M = 1.0
"""Radius on which the middle line goes around corners."""
WALL_REFLECTIVITY, CEILING_REFLECTIVITY = 0.6, 0.7
FRAME_REFLECTIVITY, FURNITURE_REFLECTIVITY = 0.3, 0.4


class CorridorBox(NamedTuple):
    """A box whose sides are along x and y, metres."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float
    bottom_m: float
    top_m: float
    reflectivity: float


class WallItem(NamedTuple):
    """Size of what stands against a wall, metres, and its reflectivity (0 to 1).

    length_m: along the wall. depth_m: across it.
    """

    length_m: float
    depth_m: float
    height_m: float
    reflectivity: float


DOOR_POST = WallItem(0.12, 0.08, 2.2, FRAME_REFLECTIVITY)


def building(seed: int) -> Prisms:
    """Return walls, ceiling, door frames and furniture; the seed places the last two."""
    rng = np.random.default_rng(seed)
    boxes = [*_walls(), *_ceiling()]
    for side in range(4):
        boxes += _items_along(side, rng)
    return Prisms.join([_prism(box, number) for number, box in enumerate(boxes)])


def _walls() -> list[CorridorBox]:
    boxes = []
    for outward in (1, -1):
        reach = outward * (WIDTH_M + WALL_M) / 2
        length, depth = LENGTH_M + 2 * reach + WALL_M, DEPTH_M + 2 * reach + WALL_M
        wall = (0.0, CEILING_M, WALL_REFLECTIVITY)
        for low in (True, False):
            y = -reach if low else DEPTH_M + reach
            x = -reach if low else LENGTH_M + reach
            boxes.append(CorridorBox(LENGTH_M / 2, y, length, WALL_M, *wall))
            boxes.append(CorridorBox(x, DEPTH_M / 2, WALL_M, depth, *wall))
    return boxes


def _ceiling() -> list[CorridorBox]:
    ceiling = (CEILING_M, CEILING_M + WALL_M, CEILING_REFLECTIVITY)
    along_x = [
        CorridorBox(LENGTH_M / 2, y, LENGTH_M + WIDTH_M, WIDTH_M, *ceiling) for y in (0.0, DEPTH_M)
    ]
    along_y = [
        CorridorBox(x, DEPTH_M / 2, WIDTH_M, DEPTH_M - WIDTH_M, *ceiling) for x in (0.0, LENGTH_M)
    ]
    return [*along_x, *along_y]


def _items_along(side: int, rng: np.random.Generator) -> list[CorridorBox]:
    """Return door frames, and furniture between them, along both walls of a side."""
    boxes: list[CorridorBox] = []
    length = LENGTH_M if side % 2 == 0 else DEPTH_M
    for wall in (-1, 1):
        along_m = rng.uniform(2.0, 4.0)
        while along_m < length - 2.0:
            posts_m = (along_m - 0.5, along_m + 0.5)
            boxes += [_against_wall(DOOR_POST, side, wall, at_m) for at_m in posts_m]
            if rng.random() < 0.4 and along_m + 2.2 < length - 2.0:
                item = WallItem(
                    rng.uniform(0.5, 1.2), 0.25, rng.uniform(0.8, 1.9), FURNITURE_REFLECTIVITY
                )
                boxes.append(_against_wall(item, side, wall, along_m + 1.6))
            along_m += rng.uniform(3.0, 5.0)
    return boxes


def _against_wall(item: WallItem, side: int, wall: int, along_m: float) -> CorridorBox:
    """Return a box against a wall; wall: 1 on the left of who goes around, -1 on the right."""
    (x, y), (ahead_x, ahead_y) = corner(side), direction(side)
    across = wall * (WIDTH_M - item.depth_m) / 2
    sides = (item.length_m, item.depth_m) if side % 2 == 0 else (item.depth_m, item.length_m)
    return CorridorBox(
        x + along_m * ahead_x - across * ahead_y,
        y + along_m * ahead_y + across * ahead_x,
        *sides,
        0.0,
        item.height_m,
        item.reflectivity,
    )


def _prism(box: CorridorBox, number: int) -> Prisms:
    centre = np.array([[box.x_m, box.y_m]])
    outline = placed(rectangle(box.length_m, box.width_m), centre, np.zeros(1))[0]
    # Owners below -1 are scenery.
    return Prisms.of(
        outline, box.bottom_m, box.top_m, owner=-2 - number, reflectivity=box.reflectivity
    )


# --------------------------------------------------------------------------------------------------
# The middle line of the corridor.


def corner(side: int) -> tuple[float, float]:
    """Return x and y of where a side of the middle line begins, metres."""
    return ((0.0, 0.0), (LENGTH_M, 0.0), (LENGTH_M, DEPTH_M), (0.0, DEPTH_M))[side % 4]


def direction(side: int) -> tuple[float, float]:
    """Return the unit vector along a side of the middle line."""
    return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[side % 4]


@dataclass(frozen=True, slots=True)
class MiddleLine:
    """The middle line with round corners, as a function of the distance from its start."""

    turn_m: float = TURN_M

    @property
    def length_m(self) -> float:
        """Once around."""
        return 2 * (LENGTH_M + DEPTH_M) - 8 * self.turn_m + 2 * np.pi * self.turn_m

    def at(self, distances_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (T, 2) positions and (T,) unwrapped yaws at (T,) distances.

        The start is the end of the turn at the first corner.
        """
        rounds, rest = np.divmod(distances_m, self.length_m)
        positions, yaws = np.empty((len(distances_m), 2)), np.empty(len(distances_m))
        bend = np.pi / 2 * self.turn_m
        begin = 0.0
        for side, side_m in enumerate((LENGTH_M, DEPTH_M, LENGTH_M, DEPTH_M)):
            straight = side_m - 2 * self.turn_m
            here = (rest >= begin) & (rest < begin + straight + bend)
            along = np.minimum(rest[here] - begin, straight)
            turned = (rest[here] - begin - along) / self.turn_m
            ahead, left = np.array(direction(side)), np.array(direction(side + 1))
            arc = self.turn_m * (
                np.sin(turned)[:, None] * ahead + (1 - np.cos(turned))[:, None] * left
            )
            start = np.array(corner(side)) + self.turn_m * ahead
            positions[here] = start + along[:, None] * ahead + arc
            yaws[here] = side * np.pi / 2 + turned
            begin += straight + bend
        return positions, yaws + 2 * np.pi * rounds


# --------------------------------------------------------------------------------------------------
# The experiments: how the robot drives, and who walks.

ACCELERATION_M_S2 = 0.5
"""Of the robot when it starts and when it stops; chosen by hand."""
WALKING_M_S = (0.9, 1.5)
"""Least and greatest speed of people; chosen by hand."""
OFF_MIDDLE_M = (0.65, 1.0)
"""Distance of people from the middle line, to either side, so that the robot can pass."""
STRAIGHT_M = 18.035
"""Length of the straight experiment, as in the paper (section 3.2)."""
SCANS_APART = 10
"""Scans between the two of a removal: 1 s, as in the paper (section 3.1)."""


class Stretch(NamedTuple):
    """A part of a side of the corridor, metres from the side's corner."""

    start_m: float
    end_m: float


@dataclass(frozen=True, slots=True)
class CorridorWalker:
    """A person who walks to and fro on a stretch of one side of the corridor.

    left_m: distance to the left of the middle line. phase: share of a whole to and fro that lies
    behind the person at the start.
    """

    side: int
    stretch: Stretch
    left_m: float
    speed_m_s: float
    phase: float

    def at(self, stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (T, 2) positions and (T,) headings at (T,) stamps."""
        low, high = self.stretch
        cycles = self.phase + self.speed_m_s * stamps_s / (2 * (high - low))
        share = 2 * (cycles % 1.0)
        back = share > 1
        along = low + (high - low) * np.where(back, 2 - share, share)
        ahead = np.array(direction(self.side))
        left = np.array([-ahead[1], ahead[0]])
        positions = np.array(corner(self.side)) + along[:, None] * ahead + self.left_m * left
        return positions, np.arctan2(ahead[1], ahead[0]) + np.pi * back


@dataclass(frozen=True, slots=True)
class CorridorExperiment:
    """What happens in one experiment.

    start_m: distance of the robot along the middle line at the start. length_m: how far it drives.
    speed_m_s: its speed after it has accelerated; 0: it stands. scans: how many are taken.
    draw_walkers: draws the people from random numbers.
    """

    start_m: float
    length_m: float
    speed_m_s: float
    scans: int
    draw_walkers: Callable[[np.random.Generator], list[CorridorWalker]]

    def distances_m(self, stamps_s: np.ndarray) -> np.ndarray:
        """Return (T,) distances of the robot along the middle line at (T,) stamps.

        It accelerates evenly, drives at an even speed, and brakes evenly.
        """
        if self.speed_m_s == 0:
            return np.full(len(stamps_s), self.start_m)
        ramp_s = self.speed_m_s / ACCELERATION_M_S2
        end_s = self.length_m / self.speed_m_s + ramp_s
        t = np.clip(stamps_s, 0.0, end_s)
        driven = self.speed_m_s * (t - ramp_s / 2)
        starting, stopping = t < ramp_s, t > end_s - ramp_s
        driven[starting] = ACCELERATION_M_S2 / 2 * t[starting] ** 2
        driven[stopping] = self.length_m - ACCELERATION_M_S2 / 2 * (end_s - t[stopping]) ** 2
        distances: np.ndarray = self.start_m + driven
        return distances


def walkers(
    count: int, sides: Sequence[int], stretch: Stretch
) -> Callable[[np.random.Generator], list[CorridorWalker]]:
    """Return a function that draws people who walk to and fro along sides of the corridor."""

    def draw(rng: np.random.Generator) -> list[CorridorWalker]:
        return [
            CorridorWalker(
                side=int(rng.choice(sides)),
                stretch=stretch,
                left_m=float(rng.choice((-1, 1)) * rng.uniform(*OFF_MIDDLE_M)),
                speed_m_s=float(rng.uniform(*WALKING_M_S)),
                phase=float(rng.uniform()),
            )
            for _ in range(count)
        ]

    return draw


_NEAR = walkers(1, (0,), Stretch(4.0, 14.0))
_SEVERAL_NEAR = walkers(4, (0,), Stretch(4.0, 14.0))
_AT_CORNER = walkers(3, (0, 1), Stretch(2.0, 12.0))
_ON_STRAIGHT = walkers(3, (0,), Stretch(4.0, 20.0))
REMOVAL_CASES: Mapping[str, CorridorExperiment] = MappingProxyType(
    {
        "1, still, one walker": CorridorExperiment(8.0, 0.0, 0.0, SCANS_APART + 2, _NEAR),
        "2, still, several": CorridorExperiment(8.0, 0.0, 0.0, SCANS_APART + 2, _SEVERAL_NEAR),
        "3, moving at a corner": CorridorExperiment(21.0, 6.0, 1.0, 42, _AT_CORNER),
        "4, moving, straight": CorridorExperiment(4.0, 8.0, 1.0, 42, _ON_STRAIGHT),
    }
)
"""The last scan of each is compared with the one 1 s before (section 3.1)."""
STANDING = CorridorExperiment(8.0, 0.0, 0.0, 100, walkers(4, (0,), Stretch(2.0, 20.0)))
STRAIGHT = CorridorExperiment(2.0, STRAIGHT_M, 1.0, 205, walkers(3, (0,), Stretch(2.0, 24.0)))
LOOP = CorridorExperiment(
    2.0, MiddleLine().length_m, 1.5, 530, walkers(6, (0, 1, 2, 3), Stretch(2.0, 12.0))
)
"""Experiments 1 to 3 of section 3.2."""

# --------------------------------------------------------------------------------------------------
# Sensing.

LIDAR = LidarMount("lidar", SPECS["vlp16"], Pose.planar(0.0, 0.0, 0.0, 0.6))
"""The paper's sensor. Its height is not given: on top of a robot as high as a knee."""
IMU = ImuMount("imu", IMUS["zed2"], Pose.planar(0.15, 0.0, 0.0, 0.55))
"""The IMU of the camera in front of the LiDAR, as in the paper."""
LIDAR_FROM_IMU = LIDAR.ego_from_lidar.inverse() @ IMU.ego_from_imu
IMU_ERRORS = (
    "gyro_noise",
    "gyro_walk",
    "gyro_turn_on",
    "accelerometer_noise",
    "accelerometer_walk",
    "accelerometer_turn_on",
)
"""Settings of the IMU that the noise factor multiplies."""
STATE_PERIOD_S, EXTRA_S = 0.05, 0.5
"""Period of recorded states, and how long they go on after the last scan."""
ROBOT_SIZE_M = 0.8, 0.6, 0.5
"""Length, width and height."""


@dataclass(frozen=True, slots=True)
class CorridorSweep:
    """One sweep with what the IMU measured since the one before.

    start_from_lidar: (4, 4) true pose at the stamp, in the LiDAR's frame of the first sweep.
    velocity: (3,) true m/s, lidar frame. moving: (N,) bool, returns of people who walk.
    """

    scan: LidarScan
    imu: ImuSamples
    start_from_lidar: np.ndarray
    velocity: np.ndarray
    moving: np.ndarray


def sense_corridor(
    experiment: CorridorExperiment, seed: int, noise: float = 1.0
) -> Iterator[CorridorSweep]:
    """Yield the sweeps of an experiment, one every 0.1 s.

    noise: factor on the range noise of the LiDAR and on all errors of the IMU.
    """
    layout, people, returns, unit = np.random.SeedSequence(seed).generate_state(4)
    timeline = _timeline(experiment, np.random.default_rng(people))
    scenery, bodies = building(int(layout)), actor_bodies(timeline, int(people))
    lidar_spec, imu_spec = _noisy_specs(noise)
    motion, errors = EgoMotion(timeline), ImuNoise(imu_spec, int(unit))
    imu = replace(IMU, spec=imu_spec)
    path = partial(motion.mounted, LIDAR.ego_from_lidar)
    start_from_world = np.linalg.inv(_pose_matrix(*path(np.array([LIDAR.stamp_s(0)]))))
    half_s = LIDAR.spec.sweep_s / 2
    for k in range(experiment.scans):
        stamp_s = LIDAR.stamp_s(k)
        knots_s = np.linspace(stamp_s - half_s, stamp_s + half_s, 6)
        rng = np.random.default_rng([int(returns), k])
        scene = _scene(scenery, bodies, timeline, knots_s)
        scan, truth = sweep(scene, lidar_spec, path, stamp_s, rng=rng)
        here = motion.at(np.array([stamp_s]), LIDAR.ego_from_lidar.translation)
        yield CorridorSweep(
            scan=scan,
            imu=measure(motion, imu, errors, *samples_of(LIDAR, k, IMU.spec.rate_hz)),
            start_from_lidar=start_from_world @ _pose_matrix(*path(np.array([stamp_s]))),
            velocity=here.rotations[0].T @ here.velocities[0],
            moving=truth.owners >= 0,
        )


def _scene(scenery: Prisms, bodies: Prisms, timeline: Timeline, knots_s: np.ndarray) -> Scene:
    """Return what stands and moves during a sweep; the robot, actor 0, does not see itself."""
    states = timeline.at(knots_s)
    present = states.present[0].copy()
    present[0] = False
    poses = np.concatenate([states.axles, states.yaws[..., None]], axis=2)
    return Scene(scenery, bodies, knots_s, poses, present)


def _noisy_specs(noise: float) -> tuple[LidarSpec, ImuSpec]:
    """Return both sensors with their errors multiplied."""
    errors = {name: noise * getattr(IMU.spec, name) for name in IMU_ERRORS}
    lidar = replace(LIDAR.spec, range_noise_m=noise * LIDAR.spec.range_noise_m)
    return lidar, replace(IMU.spec, **errors)


def _pose_matrix(rotations: np.ndarray, positions: np.ndarray) -> np.ndarray:
    return Pose.from_parts(rotations[0], positions[0]).matrix


def _timeline(experiment: CorridorExperiment, rng: np.random.Generator) -> Timeline:
    """Record the robot, actor 0, and everybody who walks."""
    stamps_s = np.arange(0.0, LIDAR.stamp_s(experiment.scans) + EXTRA_S, STATE_PERIOD_S)
    robot = MiddleLine().at(experiment.distances_m(stamps_s))
    paths = [robot, *(walker.at(stamps_s) for walker in experiment.draw_walkers(rng))]
    positions = np.stack([positions for positions, _ in paths], axis=1)
    count = len(paths)
    heights_m = rng.uniform(1.55, 1.9, count)
    sizes = np.column_stack([0.34 * heights_m, 0.29 * heights_m, heights_m])
    sizes[0] = ROBOT_SIZE_M
    return Timeline(
        stamps_s=stamps_s,
        ids=np.arange(count),
        categories=np.full(count, Category.PEDESTRIAN.value, np.int8),
        sizes=sizes,
        centre_ahead_m=np.zeros(count),
        present=np.ones((len(stamps_s), count), bool),
        axles=positions,
        yaws=np.stack([yaws for _, yaws in paths], axis=1),
        speeds=np.linalg.norm(np.gradient(positions, STATE_PERIOD_S, axis=0), axis=2),
        crashed=np.zeros((len(stamps_s), count), bool),
        road=RoadMap.from_lanes([]),
    )
