"""Our pose fit inside a detector: all rays of a body in one scan, at its likeliest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, LidarScan, Pose
from roadscope.detectors.moving.links import Chain, Sighting
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_descent import AROUND as ALL
from roadscope.detectors.pose.body_descent import LIMIT, drawn, space_of
from roadscope.detectors.pose.body_descent_kernels import Rules
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_glance import Search, Sought, likeliest
from roadscope.detectors.pose.body_kernels import Rays
from roadscope.detectors.pose.body_model import BodyModel, Storey, saloon
from roadscope.detectors.pose.body_rays import Sighting as BodySighting
from roadscope.detectors.pose.body_rays import beams_of
from roadscope.detectors.pose.body_sight_kernels import Beams, Motion, Returns, rays_about
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.shape.bodies import Body
from roadscope.detectors.sorting import order_by
from roadscope.envs.sensors.lidar_spec import LidarSpec

BUDGET, COARSE_RAYS = 48, 40
"""Returns of a vehicle beyond which neighbours are joined, and rays of a first fit: ten vehicles
are fitted in a tenth of a second."""
FIRST_M, NEXT_M, LAST_M = (0.25, 0.1, 0.04, 0.01, 0.0), (0.04, 0.01, 0.0), (0.03, 0.01, 0.0)
"""Rounds of the first fits, of the pose alone, of the next ones, and of the last one, which alone
tries all places around each step's end. To look both ways too, in two rounds more, would bring
headings on four beams nearer by a twentieth and take a sixth more time."""
AROUND = 4
"""Places that a first fit tries around each step's end."""
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
SEARCH = Search(
    np.array([*FIRST_M, 0.0]), np.array([*NEXT_M, 0.0]), np.array([*LAST_M, 0.0]),
    COARSE_RAYS, UNLIKELY, CLOSE, Rules(LIMIT, CHANCES.edge_m),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A scan that is to be answered, and where and how it was made.

    returns: of the scan. beams: of the LiDAR, None where it is not known or not asked for.
    order, columns: (N,) int64, rows by column, and the columns in that order.
    """

    scan: LidarScan
    view: View
    drive_from_ego: Pose
    ego_from_lidar: Pose
    beams: Beams | None
    returns: Returns
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
        order = order_by(scan.column[: len(scan) if spec else 0])
        returns = Returns(scan.points, scan.ring, scan.column.astype(np.int64), scan.intensity)
        beams = None if spec is None else beams_of(spec)
        columns = returns.column[order]
        return Shot(scan, view, drive_from_ego, ego_from_lidar, beams, returns, order, columns)

    def sighting(self, rows: np.ndarray, time_s: float) -> BodySighting:
        """Return what the rays around a body tell of it.

        rows: (N,) returns of the body, N at least 1. time_s: from the stamp to when it was met.
        """
        assert self.beams is not None
        lidar = self.beams, _motion(self, time_s)
        ordered = self.order, self.columns
        rays, hits = rays_about(self.returns, ordered, rows, lidar, BUDGET)
        return BodySighting(rays, lidar[1].matrix[:2, 3].copy(), int(hits))


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
        spread = float(np.sqrt(((chain.times - chain.times.mean()) ** 2).sum()))
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
    if shot.beams is None:
        return None
    sighting = shot.sighting(seen.candidate.rows, seen.met_s - seen.stamp_s)
    if not sighting.returns:
        return None
    x, y, yaw, length, width, cost = likeliest(
        sighting.rays, sighting.origin, way, _sought(body), SEARCH
    )
    return VehiclePose(x, y, yaw, length, width, score=-cost)


def _motion(shot: Shot, time_s: float) -> Motion:
    """Return place at the stamp, turned as it was a time after it, and velocity of the sensor."""
    x_s, y_s, turn_s = shot.view.twist.tolist()
    mount, drive = shot.ego_from_lidar.matrix, shot.drive_from_ego.matrix
    x, y = mount[:2, 3]
    velocity = np.array([x_s - turn_s * y, y_s + turn_s * x])
    cos, sin = math.cos(turn_s * time_s), math.sin(turn_s * time_s)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    matrix = drive @ mount
    matrix[:3, :3] = drive[:3, :3] @ turned @ mount[:3, :3]
    return Motion(matrix, drive[:2, :2] @ velocity, 0.0, 1.0)


@cache
def _sought(body: Body) -> Sought:
    """Return a body, and where it is searched, whatever the rays."""
    model, none = _model(body), np.empty(0)
    rays = Rays(
        np.empty((0, 3)), np.empty((0, 2)), none, none, np.empty(0, np.int64), none, none, none
    )
    pose = still_problem(rays, model, CHANCES, np.arange(3))
    whole = still_problem(rays, model, CHANCES)
    return Sought(
        drawn(model), space_of(pose, around=AROUND, ways=1), space_of(whole, around=ALL, ways=1)
    )


def _model(body: Body) -> BodyModel:
    if body.category is Category.CAR:
        return saloon(body.length, body.width)
    return BodyModel(body.length, body.width, (0.0, 0.3), (Storey(0.15, body.height[0]),))
