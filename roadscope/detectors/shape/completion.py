"""The whole of a body of which a rectangle's heading and the faces turned to the sensor are known.

Lines of sight say where a face ends and where it may go on unseen; what road users measure says
how far. Each kind of body is weighed by how well what is seen fits it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.bodies import BODIES, LONGEST_M, WIDEST_M, Body, body_table
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion_kernels import (
    CLIPPED_M,
    LEVELS,
    SLACK_M,
    centre_along,
    seen_sides,
    whole_body,
)
from roadscope.detectors.shape.recognition import Vehicle

MIN_POINTS = 3
LEAST_M = 0.25
"""Least diagonal of what is seen: a thin post is nobody."""
FIT_MIN = -18.0
"""Least log likelihood of the best kind of body; far below that of any that was seen."""
_table = cache(body_table)


def is_body_sized(cluster: Cluster) -> bool:
    """Whether a cluster has enough returns and may be a road user by its extent."""
    if len(cluster.points) < MIN_POINTS:
        return False
    extent = np.ptp(cluster.points[:, :2], axis=0)
    return bool(LEAST_M <= np.hypot(extent[0], extent[1]) <= LONGEST_M + WIDEST_M)


def complete(cluster: Cluster, yaw: float, horizon: Horizon) -> Vehicle | None:
    """Return the road user that shows a cluster, None where it is too large for any.

    yaw: radians, along either side of the rectangle.
    """
    outline = cluster.outline
    hidden = np.array([horizon.hides_beyond(outline[0], -1), horizon.hides_beyond(outline[-1], 1)])
    sides, is_open, residual = seen_sides(outline, cluster.points, yaw, cluster.origin, hidden)
    seen = sides[:, 1] - sides[:, 0]
    if not sides[:, 2].any() or seen.min() > WIDEST_M or seen.max() > LONGEST_M:
        return None
    heights = _heights(cluster)
    row, axis, fit, extents = whole_body(sides, is_open, horizon.step, heights, _table())
    if fit < FIT_MIN:
        return None
    u = centre_along(sides[0], is_open[0], extents[0])
    v = centre_along(sides[1], is_open[1], extents[1])
    cos, sin = float(np.cos(yaw)), float(np.sin(yaw))
    body = BODIES[row]
    size = float(extents[axis]), float(extents[1 - axis]), _height(body, heights)
    turned = np.arctan(np.tan(yaw + axis * np.pi / 2))
    centre = u * cos - v * sin, u * sin + v * cos
    return Vehicle(centre, size, float(turned), body.category, residual, len(outline), fit)


def _height(body: Body, heights: np.ndarray) -> float:
    """Height of a body in metres: the usual one, drawn to where its returns end if that is told."""
    (usual, spread), (top, gap) = body.height, heights
    if gap < 0:
        return max(usual, float(top))
    doubt = SLACK_M**2 + gap**2 / 12
    seen = (usual * doubt + (top + gap / 2) * spread**2) / (doubt + spread**2)
    return max(float(seen), float(top))


def _heights(cluster: Cluster) -> np.ndarray:
    """Highest return, and how far above it the body may end; -1 where that is not known."""
    heights = cluster.points[:, 2]
    top, levels = float(heights.max()), np.count_nonzero(np.bincount(cluster.ring))
    if levels < LEVELS or top > CLIPPED_M:
        return np.array([top, -1.0])
    return np.array([top, (top - float(heights.min())) / (levels - 1)])
