"""The least rectangle around a cluster."""

from __future__ import annotations

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import least_rectangle
from roadscope.detectors.shape.parts import bodies_in
from roadscope.detectors.shape.recognition import Vehicle


def vehicles_by_rectangle(cluster: Cluster, horizon: Horizon) -> list[Vehicle]:
    """Return the road user whose footprint is turned like a cluster's minimum-area rectangle."""
    return bodies_in(cluster, horizon, least_rectangle)
