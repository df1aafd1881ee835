"""Clusters that hold more than one body, cut where their outline jumps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from roadscope.core import wrap_angle
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import is_body_sized
from roadscope.detectors.shape.recognition import Vehicle

JUMP_M = 0.6
"""Neighbouring outline points farther apart may lie on two bodies; more than the rounding of a
corner and range noise make of one."""
RAGGED_M = 0.3
"""Outlines farther from their faces (root mean square) are rather those of two bodies: three times
the range noise of the LUX."""
CUTS = 3
"""How often a cluster is cut in two and its parts again."""

Fit = Callable[[Cluster, Horizon], Vehicle | None]


def bodies_in(cluster: Cluster, horizon: Horizon, fit: Fit, *, cuts: int = CUTS) -> list[Vehicle]:
    """Return the one road user that a cluster shows, or those that its parts show.

    It is cut where it shows nobody, or somebody whose faces its outline does not follow.
    """
    vehicle = fit(cluster, horizon) if is_body_sized(cluster) else None
    if vehicle is not None and vehicle.residual_m <= RAGGED_M:
        return [vehicle]
    parts = cut(cluster) if cuts else []
    found = [body for part in parts for body in bodies_in(part, horizon, fit, cuts=cuts - 1)]
    return found if found or vehicle is None else [vehicle]


def cut(cluster: Cluster) -> list[Cluster]:
    """Return both sides of the widest jump of the outline, nothing where there is no jump."""
    steps = np.diff(cluster.outline, axis=0)
    gaps = np.hypot(steps[:, 0], steps[:, 1])
    if not len(gaps) or gaps.max() < JUMP_M:
        return []
    last = int(gaps.argmax())
    ahead = cluster.outline.mean(axis=0) - cluster.origin
    middle = np.arctan2(ahead[1], ahead[0])
    ends = _azimuths(cluster.outline[last : last + 2], cluster.origin, middle)
    left = _azimuths(cluster.points[:, :2], cluster.origin, middle) > ends.mean()
    return [
        Cluster(cluster.points[m], cluster.ring[m], cluster.column[m], outline, cluster.origin)
        for m, outline in (
            (~left, cluster.outline[: last + 1]),
            (left, cluster.outline[last + 1 :]),
        )
    ]


def _azimuths(points: np.ndarray, origin: np.ndarray, middle: float) -> np.ndarray:
    """Directions of (N, 2) points from the sensor, from the middle one on, radians."""
    x, y = (points - origin).T
    return np.asarray(wrap_angle(np.arctan2(y, x) - middle))
