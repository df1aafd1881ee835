"""A rounded body fitted to a cluster's outline and to the sight past its ends, as a shape."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.pose.body_descent import RULES, space_of
from roadscope.detectors.pose.body_descent_kernels import Rules, Space, lowest
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_kernels import POSE, Rays
from roadscope.detectors.pose.body_lanes import Drawn
from roadscope.detectors.pose.body_model import BodyModel, Storey, drawn
from roadscope.detectors.pose.body_outline_kernels import Around, outline_rays
from roadscope.detectors.pose.body_start import along_sides
from roadscope.detectors.shape.bodies import BODIES, BRICKS, Body
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.l_shape import vehicles_by_l_shape
from roadscope.detectors.shape.recognition import Vehicle

SLACKS = np.array([0.15, 0.05, 0.02, 0.0, 0.0, 0.0])
"""Added to noise and edges round by round, metres."""
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
    x, y = vehicle.centre
    outline, origin = np.asarray(cluster.outline, np.float64), np.asarray(cluster.origin)
    found, length, width = _likeliest(
        (outline, origin, horizon.around), np.array([x, y, vehicle.yaw]), drawn(model),
        _space(model), (SLACKS, RULES),
    )  # fmt: skip
    if not math.hypot(found[0] - x, found[1] - y) < MOVED_M:
        return vehicle
    return replace(
        vehicle,
        centre=(float(found[0]), float(found[1])),
        size=(length, width, vehicle.size[2]),
        yaw=math.atan(math.tan(found[2])),
    )


@compiled()
def _likeliest(
    seen: tuple[np.ndarray, np.ndarray, Around],
    guess: np.ndarray,
    body: Drawn,
    space: Space,
    search: tuple[np.ndarray, Rules],
) -> tuple[np.ndarray, float, float]:
    """Return x, y, yaw, and length and width of the likeliest body.

    seen: outline (M, 2), sensor (2,), and sight around. guess: (3,) x, y, yaw, tried beside the
    sides of an initial rectangle.
    """
    outline, origin, around = seen
    slacks, rules = search
    means = body.sizes[:, 0]
    begin = np.zeros((3, len(space.free)))
    begin[:2, :3] = along_sides(outline, origin, means[0], means[1])[:2]
    begin[2, :3] = guess
    rays = outline_rays(outline, origin, around)
    vectors, costs = lowest(begin, slacks, body, space, (rays, rules))
    whole = space.fixed.copy()
    whole[space.free] = vectors[costs.argmin()]
    sides = np.maximum(means + body.sizes[:, 1] * whole[POSE : POSE + 2], 0.3 * means)
    return whole[:3], sides[0], sides[1]


def _kind(vehicle: Vehicle) -> Body:
    """Return the body of the vehicle's category that is nearest to it in length."""
    same = (body for body in BODIES if body.category == vehicle.category)
    return min(same, key=lambda body: abs(body.length[0] - vehicle.size[0]))


@cache
def _model(body: Body) -> BodyModel:
    return BodyModel(body.length, body.width, storeys=(Storey(0.0, 2.0),))


@cache
def _space(model: BodyModel) -> Space:
    """Return where a standing body is searched, whatever the rays."""
    none = np.empty(0)
    rays = Rays(
        np.empty((0, 3)), np.empty((0, 2)), none, none, np.empty(0, np.int64), none, none, none
    )
    return space_of(still_problem(rays, model, CHANCES), around=0, ways=2)
