"""A rounded body fitted to a cluster's outline and to the sight past its ends, as a shape."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from roadscope.core import Category
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.pose.body_descent import descend
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_kernels import POSE
from roadscope.detectors.pose.body_model import BodyModel, Storey
from roadscope.detectors.pose.body_outline_kernels import outline_rays
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.shape.bodies import BODIES, Body
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.l_shape import vehicles_by_l_shape
from roadscope.detectors.shape.recognition import Vehicle

BRICKS = (Category.CAR, Category.VAN, Category.TRUCK, Category.BUS)
SLACKS_M = (0.15, 0.05, 0.02, 0.0, 0.0)
MOVED_M = 2.0
"""A fit that ends farther from its first guess has run away."""


def vehicles_by_body(cluster: Cluster, horizon: Horizon) -> list[Vehicle]:
    """Return the road users of a cluster, cars to buses fitted as bodies with rounded corners.

    Which kind of road user it is comes from the search-based L-shape; its sizes are the prior
    of length and width. Sight past the ends of the outline bounds the body, and what stands
    nearer there does not.
    """
    vehicles = vehicles_by_l_shape(cluster, horizon)
    if len(vehicles) != 1 or vehicles[0].category not in BRICKS or len(cluster.outline) < 3:
        return vehicles
    return [_fitted(vehicles[0], cluster, horizon)]


def _fitted(vehicle: Vehicle, cluster: Cluster, horizon: Horizon) -> Vehicle:
    model = _model(_kind(vehicle))
    rays = outline_rays(cluster.outline, cluster.origin, horizon.around)
    problem = still_problem(rays, model, CHANCES)
    guesses = np.zeros((3, len(problem.free)))
    guesses[:2, :3] = starts(cluster.outline, cluster.origin, model)[:2]
    guesses[2, :3] = *vehicle.centre, vehicle.yaw
    best = descend(problem, guesses, SLACKS_M, around=0)
    vector = best.vectors[np.argmin(best.costs)]
    x, y = vehicle.centre
    if not np.hypot(vector[0] - x, vector[1] - y) < MOVED_M:
        return vehicle
    length, width = model.sizes(problem.whole(vector[None])[:, POSE:])
    return replace(
        vehicle,
        centre=(float(vector[0]), float(vector[1])),
        size=(float(length[0]), float(width[0]), vehicle.size[2]),
        yaw=float(np.arctan(np.tan(vector[2]))),
    )


def _kind(vehicle: Vehicle) -> Body:
    """Return the body of the vehicle's category that is nearest to it in length."""
    same = (body for body in BODIES if body.category == vehicle.category)
    return min(same, key=lambda body: abs(body.length[0] - vehicle.size[0]))


@cache
def _model(body: Body) -> BodyModel:
    return BodyModel(body.length, body.width, storeys=(Storey(0.0, 2.0),))
