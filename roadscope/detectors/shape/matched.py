"""The matched filter of Zhang 2017 as a shape: heading and place from all returns of a cluster."""

from __future__ import annotations

import math
from functools import partial

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.pose.matched_filter import fit_single
from roadscope.detectors.shape.bodies import BOX_SHAPED
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import bodies_in, completed, shown_by
from roadscope.detectors.shape.l_shape import hull_heading
from roadscope.detectors.shape.recognition import Vehicle

LEAST = 8
"""With fewer returns the filter is no better than the minimum-area rectangle."""
STEP_DEG = 2.0
"""Step of headings, twice that of `fit_single`: a parabola through the scores gives the heading
between two steps."""


def vehicles_by_matched_filter(
    cluster: Cluster, horizon: Horizon, *, sigma_m: float = 0.04
) -> list[Vehicle]:
    """Return the road user whose rectangle matches a cluster's returns best.

    sigma_m: standard deviation of the template's smoothed edges, metres; twice the range noise of
        the HDL-32E.
    The paper knows the size of the car. Here it is the size of the body that completes the
    cluster's minimum-area rectangle.
    """
    return bodies_in(cluster, horizon, partial(_filtered, sigma_m=sigma_m))


def _filtered(cluster: Cluster, horizon: Horizon, *, sigma_m: float) -> Vehicle | None:
    shown = shown_by(cluster, horizon)
    (first,) = completed(shown, [hull_heading(cluster.points)])
    if first is None or first.category not in BOX_SHAPED or len(cluster.points) < LEAST:
        return first
    length, width, _ = first.size
    pose = fit_single(
        cluster.points[:, :2],
        cluster.origin,
        length_m=max(length, width),
        width_m=min(length, width),
        sigma_m=sigma_m,
        # Bins half as wide, as in the paper, take 1.5 times as long and are not more accurate.
        bin_m=sigma_m,
        step_deg=STEP_DEG,
    )
    (vehicle,) = completed(shown, [pose.yaw])
    if vehicle is None:
        return None
    return Vehicle(
        (pose.x, pose.y),
        (pose.length, pose.width, vehicle.size[2]),
        math.atan(math.tan(pose.yaw)),
        first.category,
        vehicle.residual_m,
        vehicle.points,
        vehicle.fit,
    )
