"""Our pose fit inside a detector: all rays of a body in one scan, at its likeliest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.core import Category, LidarScan, Pose
from roadscope.detectors.moving.links import Chain
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_descent import RULES, space_of
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_glance import Search, Sensed, Sought, glanced, ways
from roadscope.detectors.pose.body_kernels import Rays
from roadscope.detectors.pose.body_model import BodyModel, Storey, drawn, saloon
from roadscope.detectors.pose.body_rays import beams_of
from roadscope.detectors.pose.body_sight_kernels import Beams, Returns
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.shape.bodies import Body
from roadscope.detectors.sorting import order_by
from roadscope.envs.sensors.lidar_spec import LidarSpec

BUDGET, COARSE_RAYS = 36, 30
"""Returns of a vehicle beyond which neighbours are joined, and rays of the fits before the last."""
FIRST_M, NEXT_M, LAST_M = (0.25, 0.1, 0.04, 0.01, 0.0), (0.03, 0.0), (0.06, 0.02, 0.005, 0.0)
"""Rounds of the first fits, of the pose alone, of the next ones where several are likely, and of
the last one. To look both ways too, in two rounds more, would bring headings on four beams nearer
by a twentieth and take a sixth more time."""
AROUND = 4
"""Places that a fit tries around each step's end: twice as many would bring them no nearer."""
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
    BUDGET, COARSE_RAYS, UNLIKELY, CLOSE, RULES,
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

    def moves(self, times_s: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Return places at the stamp, turned as some times after it, and the sensor's velocity.

        (K, 4, 4) and (2,), of the sensor in the drive's frame.
        """
        x_s, y_s, turn_s = self.view.twist.tolist()
        mount, drive = self.ego_from_lidar.matrix, self.drive_from_ego.matrix
        x, y = mount[:2, 3]
        velocity = np.array([x_s - turn_s * y, y_s + turn_s * x])
        turns = [turn_s * time_s for time_s in times_s]
        turned = np.zeros((len(turns), 3, 3))
        turned[:, 0, 0] = turned[:, 1, 1] = [math.cos(turn) for turn in turns]
        turned[:, 1, 0] = [math.sin(turn) for turn in turns]
        turned[:, 0, 1], turned[:, 2, 2] = -turned[:, 1, 0], 1.0
        matrices = np.repeat((drive @ mount)[None], len(turns), axis=0)
        matrices[:, :3, :3] = drive[:3, :3] @ turned @ mount[:3, :3]
        return matrices, drive[:2, :2] @ velocity


def body_poses(
    moving: Sequence[tuple[Chain, int]], shot: Shot, bodies: Sequence[Body]
) -> list[VehiclePose | None]:
    """Return each vehicle's likeliest pose at the shot's stamp in the drive's frame.

    moving: chains, and which sighting of each is the shot's. None without a LiDAR that is known
    or a ray that counts. There is no covariance: it takes as long again.
    """
    poses: list[VehiclePose | None] = [None] * len(moving)
    if shot.beams is None:
        return poses
    lidar = Sensed(shot.returns, shot.order, shot.columns, shot.beams)
    for body in dict.fromkeys(bodies):
        same = [k for k, other in enumerate(bodies) if other == body]
        seen = [moving[k][0].sightings[moving[k][1]] for k in same]
        rows = [s.candidate.rows for s in seen]
        found = glanced(
            lidar,
            (np.concatenate(rows), np.cumsum([0, *map(len, rows)])),
            shot.moves([s.met_s - s.stamp_s for s in seen]),
            _ways([moving[k][0] for k in same]),
            _sought(body),
            SEARCH,
        )
        for k, (returns, x, y, yaw, length, width, cost) in zip(same, found.tolist(), strict=True):
            poses[k] = VehiclePose(x, y, yaw, length, width, score=-cost) if returns else None
    return poses


def _ways(chains: Sequence[Chain]) -> np.ndarray:
    """Return (K, 3) how vehicles go, as `ways` does."""
    x, y = np.array([chain.velocity for chain in chains]).T
    times_s = np.concatenate([chain.times for chain in chains])
    starts = np.cumsum([0, *(len(chain.times) for chain in chains)])
    going = np.column_stack([np.hypot(x, y), np.arctan2(y, x)])
    return np.asarray(ways(times_s, starts, going, (HEADING_RAD, MARK_M, VAGUE_RAD)))


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
        drawn(model), space_of(pose, around=AROUND, ways=1), space_of(whole, around=AROUND, ways=1)
    )


def _model(body: Body) -> BodyModel:
    if body.category is Category.CAR:
        return saloon(body.length, body.width)
    return BodyModel(body.length, body.width, (0.0, 0.3), (Storey(0.15, body.height[0]),))
