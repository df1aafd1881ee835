"""Our pose fit inside a detector: all rays of a body in one scan, at its likeliest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, LidarScan, Pose, wrap_angle
from roadscope.detectors.moving.links import Chain, Sighting
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_descent import SLACKS_M, descend
from roadscope.detectors.pose.body_fit import CHANCES, still_problem, thinned
from roadscope.detectors.pose.body_kernels import HIT, POSE
from roadscope.detectors.pose.body_model import BodyModel, Storey, saloon
from roadscope.detectors.pose.body_rays import Sighting as BodySighting
from roadscope.detectors.pose.body_rays import sight
from roadscope.detectors.pose.body_sampling import Problem
from roadscope.detectors.pose.body_sight_kernels import BESIDE
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.shape.bodies import Body
from roadscope.envs.sensors.lidar_spec import LidarSpec

BUDGET, COARSE_RAYS = 48, 40
"""Returns of a vehicle beyond which neighbours are joined, and rays of a first fit: ten vehicles
are fitted in a tenth of a second."""
MARK_M = 0.15
"""Scatter of the mark that a vehicle is followed by; from it follows how well its way is known."""
HEADING_RAD = np.radians(10.0)
"""By how much a vehicle's heading departs from its way when that is known well, in a bend say."""
VAGUE_RAD = np.radians(90.0)
"""A way that is known no better says nothing of the heading."""
UNLIKELY = 12.0
"""First guesses whose squared deviation from the way is so much more than the best's are left."""
CLOSE = 15.0
"""First fits whose cost is no more than so much above the best's are followed to the end."""
YAW, SPEED = 2, 3
"""Places among what a pose problem may leave free."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A scan that is to be answered, and where and how it was made."""

    scan: LidarScan
    view: View
    drive_from_ego: Pose
    ego_from_lidar: Pose
    spec: LidarSpec | None
    order: np.ndarray
    columns: np.ndarray

    @staticmethod
    def of(
        scan: LidarScan,
        view: View,
        drive_from_ego: Pose,
        ego_from_lidar: Pose,
        spec: LidarSpec | None,
    ) -> Shot:
        """Sort the scan's columns, so that what lies about a body is quickly found."""
        # Only rays ask for it, and rays need a LiDAR that is known.
        order = np.argsort(scan.column[: len(scan) if spec else 0], kind="stable")
        columns = scan.column[order]
        return Shot(scan, view, drive_from_ego, ego_from_lidar, spec, order, columns)

    def about(self, rows: np.ndarray) -> tuple[LidarScan, np.ndarray]:
        """Return the body's returns and those that its beams met in its columns and beside them.

        rows: (N,) returns of the body. The second is (M,) bool, which returns are the body's.
        """
        scan, target = self.scan, np.zeros(len(self.scan), bool)
        target[rows] = True
        count = self.spec.columns if self.spec is not None else 0
        columns = scan.column[rows].astype(np.int64)
        first, last = int(columns.min()), int(columns.max())
        if last - first > count // 2:
            turned = (columns + count // 2) % count
            first, last = int(turned.min()) - count // 2, int(turned.max()) - count // 2
        if last - first > count // 2:
            return scan, target
        first, last = first - BESIDE, last + BESIDE
        bounds = [(max(first, 0), min(last, count - 1))]
        bounds += [(first + count, count - 1)] if first < 0 else []
        bounds += [(0, last - count)] if last >= count else []
        parts = [
            self.order[slice(*np.searchsorted(self.columns, [low, high + 1]))]
            for low, high in bounds
        ]
        beams = np.zeros(int(scan.ring.max()) + 1, bool)
        beams[scan.ring[rows]] = True
        kept = np.concatenate(parts)
        kept = kept[beams[scan.ring[kept]]]
        return _selected(scan, kept), target[kept]


def _selected(scan: LidarScan, rows: np.ndarray) -> LidarScan:
    return replace(
        scan,
        points=scan.points[rows],
        intensity=scan.intensity[rows],
        ring=scan.ring[rows],
        column=scan.column[rows],
        time_offset_s=scan.time_offset_s[rows],
    )


class Way(NamedTuple):
    """How a vehicle goes: m/s, radians in the drive's frame, and how well its heading is known.

    A speed of 0 stands for what is not known, with any heading alike.
    """

    speed: float
    towards: float
    heading_sd: float

    @staticmethod
    def of(chain: Chain) -> Way:
        """Take the way from where a vehicle was met lately."""
        times = np.array([sighting.met_s for sighting in chain.sightings])
        spread = float(np.sqrt(((times - times.mean()) ** 2).sum()))
        x, y = chain.velocity
        speed = float(np.hypot(x, y))
        if spread == 0 or speed == 0:
            return Way(0.0, 0.0, np.inf)
        sd = float(np.hypot(HEADING_RAD, MARK_M / spread / speed))
        return Way(speed, float(np.arctan2(y, x)), sd) if sd < VAGUE_RAD else Way(0.0, 0.0, np.inf)


def body_pose(seen: Sighting, shot: Shot, body: Body, way: Way) -> VehiclePose | None:
    """Return the likeliest pose at the shot's stamp in the drive's frame.

    None without a LiDAR that is known or a ray that counts. There is no covariance: it takes as
    long again.
    """
    if shot.spec is None:
        return None
    scan, target = shot.about(seen.candidate.rows)
    pose, own = _sensor(shot, seen.met_s - seen.stamp_s)
    sighting = sight(shot.spec, scan, target, pose, sensor_velocity=own, budget=BUDGET)
    return _likeliest(sighting, _model(body), way) if sighting.returns else None


def _likeliest(sighting: BodySighting, model: BodyModel, way: Way) -> VehiclePose:
    """Descend from the sides of an initial rectangle; the way is what is known of the heading.

    Of a few returns of one face any heading of four is likely: the way then decides. Where the
    rays tell the heading, its standard deviation is far less than the way's.
    """
    hits = sighting.rays.kind == HIT
    step = way.speed * np.array([np.cos(way.towards), np.sin(way.towards)])
    points = sighting.points - sighting.rays.time[hits, None] * step
    guesses = _by_way(starts(points, sighting.origin, model), way)
    coarse = still_problem(thinned(sighting.rays, COARSE_RAYS), model, CHANCES, np.arange(3))
    rough = descend(_going(coarse, way), guesses)
    problem = _going(still_problem(sighting.rays, model, CHANCES), way)
    likely = rough.vectors[rough.costs <= rough.costs.min() + CLOSE]
    begin = np.zeros((len(likely), len(problem.free)))
    begin[:, :3] = likely
    fine = descend(problem, begin, SLACKS_M[3:])
    best = int(np.argmin(fine.costs))
    lengths, widths = model.sizes(problem.whole(fine.vectors)[:, POSE:])
    x, y, yaw = fine.vectors[best, :3]
    size = float(lengths[best]), float(widths[best])
    return VehiclePose(float(x), float(y), float(yaw), *size, score=-float(fine.costs[best]))


def _by_way(guesses: np.ndarray, way: Way) -> np.ndarray:
    """Turn headings to within half a turn of the way and leave those that it makes unlikely."""
    off = wrap_angle(guesses[:, 2] - way.towards)
    square = (off / way.heading_sd) ** 2
    turned = np.column_stack([guesses[:, :2], way.towards + off])
    return np.asarray(turned[square <= square.min() + UNLIKELY])


def _going(problem: Problem, way: Way) -> Problem:
    """Return the problem of a body that goes such a way while it is swept."""
    fixed, prior, centre = problem.fixed.copy(), problem.prior.copy(), problem.centre.copy()
    fixed[SPEED], centre[YAW], prior[YAW] = way.speed, way.towards, way.heading_sd
    return replace(problem, fixed=fixed, prior=prior, centre=centre)


def _sensor(shot: Shot, time_s: float) -> tuple[Pose, np.ndarray]:
    """Return place at the stamp, turned as it was a time after it, and velocity of the sensor."""
    x_s, y_s, turn_s = shot.view.twist
    mount, drive = shot.ego_from_lidar, shot.drive_from_ego
    x, y, _ = mount.translation
    velocity = np.array([x_s - turn_s * y, y_s + turn_s * x, 0.0])
    cos, sin = np.cos(turn_s * time_s), np.sin(turn_s * time_s)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    rotation = drive.rotation @ turned @ mount.rotation
    place = drive.rotation @ mount.translation + drive.translation
    return Pose.from_parts(rotation, place), (drive.rotation @ velocity)[:2]


def _model(body: Body) -> BodyModel:
    if body.category is Category.CAR:
        return saloon(body.length, body.width)
    return BodyModel(body.length, body.width, (0.0, 0.3), (Storey(0.15, body.height[0]),))
