"""A rounded body fitted to a cluster's outline and to the sight past its ends, as a shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Category, wrap_angle
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.pose.body_descent import descend
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, PASSED, POSE, Rays
from roadscope.detectors.pose.body_model import BodyModel, Storey
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.shape.bodies import BODIES, Body
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.l_shape import vehicles_by_l_shape
from roadscope.detectors.shape.recognition import Vehicle

BRICKS = (Category.CAR, Category.VAN, Category.TRUCK, Category.BUS)
MOST = 32
"""Outline points looked at."""
BESIDE = 3
"""Columns looked at beyond either end of the outline."""
NOISE_M = (0.02, 0.15)
"""Least and greatest noise of an outline that is believed."""
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
    body = _kind(vehicle)
    model = BodyModel(body.length, body.width, storeys=(Storey(0.0, 2.0),))
    problem = still_problem(_rays(cluster, horizon), model, CHANCES)
    guesses = np.zeros((3, len(problem.free)))
    guesses[:2, :3] = starts(cluster.outline, cluster.origin, model)[:2]
    guesses[2, :3] = *vehicle.centre, vehicle.yaw
    best = descend(problem, guesses, SLACKS_M, around=0)
    vector = best.vectors[np.argmin(best.costs)]
    if not np.hypot(*(vector[:2] - vehicle.centre)) < MOVED_M:
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


def _rays(cluster: Cluster, horizon: Horizon) -> Rays:
    """Return the level rays to the outline and those that pass beside it."""
    outline = cluster.outline[:: -(-len(cluster.outline) // MOST)]
    offsets = outline - cluster.origin
    azimuths, reach = np.arctan2(offsets[:, 1], offsets[:, 0]), np.hypot(*offsets.T)
    beside, kinds, reaches = _beside(cluster, horizon)
    azimuth = np.concatenate([azimuths, beside])
    count = len(azimuth)
    origin = np.tile([*cluster.origin, 1.0], (count, 1))
    return Rays(
        origin,
        np.column_stack([np.cos(azimuth), np.sin(azimuth)]),
        np.zeros(count),
        np.concatenate([reach, reaches]),
        np.concatenate([np.full(len(reach), HIT), kinds]).astype(np.int64),
        np.full(count, _noise(reach)),
        np.zeros(count),
        np.zeros(count),
    )


def _beside(cluster: Cluster, horizon: Horizon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Azimuths, kinds and reaches of the rays that pass by either end of the outline.

    A ray that meets something nearer says nothing, for its reach ends there.
    """
    offsets = cluster.outline[[0, -1]] - cluster.origin
    ends = np.arctan2(offsets[:, 1], offsets[:, 0])
    steps = horizon.step * np.arange(1, BESIDE + 1)
    azimuths = np.concatenate([ends[0] - steps, ends[1] + steps])
    if horizon.view is not None:
        right, left = horizon.view
        azimuths = azimuths[wrap_angle(azimuths - right) <= wrap_angle(left - right)]
    if not len(horizon.azimuths):
        return azimuths, np.full(len(azimuths), EMPTY), np.full(len(azimuths), np.inf)
    off = np.abs(wrap_angle(horizon.azimuths[None] - azimuths[:, None]))
    nearest = off.argmin(axis=1)
    met = off[np.arange(len(azimuths)), nearest] < 0.6 * horizon.step
    reach = np.where(met, horizon.ranges[nearest], np.inf)
    return azimuths, np.where(met, PASSED, EMPTY), reach


def _noise(reach: np.ndarray) -> float:
    """Estimate the noise of ranges in order, from how far each is from its neighbours' mean."""
    if len(reach) < 3:
        return NOISE_M[1]
    bends = np.abs(reach[1:-1] - (reach[:-2] + reach[2:]) / 2)
    return float(np.clip(np.median(bends) / 0.6745 / np.sqrt(1.5), *NOISE_M))
