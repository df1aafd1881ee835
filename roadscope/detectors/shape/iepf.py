"""Line extraction by iterative end point fit, IEPF (Lu 2018, section 2.2)."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import diagonal
from roadscope.detectors.shape.recognition import (
    HALF_FACE_M,
    MIN_POINTS,
    Segment,
    Vehicle,
    recognise,
    split_ends,
)


def vehicles_by_lines(cluster: Cluster, horizon: Horizon, *, split_m: float = 0.3) -> list[Vehicle]:
    """Return the vehicles whose faces are the lines of a cluster's outline (Lu 2018, 2.2)."""
    outline = cluster.outline
    # No part of it is larger: most clusters, drops of fog say, need no lines.
    if len(outline) < MIN_POINTS or diagonal(outline) < HALF_FACE_M:
        return []
    return recognise(outline, split_ends(outline, split_m), horizon)


def fit_iepf(points: np.ndarray, *, split_m: float = 0.3) -> list[Segment]:
    """Split an outline of (N, 2) points, metres, in order into segments.

    The line through the first and the last point represents all points when none lies farther
    from it than `split_m`; otherwise it is split at the farthest, which both parts then share.
    0.3 m is three times the range noise of the LUX, so that noise alone splits nothing. Eq. 3-4
    write the line as kx - y + b = 0, which has no vertical lines; the cross product gives the
    same distance for every direction.
    """
    ends = split_ends(np.asarray(points, np.float64), split_m).tolist()
    return [Segment(points[first : last + 1]) for first, last in ends]
