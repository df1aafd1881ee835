"""Search-based L-shape fitting (Zhang, Xu, Dong and Dolan 2017, "Efficient L-Shape Fitting")."""

from __future__ import annotations

from typing import Literal

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import complete, is_body_sized
from roadscope.detectors.shape.heading_kernels import AREA, CLOSENESS, VARIANCE, searched_heading
from roadscope.detectors.shape.recognition import Vehicle

Criterion = Literal["area", "closeness", "variance"]
CRITERIA: dict[Criterion, int] = {"area": AREA, "closeness": CLOSENESS, "variance": VARIANCE}
NEAR_M = 0.05
"""Points nearer to a side than this count as on it; the paper has 0.01 m, less than any noise."""
MOST = 96
"""Outline points that are looked at: more of them say nothing new of the heading."""


def vehicles_by_l_shape(
    cluster: Cluster, horizon: Horizon, *, criterion: Criterion = "closeness"
) -> list[Vehicle]:
    """Return the road user whose two faces the outline of a cluster shows best.

    criterion: what the rectangle's heading is chosen by: `area` (least), `closeness` of the
    points to the sides, or `variance` (least) of their distances from the nearer side.
    """
    if not is_body_sized(cluster):
        return []
    outline = cluster.outline[:: -(-len(cluster.outline) // MOST)]
    vehicle = complete(cluster, searched_heading(outline, CRITERIA[criterion], NEAR_M), horizon)
    return [] if vehicle is None else [vehicle]
