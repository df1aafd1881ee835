"""Observations and actions of an agent: flat dictionaries of boxes of fixed shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from roadscope.core import ImuSamples, LidarScan, Pose, wrap_angle
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.traffic.timeline import Timeline

# --------------------------------------------------------------------------------------------------
# Checks of actions.


def checked_action(space: spaces.Space[Any], action: Any) -> Any:
    """Return an action of the space, arrays as a copy; raise `ValueError` for any other.

    Floats of any precision are accepted and kept. It is a copy because environments pass the
    action on in `info`, and callers may reuse their array.
    """
    if isinstance(space, spaces.Box):
        array = np.array(action)
        # `Box.contains` would warn about objects that are not arrays.
        if array.dtype.kind in "iuf" and space.contains(array.astype(space.dtype)):
            return array
    elif space.contains(action):
        return action
    raise ValueError(f"action {action!r} lies outside the action space {space}")


# --------------------------------------------------------------------------------------------------
# Observations.

Observation = dict[str, np.ndarray]

EGO_FIELDS = ("speed_m_s", "yaw_rate_rad_s", "lane_offset_m", "lane_heading_rad")
"""Entries of the observation `ego`: own motion, and place on the nearest lane (left positive)."""

EGO_BOUNDS = np.array([100.0, 20.0, 20.0, np.pi], np.float32)
"""Largest magnitude of each entry; larger values are clipped."""

GOAL_FIELDS = ("ahead_m", "left_m", "cos", "sin")
"""Entries of the observation `goal`, where a task has one: its pose in the ego frame."""

GOAL_BOUNDS = np.array([200.0, 200.0, 1.0, 1.0], np.float32)
"""Largest magnitude of each entry of `goal`."""


def observation_space(rig: Rig, *, goal: bool = False) -> spaces.Space[Observation]:
    """Return the space of `range_image` and `ego_state` for a rig, of images and a goal if any."""
    spec = rig.lidar.spec
    shape = (spec.beams, spec.columns)
    boxes: dict[str, spaces.Space[Any]] = {
        "lidar_range": spaces.Box(0.0, np.float32(spec.range_max_m), shape, np.float32),
        "lidar_intensity": spaces.Box(0.0, 1.0, shape, np.float32),
        "ego": spaces.Box(-EGO_BOUNDS, EGO_BOUNDS, dtype=np.float32),
    }
    if rig.camera is not None:
        pinhole = rig.camera.spec.pinhole
        boxes["image"] = spaces.Box(0, 255, (pinhole.height, pinhole.width, 3), np.uint8)
    if rig.imu is not None:
        limits = np.repeat([rig.imu.spec.gyro_range, rig.imu.spec.accelerometer_range], 3)
        block = np.tile(limits.astype(np.float32), (imu_samples(rig), 1))
        boxes["imu"] = spaces.Box(-block, block, dtype=np.float32)
    if goal:
        boxes["goal"] = spaces.Box(-GOAL_BOUNDS, GOAL_BOUNDS, dtype=np.float32)
    space: Any = spaces.Dict(boxes)
    return space  # type: ignore[no-any-return]


def range_image(scan: LidarScan | None, spec: LidarSpec) -> Observation:
    """Return a scan as images by beam and column.

    Returns lidar_range: (B, C) float32, metres, 0 for no return, row 0 the lowest beam;
    lidar_intensity: (B, C) float32 in 0 to 1. Both are fresh arrays.
    """
    ranges = np.zeros((spec.beams, spec.columns), np.float32)
    intensities = np.zeros_like(ranges)
    if scan is not None and len(scan):
        measured = np.linalg.norm(scan.points, axis=1)
        ranges[scan.ring, scan.column] = np.clip(measured, 0.0, np.float32(spec.range_max_m))
        intensities[scan.ring, scan.column] = np.clip(scan.intensity, 0.0, 1.0)
    return {"lidar_range": ranges, "lidar_intensity": intensities}


def imu_samples(rig: Rig) -> int:
    """Return the number of observed inertial samples: those of one period of the LiDAR."""
    if rig.imu is None:
        return 0
    return max(1, round(rig.imu.spec.rate_hz * rig.lidar.spec.period_s))


def imu_block(before: np.ndarray, samples: ImuSamples) -> np.ndarray:
    """Return (K, 6) float32 of angular velocity and specific force, the latest last; a new array.

    before: (K, 6) previous block, whose newest rows remain.
    """
    new = np.column_stack([samples.angular_velocity, samples.specific_force])
    return np.concatenate([before, new.astype(np.float32)])[-len(before) :]


def ego_state(timeline: Timeline, stamp_s: float, lanes: LaneLocator) -> np.ndarray:
    """Return (4,) float32 of `EGO_FIELDS`; the yaw rate is the mean of the last 50 ms."""
    before = max(stamp_s - 0.05, timeline.start_s)
    states = timeline.at(np.array([before, stamp_s]))
    yaw = float(states.yaws[1, 0])
    turned = yaw - float(states.yaws[0, 0])
    offset, heading = lanes.offset_and_heading(states.axles[1, 0], yaw)
    values = [
        float(states.velocities[1, 0] @ (np.cos(yaw), np.sin(yaw))),
        turned / (stamp_s - before) if stamp_s > before else 0.0,
        offset,
        heading,
    ]
    return _bounded(values, EGO_BOUNDS)


def goal_state(world_from_ego: Pose, world_from_goal: Pose) -> np.ndarray:
    """Return (4,) float32 of `GOAL_FIELDS`: the pose of the goal in the ego frame."""
    ego_from_goal = world_from_ego.inverse() @ world_from_goal
    x, y, _ = ego_from_goal.translation
    return _bounded([x, y, np.cos(ego_from_goal.yaw), np.sin(ego_from_goal.yaw)], GOAL_BOUNDS)


class LaneLocator:
    """Finds the lane on which a vehicle drives."""

    def __init__(self, road: RoadMap) -> None:
        self._road = road
        steps = np.diff(road.points, axis=0, append=road.points[-1:])
        self._headings = np.arctan2(steps[:, 1], steps[:, 0])
        # The last point of a lane has no step of its own.
        last = road.starts[1:] - 1
        self._headings[last] = self._headings[np.maximum(last - 1, road.starts[:-1])]

    def offset_and_heading(self, position: np.ndarray, yaw: float) -> tuple[float, float]:
        """Return the offset to the left of the nearest centre line and the heading along it.

        Metres and radians; zeros where there is no lane. Among several lanes the direction counts
        too: an error of one radian costs as much as a lane's width.
        """
        if not len(self._headings):
            return 0.0, 0.0
        away = position - self._road.points
        squares = (away**2).sum(axis=1)
        # The nearest point costs at most half a turn more: points beyond that cannot be the best.
        nearest = np.argmin(squares)
        most = squares[nearest] + (self._road.widths[nearest] * np.pi) ** 2
        near = np.flatnonzero(squares <= most)
        turned = wrap_angle(yaw - self._headings[near])
        best = int(np.argmin(squares[near] + (self._road.widths[near] * turned) ** 2))
        heading = self._headings[near[best]]
        left = np.array([-np.sin(heading), np.cos(heading)])
        return float(away[near[best]] @ left), float(turned[best])


def _bounded(values: list[float], bounds: np.ndarray) -> np.ndarray:
    clipped: np.ndarray = np.clip(np.array(values, np.float32), -bounds, bounds)
    return clipped
