"""The least rectangle around a cluster."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import complete, is_body_sized
from roadscope.detectors.shape.heading_kernels import hull_heading
from roadscope.detectors.shape.recognition import Vehicle


def vehicles_by_rectangle(cluster: Cluster, horizon: Horizon) -> list[Vehicle]:
    """Return the road user whose footprint is turned like a cluster's minimum-area rectangle."""
    if not is_body_sized(cluster):
        return []
    x, y = cluster.points[:, 0], cluster.points[:, 1]
    heading = hull_heading(cluster.points[np.lexsort((y, x)), :2])
    vehicle = complete(cluster, heading, horizon)
    return [] if vehicle is None else [vehicle]
