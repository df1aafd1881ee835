"""The whole of a body of which a rectangle's heading and the faces turned to the sensor are known.

Lines of sight say where a face ends and where it may go on unseen; what road users measure says
how far. Each kind of body is weighed by how well what is seen fits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.bodies import BODIES, LONGEST_M, WIDEST_M, body_table
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion_kernels import (
    Seen,
    diagonal,
    least_bodies,
    whole_bodies,
)
from roadscope.detectors.shape.recognition import Vehicle

MIN_POINTS = 3
LEAST_M = 0.25
"""Least diagonal of what is seen: a thin post is nobody."""
FIT_MIN = -18.0
"""Least log likelihood of the best kind of body; far below that of any that was seen."""
Shown = tuple[Seen, tuple[tuple[bool, bool], float]]
"""What kernels ask of a cluster, and of what is hidden about it."""
_table = cache(body_table)


def is_body_sized(cluster: Cluster) -> bool:
    """Whether a cluster has enough returns and may be a road user by its extent."""
    if len(cluster.points) < MIN_POINTS:
        return False
    return bool(LEAST_M <= diagonal(cluster.points) <= LONGEST_M + WIDEST_M)


def completions(cluster: Cluster, yaws: Sequence[float], horizon: Horizon) -> list[Vehicle | None]:
    """Return the road user that shows a cluster for each heading, None where it is too large.

    yaws: radians, along either side of the rectangle.
    """
    return whole_ones(shown(cluster, horizon), yaws)


def least_rectangle(cluster: Cluster, horizon: Horizon) -> Vehicle | None:
    """Return what `completions` does for the heading of a cluster's minimum-area rectangle."""
    return least_one(shown(cluster, horizon))


def whole_ones(seen: Shown, yaws: Sequence[float]) -> list[Vehicle | None]:
    """Return what completes what is shown, for each of several headings."""
    rows = whole_bodies(*seen, np.array(yaws), _table())
    return [_vehicle(row, len(seen[0].outline)) for row in rows.tolist()]


def least_one(seen: Shown) -> Vehicle | None:
    """Return what completes what is shown, for the heading of its minimum-area rectangle."""
    (row,) = least_bodies(*seen, _table()).tolist()
    return _vehicle(row, len(seen[0].outline))


def shown(cluster: Cluster, horizon: Horizon) -> Shown:
    """Return what a cluster shows, and what is hidden about it."""
    seen = Seen(cluster.outline, cluster.points, cluster.ring, cluster.origin)
    return seen, (horizon.hides(cluster.outline), horizon.step)


def _vehicle(row: list[float], points: int) -> Vehicle | None:
    """Return the vehicle that a row of `whole_bodies` describes, None for none that fits."""
    body, x, y, length, width, height, yaw, residual_m, fit = row
    if body < 0 or fit < FIT_MIN:
        return None
    category = BODIES[int(body)].category
    return Vehicle((x, y), (length, width, height), yaw, category, residual_m, points, fit)
