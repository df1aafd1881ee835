"""Line extraction by iterative end point fit, IEPF (Lu 2018, section 2.2)."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.recognition import Vehicle, recognise
from roadscope.detectors.shape.segment import Segment


def vehicles_by_lines(cluster: Cluster, horizon: Horizon, *, split_m: float = 0.3) -> list[Vehicle]:
    """Return the vehicles whose faces are the lines of a cluster's outline (Lu 2018, 2.2)."""
    return recognise(fit_iepf(cluster.outline, split_m=split_m), horizon)


def fit_iepf(points: np.ndarray, *, split_m: float = 0.3) -> list[Segment]:
    """Split an outline of (N, 2) points, metres, in order into segments.

    The line through the first and the last point represents all points when none lies farther
    from it than `split_m`; otherwise it is split at the farthest, which both parts then share.
    0.3 m is three times the range noise of the LUX, so that noise alone splits nothing.
    """
    pending, segments = [(0, len(points) - 1)] if len(points) else [], []
    while pending:
        first, last = pending.pop()
        between = points[first + 1 : last]
        distances = line_distances(between, points[first], points[last])
        if not len(between) or distances.max() <= split_m:
            segments.append(Segment(points[first : last + 1]))
            continue
        split = first + 1 + int(distances.argmax())
        pending += [(split, last), (first, split)]
    return segments


def line_distances(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distances of (N, 2) points from the line through two points, (N,) metres.

    Eq. 3-4 write the line as kx - y + b = 0, which has no vertical lines; the cross product
    gives the same distance for every direction. Two equal end points have no line, there it is
    the distance from the point.
    """
    (dx, dy), (x, y) = end - start, (points - start).T
    length = np.hypot(dx, dy)
    if length == 0:
        return np.asarray(np.hypot(x, y))
    return np.asarray(np.abs(dx * y - dy * x) / length)
