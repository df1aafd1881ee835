"""Moving vehicles and their poses from sparse returns (Zhang 2017), as detectors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from roadscope.core import Category, Detections, Frame, LidarScan, Pose
from roadscope.detectors.drops import check_faint, without_faint
from roadscope.detectors.long_range_scores import (
    MOVING_FEATURES,
    moving_features,
    moving_score_model,
)
from roadscope.detectors.moving import Memory, extract
from roadscope.detectors.moving.lidar import lidar_of
from roadscope.detectors.moving.links import BodySize, Chain, Links, usual
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_model import (
    SPEED,
    VALUES,
    YAW,
    BodyModel,
    BodySection,
    SizePrior,
    saloon,
)
from roadscope.detectors.pose.body_rays import BodyScan, body_scan
from roadscope.detectors.pose.body_search import BodyProblem, descend, first_poses, prior_sd
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.shape.bodies import Body
from roadscope.envs.sensors.lidar_spec import LidarSpec

FITS = ("single", "multi", "ransac", "body")
MOST_POINTS = 150
"""Most returns for a fit; more returns of a near vehicle do not improve it."""
FRAMES = 3
"""Sightings that `multi` fits together, as the paper does."""
BIN_M, STEP_DEG = 0.04, 2.0
"""Bins and steps of `multi`. Bins are as wide as the filter's edges, and a parabola gives the angle
between two steps. The paper's bins and steps, half as wide, are not more accurate and take twice as
long."""


class LongRangeDetector:
    """Detects moving vehicles, and fits a typical body of their size to each.

    Standing vehicles are not detected, by design; the package `moving` decides what moves. A
    vehicle is reported from its second sighting on. The paper knows the vehicle's size; here it is
    that of a typical car, or of the smallest typical body that is as large as the returns.
    """

    def __init__(
        self,
        *,
        fit: str = "single",
        late: bool = False,
        min_score: float = 0.0,
        faint: float = 0.0,
        range_noise_m: float | None = None,
        range_max_m: float = 100.0,
        detection_limit: float = 0.4,
    ) -> None:
        """Choose the fit.

        fit: `single` and `ransac` fit one scan, `multi` three in a row, `body` all rays of one.
        late: whether each frame is answered one frame later. `multi` then fits the middle of its
            three scans, as the paper does; otherwise it fits the newest.
        min_score: detections that are less probable are left out.
        faint: returns of less intensity than this within 15 m count as drops of fog or rain and are
            left out, as in `ClusterDetector`.
        range_noise_m, range_max_m, detection_limit: of the LiDAR, as in `LidarSpec`; only `body`
            uses them. With None the noise is estimated from each scan. The default limits are the
            HDL-32E's.
        """
        if fit not in FITS:
            raise ValueError(f"no fit '{fit}'; known: {', '.join(FITS)}")
        if not 0 <= min_score < 1:
            raise ValueError(f"min_score must be at least 0 and below 1, got {min_score!r}")
        self._fit, self._late, self._faint = fit, late, check_faint(faint)
        self._min_score = min_score
        self._figures = _lidar_figures(range_noise_m, range_max_m, detection_limit)
        self._memory = Memory()
        self.reset()

    def reset(self) -> None:
        """Forget all scans."""
        self._memory.reset()
        self._links = Links()
        self._last: AnsweredScan | None = None

    def detect(self, frame: Frame) -> Detections:
        """Return moving vehicles, ego frame, in the frame's scan or, if late, in the last one."""
        vehicles, stamp_s = self.propose(frame)
        values = np.array([v.features for v in vehicles]).reshape(-1, len(MOVING_FEATURES))
        scores = moving_score_model().probabilities(values)
        probable = np.flatnonzero(scores >= self._min_score)
        return detections([vehicles[k] for k in probable], scores[probable], stamp_s)

    def propose(self, frame: Frame) -> tuple[list[MovingVehicle], float]:
        """Return the moving vehicles, before scoring, and the stamp of their scan."""
        if frame.lidar is not None:
            frame = replace(frame, lidar=without_faint(frame.lidar, self._faint))
        memory, scan = self._memory, frame.lidar
        if frame.stamp_s <= memory.stamp_s:
            self.reset()
        memory.add(frame)
        if scan is None or memory.now is None:
            return [], frame.stamp_s
        self._links.update(
            scan.stamp_s, extract(memory.now, memory.earlier_views()), memory.drive_from_ego
        )
        mount = frame.calibration.pose(scan.sensor)
        spec = lidar_of(scan, **self._figures) if self._fit == "body" else None
        answered = AnsweredScan(scan, memory.now, memory.drive_from_ego, mount, spec)
        reported, self._last = (self._last if self._late else answered), answered
        if reported is None:
            return [], scan.stamp_s
        vehicles = _moving_vehicles(self._links.chains, reported, self._fit)
        return vehicles, reported.scan.stamp_s


def _lidar_figures(
    range_noise_m: float | None, range_max_m: float, detection_limit: float
) -> dict[str, Any]:
    """Return the arguments of `lidar_of`; ValueError for one that is impossible."""
    if range_noise_m is not None and not 0 <= range_noise_m < np.inf:
        raise ValueError(f"range_noise_m must be None or from 0 up, got {range_noise_m!r}")
    if not 0 < range_max_m < np.inf:
        raise ValueError(f"range_max_m must be a positive length in metres, got {range_max_m!r}")
    if not 0 <= detection_limit < np.inf:
        raise ValueError(f"detection_limit must be from 0 up, got {detection_limit!r}")
    return {
        "range_noise_m": range_noise_m,
        "range_max_m": range_max_m,
        "detection_limit": detection_limit,
    }


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


