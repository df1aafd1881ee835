"""The least rectangle around a cluster."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import complete
from roadscope.detectors.shape.heading_kernels import hull_heading
from roadscope.detectors.shape.parts import bodies_in
from roadscope.detectors.shape.recognition import Vehicle


def vehicles_by_rectangle(cluster: Cluster, horizon: Horizon) -> list[Vehicle]:
    """Return the road user whose footprint is turned like a cluster's minimum-area rectangle."""
    return bodies_in(cluster, horizon, least_rectangle)


def least_rectangle(cluster: Cluster, horizon: Horizon) -> Vehicle | None:
    """Return the one road user that a cluster's minimum-area rectangle shows, if any."""
    x, y = cluster.points[:, 0], cluster.points[:, 1]
    return complete(cluster, hull_heading(cluster.points[np.lexsort((y, x)), :2]), horizon)
