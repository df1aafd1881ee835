"""Our pose fit inside a detector: all rays of a body in one scan, at its likeliest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Category, LidarScan, Pose
from roadscope.detectors.moving.links import Sighting
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_descent import SLACKS_M, descend
from roadscope.detectors.pose.body_fit import CHANCES, still_problem, thinned
from roadscope.detectors.pose.body_kernels import HIT, POSE
from roadscope.detectors.pose.body_model import BodyModel, Storey, saloon
from roadscope.detectors.pose.body_rays import BESIDE, sight
from roadscope.detectors.pose.body_rays import Sighting as BodySighting
from roadscope.detectors.pose.body_sampling import WHOLE
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.shape.bodies import Body
from roadscope.envs.sensors.lidar_spec import LidarSpec

BUDGET, COARSE_RAYS = 48, 40
"""Returns of a vehicle beyond which neighbours are joined, and rays of a first fit: ten vehicles
are fitted in a tenth of a second."""
HEADING, HEADING_M_S = np.cos(np.radians(50.0)), 3.0
"""Speed from which the way that a vehicle goes tells its front from its rear, and how well."""
SPEED = 3
"""Place of the speed among what a pose problem may leave free."""


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
        """Return the returns of the columns that a body fills and those beside it, and its own.

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
        kept = np.concatenate(parts)
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


def body_pose(seen: Sighting, shot: Shot, body: Body, velocity: np.ndarray) -> VehiclePose | None:
    """Return the likeliest pose at the shot's stamp in the drive's frame.

    velocity: (2,) of the vehicle, m/s, drive frame. None without a LiDAR that is known or a ray
    that counts. There is no covariance: it takes as long again.
    """
    if shot.spec is None:
        return None
    scan, target = shot.about(seen.candidate.rows)
    pose, own = _sensor(shot, seen.met_s - seen.stamp_s)
    sighting = sight(shot.spec, scan, target, pose, sensor_velocity=own, budget=BUDGET)
    if sighting.returns == 0:
        return None
    speed = float(np.hypot(*velocity))
    if speed < HEADING_M_S:
        return _likeliest(sighting, _model(body), None, 0.0)
    towards = float(np.arctan2(velocity[1], velocity[0]))
    return _likeliest(sighting, _model(body), towards, speed)


def _likeliest(
    sighting: BodySighting, model: BodyModel, towards: float | None, speed: float
) -> VehiclePose:
    """Descend from the sides of an initial rectangle, about the way the body goes if known."""
    hits = sighting.rays.kind == HIT
    way = np.zeros(2) if towards is None else np.array([np.cos(towards), np.sin(towards)])
    points = sighting.points - speed * sighting.rays.time[hits, None] * way
    guesses = np.stack(starts(points, sighting.origin, model))
    if towards is not None:
        likely = np.cos(guesses[:, 2] - towards) > HEADING
        guesses = guesses[likely] if likely.any() else guesses
    fixed = np.zeros(WHOLE)
    fixed[SPEED] = speed
    coarse = still_problem(thinned(sighting.rays, COARSE_RAYS), model, CHANCES, np.arange(3))
    rough = descend(replace(coarse, fixed=fixed), guesses)
    problem = replace(still_problem(sighting.rays, model, CHANCES), fixed=fixed)
    start = np.zeros((1, len(problem.free)))
    start[0, :3] = rough.vectors[np.argmin(rough.costs)]
    best = descend(problem, start, SLACKS_M[3:])
    (length,), (width,) = model.sizes(problem.whole(best.vectors)[:, POSE:])
    x, y, yaw = best.vectors[0, :3]
    return VehiclePose(
        float(x), float(y), float(yaw), float(length), float(width), score=-float(best.costs[0])
    )


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
