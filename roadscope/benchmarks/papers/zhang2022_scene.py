"""Zhang 2022's experiments with its robot in a corridor as scans, with the truth beside them.

Seeds vary noise, biases of the IMU, doors and furniture, and who walks where; never how the robot
drives. Its LiDAR stands level on a robot that does not sway.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from roadscope.benchmarks.papers.zhang2022_building import Way, building, corner, direction
from roadscope.core import Category, ImuSamples, LidarScan, Pose
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.ego_motion import EgoMotion
from roadscope.envs.sensors.imu import ImuNoise, measure, samples_of
from roadscope.envs.sensors.imu_spec import IMUS, ImuSpec
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.lidar_spec import SPECS, LidarSpec
from roadscope.envs.sensors.rig import ImuMount, LidarMount
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.world import actor_bodies

LIDAR = LidarMount("lidar", SPECS["vlp16"], Pose.planar(0.0, 0.0, 0.0, 0.6))
"""The paper gives no height: a robot as high as a knee, the LiDAR on top."""
IMU = ImuMount("imu", IMUS["zed2"], Pose.planar(0.15, 0.0, 0.0, 0.55))
"""The camera's, as in the paper, in front of the LiDAR."""
IMU_ERRORS = (
    "gyro_noise", "gyro_walk", "gyro_turn_on",
    "accelerometer_noise", "accelerometer_walk", "accelerometer_turn_on",
)  # fmt: skip
STEP_S, AFTER_S = 0.05, 0.5
"""Of recorded states, which go on a little after the last scan."""
PUSH_M_S2 = 0.5
PACE_M_S = (0.9, 1.5)
ASIDE_M = (0.65, 1.0)
"""How far from the middle line people walk, to either side: the robot has room to pass."""


