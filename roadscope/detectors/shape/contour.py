"""The outline that a cluster shows to the sensor."""

from __future__ import annotations

import numpy as np

from roadscope.core import wrap_angle
from roadscope.detectors.cloud import Cloud

DEPTH_M = 0.6
"""How far behind the nearest return of a column the same face may still be: three standard
deviations of the LUX's range noise to either side."""


def contours(cloud: Cloud, labels: np.ndarray) -> list[np.ndarray]:
    """Return the outline of each cluster, (M, 2) points in order of azimuth.

    The paper's points are (x, y) in the order of the scan and it does not say how the four
    layers are joined. Reading taken: a column gives one point, at the median range of its
    returns of the cluster that lie on the face nearest to the sensor; what is seen over it, a
    windscreen or a roof, is no part of the outline.
    """
    member = np.flatnonzero(labels >= 0)
    if not len(member):
        return []
    ranges = cloud.ranges[member]
    order = np.lexsort((ranges, cloud.column[member], labels[member]))
    member, ranges = member[order], ranges[order]
    keys = np.stack([labels[member], cloud.column[member]])
    starts = np.flatnonzero((np.diff(keys, axis=1, prepend=-1) != 0).any(axis=0))
    lengths = np.diff(starts, append=len(member))
    face = ranges <= np.repeat(ranges[starts], lengths) + DEPTH_M
    counts = np.add.reduceat(face.astype(np.int64), starts)
    # Rows are sorted by range within a column: the face comes first, its median in its middle.
    lower, upper = member[starts + (counts - 1) // 2], member[starts + counts // 2]
    points = (cloud.points[lower, :2] + cloud.points[upper, :2]) / 2
    ends = np.flatnonzero(np.diff(labels[member[starts]])) + 1
    return [_by_azimuth(outline, cloud.origin) for outline in np.split(points, ends)]


def _by_azimuth(points: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Sort by azimuth seen from the origin, counted from the middle of the points."""
    x, y = (points - origin).T
    middle = np.arctan2(y.mean(), x.mean())
    azimuths = wrap_angle(np.arctan2(y, x) - middle)
    ordered: np.ndarray = points[np.lexsort((y, x, azimuths))]
    return ordered
