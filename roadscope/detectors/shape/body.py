"""A shape: a rounded body fitted to a cluster's outline and to the rays that pass beside it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from roadscope.core import wrap_angle
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.pose.body_model import BodyModel, BodySection, SizePrior
from roadscope.detectors.pose.body_rays import EMPTY, HIT, PASSED, BodyRays
from roadscope.detectors.pose.body_search import BodyProblem, descend, first_poses
from roadscope.detectors.shape.bodies import BODIES, BOX_SHAPED, Body
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.l_shape import vehicles_by_l_shape
from roadscope.detectors.shape.recognition import Vehicle

SLACKS_M = (0.15, 0.05, 0.02, 0.0, 0.0)
"""Added, in successive iterations, to the noise of ranges and to the width of edges, see
`descend`."""
MOST_MOVED_M = 2.0
"""A fit that ends farther than this from the L-shape has diverged; then the L-shape is returned.
Chosen by hand."""
MOST_POINTS = 32
"""Most points of an outline that are used; more take more time. Chosen by hand."""
COLUMNS_BESIDE = 3
"""Columns beyond either end of the outline whose rays are used. Chosen by hand."""
NOISE_M = (0.02, 0.15)
"""Bounds to which the estimated noise of an outline is clipped: those of data sheets and more."""


def vehicles_by_body(cluster: Cluster, horizon: Horizon) -> list[Vehicle]:
    """Return the road users of a cluster, cars to buses fitted as bodies with rounded corners.

    The kind of road user is that of the searched L-shape; the sizes of that kind are the prior of
    length and width. Rays that pass beside the ends of the outline bound the body; rays that end
    nearer do not.
    """
    vehicles = vehicles_by_l_shape(cluster, horizon)
    if len(vehicles) != 1 or vehicles[0].category not in BOX_SHAPED or len(cluster.outline) < 3:
        return vehicles
    return [_fitted(vehicles[0], cluster, horizon)]


def _fitted(vehicle: Vehicle, cluster: Cluster, horizon: Horizon) -> Vehicle:
    model = _model(_kind(vehicle))
    outline, origin = np.asarray(cluster.outline, np.float64), np.asarray(cluster.origin)
    free = np.concatenate([np.arange(3), model.uncertain])
    problem = BodyProblem(outline_rays(outline, origin, horizon), model, free)
    starts = np.zeros((3, len(free)))
    starts[:2, :3] = first_poses(outline, origin, model)[:2]
    starts[2, :3] = *vehicle.centre, vehicle.yaw
    ends = descend(problem, starts, SLACKS_M, around=0)
    state = problem.states(ends.vectors[[ends.costs.argmin()]])[0]
    x, y, yaw = state[:3].tolist()
    if not math.dist((x, y), vehicle.centre) < MOST_MOVED_M:
        return vehicle
    size = (*model.sizes(state), vehicle.size[2])
    return replace(vehicle, centre=(x, y), size=size, yaw=math.atan(math.tan(yaw)))


def outline_rays(outline: np.ndarray, origin: np.ndarray, horizon: Horizon) -> BodyRays:
    """Return level rays to the points of an outline (M, 2), metres, and rays beside its ends.

    origin: (2,) metres, the sensor. A ray beside the outline that ends at something nearer says
    nothing about the body.
    """
    offsets = outline[:: -(-len(outline) // MOST_POINTS)] - origin
    reach, azimuths = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
    noise_m = _noise(reach)
    steps = horizon.step * np.arange(1, COLUMNS_BESIDE + 1)
    ends = np.arctan2(*(outline[[0, -1]] - origin).T[::-1])
    beside = np.concatenate([ends[0] - steps, ends[1] + steps])
    if horizon.view is not None:
        right, left = horizon.view
        beside = beside[wrap_angle(beside - right) <= wrap_angle(left - right)]
    reach_beside = np.array([_reach_towards(azimuth, horizon) for azimuth in beside])
    kinds = np.where(np.isfinite(reach_beside), PASSED, EMPTY)
    azimuths, reach = np.append(azimuths, beside), np.append(reach, reach_beside)
    count = len(reach)
    return BodyRays(
        np.tile([*origin, 1.0], (count, 1)),
        np.column_stack([np.cos(azimuths), np.sin(azimuths)]),
        np.zeros(count),
        reach,
        np.append(np.full(len(offsets), HIT), kinds).astype(np.int64),
        np.full(count, noise_m),
        np.zeros(count),
        np.zeros(count),
    )


def _reach_towards(azimuth: float, horizon: Horizon) -> float:
    """Return the range of the nearest return in the column of a direction, inf without one."""
    off = np.abs(wrap_angle(horizon.azimuths - azimuth))
    if not len(off) or off.min() >= 0.6 * horizon.step:
        return np.inf
    return float(horizon.ranges[off.argmin()])


def _noise(reach: np.ndarray) -> float:
    """Return the standard deviation, metres, of the noise of (M,) ranges along an outline.

    It is estimated from the offset of each range from the mean of its two neighbours.
    """
    if len(reach) < 3:
        return NOISE_M[1]
    bends = np.abs(reach[1:-1] - (reach[:-2] + reach[2:]) / 2)
    return float(np.clip(np.median(bends) / 0.6745 / math.sqrt(1.5), *NOISE_M))


def _kind(vehicle: Vehicle) -> Body:
    """Return the body of the vehicle's category that is nearest to it in length."""
    same = (body for body in BODIES if body.category == vehicle.category)
    return min(same, key=lambda body: abs(body.length[0] - vehicle.size[0]))


@cache
def _model(body: Body) -> BodyModel:
    sections = (BodySection(0.0, 2.0),)
    return BodyModel(SizePrior(*body.length), SizePrior(*body.width), sections=sections)