@dataclass(frozen=True, slots=True)
class Walk:
    """Somebody who goes to and fro along a side of the corridor.

    between_m: two places along the side. aside_m: to the left of the middle line. pace_m_s, phase:
        share of a whole to and fro that is behind them at the start.
    """

    side: int
    between_m: tuple[float, float]
    aside_m: float
    pace_m_s: float
    phase: float

    def at(self, stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (T, 2) places and (T,) headings at (T,) stamps."""
        low, high = self.between_m
        gone = self.phase + self.pace_m_s * stamps_s / (2 * (high - low))
        share = 2 * (gone % 1.0)
        back = share > 1
        along = low + (high - low) * np.where(back, 2 - share, share)
        ahead = np.array(direction(self.side))
        left = np.array([-ahead[1], ahead[0]])
        places = np.array(corner(self.side)) + along[:, None] * ahead + self.aside_m * left
        return places, np.arctan2(ahead[1], ahead[0]) + np.pi * back


@dataclass(frozen=True, slots=True)
class Play:
    """What happens in an experiment.

    start_m: place of the robot on its way. length_m: how far it goes. speed_m_s: how fast, once
    it has gained speed; 0 stands. scans: how many. walks: draws who walks from random numbers.
    """

    start_m: float
    length_m: float
    speed_m_s: float
    scans: int
    walks: Callable[[np.random.Generator], list[Walk]]

    def gone_m(self, stamps_s: np.ndarray) -> np.ndarray:
        """Return the way gone by (T,) stamps: even acceleration, even speed, even braking."""
        if self.speed_m_s == 0:
            return np.full(len(stamps_s), self.start_m)
        push_s = self.speed_m_s / PUSH_M_S2
        end_s = self.length_m / self.speed_m_s + push_s
        t = np.clip(stamps_s, 0.0, end_s)
        way = self.speed_m_s * (t - push_s / 2)
        gaining, braking = t < push_s, t > end_s - push_s
        way[gaining] = PUSH_M_S2 / 2 * t[gaining] ** 2
        way[braking] = self.length_m - PUSH_M_S2 / 2 * (end_s - t[braking]) ** 2
        gone: np.ndarray = self.start_m + way
        return gone


@dataclass(frozen=True, slots=True)
class Shot:
    """One sweep with what was measured since the one before.

    start_from_lidar: (4, 4) true pose at the stamp, in the LiDAR's frame of the first sweep.
    velocity: (3,) true m/s, lidar frame. moving: (N,) bool, returns of people who walk.
    """

    scan: LidarScan
    imu: ImuSamples
    start_from_lidar: np.ndarray
    velocity: np.ndarray
    moving: np.ndarray


def film(play: Play, seed: int, noise: float = 1.0) -> Iterator[Shot]:
    """Sense an experiment sweep by sweep, every 0.1 s.

    noise: factor on the range noise of the LiDAR and on all errors of the IMU.
    """
    layout, people, returns, unit = np.random.SeedSequence(seed).generate_state(4)
    timeline = _timeline(play, np.random.default_rng(people))
    scenery, bodies = building(int(layout)), actor_bodies(timeline, int(people))
    spec, imu_spec = sensors(noise)
    motion, errors = EgoMotion(timeline), ImuNoise(imu_spec, int(unit))
    imu = replace(IMU, spec=imu_spec)
    path = partial(motion.mounted, LIDAR.ego_from_lidar)
    first = np.linalg.inv(_pose(*path(np.array([LIDAR.stamp_s(0)]))))
    for k in range(play.scans):
        stamp_s = LIDAR.stamp_s(k)
        half = LIDAR.spec.sweep_s / 2
        knots = np.linspace(stamp_s - half, stamp_s + half, 6)
        states = timeline.at(knots)
        present = states.present[0].copy()
        present[0] = False
        poses = np.concatenate([states.axles, states.yaws[..., None]], axis=2)
        scene = Scene(scenery, bodies, knots, poses, present)
        rng = np.random.default_rng([int(returns), k])
        scan, seen = sweep(scene, spec, path, stamp_s, rng=rng)
        here = motion.at(np.array([stamp_s]), LIDAR.ego_from_lidar.translation)
        yield Shot(
            scan, measure(motion, imu, errors, *samples_of(LIDAR, k, IMU.spec.rate_hz)),
            first @ _pose(*path(np.array([stamp_s]))), here.rotations[0].T @ here.velocities[0],
            seen.owners >= 0,
        )  # fmt: skip


def sensors(noise: float) -> tuple[LidarSpec, ImuSpec]:
    """Return both sensors with their errors multiplied."""
    worse = {name: noise * getattr(IMU.spec, name) for name in IMU_ERRORS}
    lidar = replace(LIDAR.spec, range_noise_m=noise * LIDAR.spec.range_noise_m)
    return lidar, replace(IMU.spec, **worse)


def _pose(rotations: np.ndarray, positions: np.ndarray) -> np.ndarray:
    return Pose.from_parts(rotations[0], positions[0]).matrix


def _timeline(play: Play, rng: np.random.Generator) -> Timeline:
    """Record the robot, actor 0, and everybody who walks."""
    stamps = np.arange(0.0, LIDAR.stamp_s(play.scans) + AFTER_S, STEP_S)
    way, gone = Way(), play.gone_m(stamps)
    ways = [way.at(gone), *(walk.at(stamps) for walk in play.walks(rng))]
    grid, heights = (len(stamps), len(ways)), rng.uniform(1.55, 1.9, len(ways))
    sizes = np.column_stack([0.34 * heights, 0.29 * heights, heights])
    sizes[0] = 0.8, 0.6, 0.5
    places = np.stack([place for place, _ in ways], axis=1)
    speeds = np.linalg.norm(np.gradient(places, STEP_S, axis=0), axis=2)
    categories = np.full(len(ways), Category.PEDESTRIAN.value, np.int8)
    return Timeline(
        stamps_s=stamps, ids=np.arange(len(ways)), categories=categories, sizes=sizes,
        centre_ahead_m=np.zeros(len(ways)), present=np.ones(grid, bool), axles=places,
        yaws=np.stack([yaw for _, yaw in ways], axis=1), speeds=speeds,
        crashed=np.zeros(grid, bool), road=RoadMap.from_lanes([]),
    )  # fmt: skip