class MovingVehicle(NamedTuple):
    """A vehicle in the ego frame at the stamp of its scan.

    centre, size: metres. yaw: radians. features: (F,), from which its score is computed.
    """

    centre: tuple[float, float, float]
    yaw: float
    size: tuple[float, float, float]
    category: Category
    features: np.ndarray


def _moving_vehicles(
    chains: Sequence[Chain], answered: AnsweredScan, fit: str
) -> list[MovingVehicle]:
    """Return the vehicles of the chains that move and have a sighting in the answered scan."""
    stamp_s, rings = answered.scan.stamp_s, answered.scan.ring
    places = ((c, k) for c in chains for k, s in enumerate(c.sightings) if s.stamp_s == stamp_s)
    moving = [(chain, at) for chain, at in places if chain.moves]
    usuals = usual([chain for chain, _ in moving])
    poses = _poses(moving, answered, fit, usuals)
    # As Python numbers: for single points they are faster than an array.
    ego_from_drive = answered.drive_from_ego.inverse().matrix.tolist()
    vehicles = []
    for (chain, at), pose, (body, size) in zip(moving, poses, usuals, strict=True):
        sighting = chain.sightings[at]
        values = moving_features(chain, sighting, rings[sighting.candidate.rows], pose)
        height, category = size.height, body.category
        centre, yaw = _in_ego(pose, height, ego_from_drive)
        dimensions = (pose.length, pose.width, height)
        vehicles.append(MovingVehicle(centre, yaw, dimensions, category, values))
    return vehicles


def _poses(
    moving: Sequence[tuple[Chain, int]],
    answered: AnsweredScan,
    fit: str,
    usuals: Sequence[tuple[Body, BodySize]],
) -> list[VehiclePose]:
    """Return a pose for each chain at one of its sightings, in the drive's frame."""
    if fit == "body":
        fitted = body_poses(moving, answered, [body for body, _ in usuals])
    else:
        fitted = [None] * len(moving)
    return [
        pose or _posed(chain, at, fit, size)
        for pose, (chain, at), (_, size) in zip(fitted, moving, usuals, strict=True)
    ]


def _in_ego(
    pose: VehiclePose, height: float, ego_from_drive: list[list[float]]
) -> tuple[tuple[float, float, float], float]:
    """Map a pose from the drive's frame into the ego frame; return its centre and yaw.

    height: height of the vehicle. ego_from_drive: (4, 4). In metres and radians.
    """
    (a, b, _, ahead), (c, d, _, left), *_ = ego_from_drive
    x, y = pose.x * a + pose.y * b + ahead, pose.x * c + pose.y * d + left
    return (x, y, height / 2), pose.yaw + math.atan2(c, a)


def _posed(chain: Chain, at: int, fit: str, size: BodySize) -> VehiclePose:
    """Return the pose of a chain at one of its sightings by the fit with this name."""
    if fit == "multi":
        return _posed_by_window(chain, at, size)
    sighting = chain.sightings[at]
    points, origin = sighting.at_stamp(chain.velocity, most=MOST_POINTS), sighting.origin
    if fit == "ransac":
        rng = np.random.default_rng(0)
        return fit_ransac(points, origin, rng, length_m=size.length, width_m=size.width)
    return fit_single(points, origin, length_m=size.length, width_m=size.width)


def _posed_by_window(chain: Chain, at: int, size: BodySize) -> VehiclePose:
    """Return the pose at a sighting by `fit_multi`, with the sightings around it."""
    first = max(0, min(at - 1, len(chain.sightings) - FRAMES))
    window = chain.sightings[first : first + FRAMES]
    return fit_multi(
        [sighting.at_stamp(chain.velocity, most=MOST_POINTS) for sighting in window],
        [sighting.origin for sighting in window],
        [sighting.stamp_s for sighting in window],
        length_m=size.length,
        width_m=size.width,
        at=at - first,
        bin_m=BIN_M,
        step_deg=STEP_DEG,
    )


def detections(vehicles: Sequence[MovingVehicle], scores: np.ndarray, stamp_s: float) -> Detections:
    """Return vehicles with scores as detections in the ego frame."""
    if not vehicles:
        return Detections.empty(stamp_s)
    return Detections(
        centres=np.array([v.centre for v in vehicles]),
        sizes=np.array([v.size for v in vehicles]),
        yaws=np.array([v.yaw for v in vehicles]),
        categories=np.array([v.category for v in vehicles], np.int8),
        scores=scores,
        frame="ego",
        stamp_s=stamp_s,
    )


# --------------------------------------------------------------------------------------------------
# Our fit: the most likely pose from all rays of a body in one scan.

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
        poses.append(likely_pose(rays, _body_model(body), course_of(chain)))
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
def _body_model(body: Body) -> BodyModel:
    if body.category is Category.CAR:
        return saloon(SizePrior(*body.length), SizePrior(*body.width))
    section = BodySection(0.15, body.height[0])
    return BodyModel(SizePrior(*body.length), SizePrior(*body.width), (0.0, 0.3), (section,))
