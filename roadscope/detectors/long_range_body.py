"""Our pose fit inside a detector: the most likely pose from all rays of a body in one scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.core import Category, LidarScan, Pose
from roadscope.detectors.moving.links import Chain
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_model import SPEED, VALUES, YAW, BodyModel, BodySection, saloon
from roadscope.detectors.pose.body_rays import BodyScan, body_scan
from roadscope.detectors.pose.body_search import BodyProblem, descend, first_poses, prior_sd
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.shape.bodies import Body
from roadscope.envs.sensors.lidar_spec import LidarSpec

BUDGET, COARSE_RAYS = 36, 30
"""Budget of returns of a vehicle, see `body_scan`, and rays of the first search."""
COARSE_SLACKS_M, FINE_SLACKS_M = (0.25, 0.1, 0.04, 0.01, 0.0), (0.06, 0.02, 0.0)
"""Added to the noise in the rounds of the first search and of the last one, see `descend`."""
AROUND = 4
"""Points that a search tries around the end of each step; twice as many are not more accurate."""
POSITION_M = 0.15
"""Standard deviation of a sighting's position; it says how well a vehicle's course is known."""
HEADING_RAD = math.radians(10.0)
"""Standard deviation of a vehicle's heading from a course that is known well, for example in a
bend."""
VAGUE_RAD = math.radians(90.0)
"""A course with a greater standard deviation says nothing about the heading."""
UNLIKELY = 12.0
"""First guesses are dropped if their squared deviation from the course exceeds the least by
this."""
CLOSE = 15.0
"""First searches are continued if they cost at most this much more than the best one."""


@dataclass(frozen=True, slots=True, eq=False)
class AnsweredScan:
    """A scan whose vehicles are reported, with the poses and the LiDAR behind it.

    spec: the LiDAR, None if it is not known or not needed.
    """

    scan: LidarScan
    view: View
    drive_from_ego: Pose
    ego_from_lidar: Pose
    spec: LidarSpec | None

    @property
    def sensor_velocity(self) -> np.ndarray:
        """Velocity of the sensor, (2,) metres per second, drive's frame."""
        x_s, y_s, turn_s = self.view.twist.tolist()
        x, y = self.ego_from_lidar.matrix[:2, 3]
        velocity = np.array([x_s - turn_s * y, y_s + turn_s * x])
        return np.asarray(self.drive_from_ego.matrix[:2, :2] @ velocity)


@dataclass(frozen=True, slots=True)
class KnownCourse:
    """How a vehicle moves: speed, m/s, heading and its standard deviation, radians."""

    speed: float = 0.0
    heading: float = 0.0
    sd: float = math.inf


def body_poses(
    moving: Sequence[tuple[Chain, int]], answered: AnsweredScan, bodies: Sequence[Body]
) -> list[VehiclePose | None]:
    """Return each vehicle's most likely pose at the stamp of a scan in the drive's frame.

    moving: chains, and for each the sighting of this scan. A pose is None if the LiDAR is not known
    or the body has no ray. Poses have no covariance, which would take as long again.
    """
    if answered.spec is None:
        return [None] * len(moving)
    poses = []
    for (chain, at), body in zip(moving, bodies, strict=True):
        target = np.zeros(len(answered.scan), np.bool_)
        target[chain.sightings[at].candidate.rows] = True
        rays = body_scan(
            answered.spec,
            answered.scan,
            target,
            answered.drive_from_ego @ answered.ego_from_lidar,
            sensor_velocity=answered.sensor_velocity,
            sensor_turn=float(answered.view.twist[2]),
            budget=BUDGET,
        )
        poses.append(likely_pose(rays, _model(body), course_of(chain)))
    return poses


def course_of(chain: Chain) -> KnownCourse:
    """Return how a vehicle moves; the standard deviation is infinite if its course is not known."""
    times_s, (x, y) = np.asarray(chain.times), chain.velocity.tolist()
    spread, speed = float(np.sqrt(((times_s - times_s.mean()) ** 2).sum())), math.hypot(x, y)
    if spread == 0.0 or speed == 0.0:
        return KnownCourse()
    sd = math.hypot(HEADING_RAD, POSITION_M / spread / speed)
    return KnownCourse(speed, math.atan2(y, x), sd) if sd < VAGUE_RAD else KnownCourse()


def likely_pose(scan: BodyScan, model: BodyModel, course: KnownCourse) -> VehiclePose | None:
    """Return the most likely pose of a body in one scan, None without a return.

    With only a few returns of one face four headings are equally likely, and the course decides.
    Where the rays determine the heading, they do so far better than the course.
    """
    if not scan.returns:
        return None
    step = course.speed * np.array([math.cos(course.heading), math.sin(course.heading)])
    poses = first_poses(scan.rays.points(step), scan.origin, model)
    # Headings are taken within half a turn of the course; unlikely ones are dropped.
    off = (poses[:, 2] - course.heading + np.pi) % (2 * np.pi) - np.pi
    poses[:, 2] = course.heading + off
    squares = (off / course.sd) ** 2
    poses = poses[squares <= squares.min() + UNLIKELY]
    fixed, centre = np.zeros(VALUES), np.zeros(VALUES)
    fixed[SPEED], centre[YAW] = course.speed, course.heading
    problem = BodyProblem(
        scan.rays,
        model,
        np.concatenate([np.arange(3), model.uncertain]),
        fixed=fixed,
        centre=centre,
        sd=prior_sd(yaw=course.sd),
    )
    starts = np.zeros((len(poses), len(problem.free)))
    starts[:, :3] = poses
    rough = descend(problem.thinned(COARSE_RAYS), starts, COARSE_SLACKS_M, around=AROUND)
    likely = rough.vectors[rough.costs <= rough.costs.min() + CLOSE]
    fine = descend(problem, likely, FINE_SLACKS_M, around=AROUND)
    best = int(fine.costs.argmin())
    state = problem.states(fine.vectors[best : best + 1])[0]
    length, width = model.sizes(state)
    x, y, yaw = state[:3].tolist()
    return VehiclePose(x, y, yaw, length, width, score=-float(fine.costs[best]))


@cache
def _model(body: Body) -> BodyModel:
    if body.category is Category.CAR:
        return saloon(body.length, body.width)
    return BodyModel(body.length, body.width, (0.0, 0.3), (BodySection(0.15, body.height[0]),))
