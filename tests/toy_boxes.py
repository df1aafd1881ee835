"""Small truths, detections and tracks made by hand."""

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState, Truth


def truth(positions, *, ids=None, returns=100, stamp_s=0.0, velocities=None, **changes) -> Truth:
    xy = np.asarray(positions, float).reshape(-1, 2)
    n = len(xy)
    fields = {
        "ids": np.arange(n) if ids is None else np.asarray(ids),
        "categories": np.zeros(n, int),
        "centres": np.column_stack([xy, np.full(n, 0.75)]),
        "sizes": np.tile([4.5, 1.8, 1.5], (n, 1)),
        "yaws": np.zeros(n),
        "velocities": np.zeros((n, 2)) if velocities is None else velocities,
        "lidar_returns": np.broadcast_to(np.asarray(returns), n),
        "visible_pixels": np.zeros(n, int),
        "occluded_fraction": np.zeros(n),
        "world_from_ego": Pose.identity(),
        "stamp_s": stamp_s,
        "sources": np.empty(0, int),
    }
    return Truth(**(fields | changes))


def detections(positions, *, scores=None, stamp_s=0.0, yaws=0.0, sizes=(4.5, 1.8, 1.5)):
    xy = np.asarray(positions, float).reshape(-1, 2)
    n = len(xy)
    return Detections(
        np.column_stack([xy, np.full(n, 0.75)]),
        np.tile(sizes, (n, 1)),
        np.broadcast_to(np.asarray(yaws, float), n),
        np.zeros(n, int),
        np.ones(n) if scores is None else scores,
        "world",
        stamp_s,
    )


def tracks(
    positions, ids, *, stamp_s=0.0, velocities=None, state=TrackState.CONFIRMED, frame="world"
):
    xy = np.asarray(positions, float).reshape(-1, 2)
    n = len(xy)
    return Tracks(
        np.asarray(ids, int).reshape(-1),
        np.column_stack([xy, np.full(n, 0.75)]),
        np.tile([4.5, 1.8, 1.5], (n, 1)),
        np.zeros(n),
        np.zeros((n, 2)) if velocities is None else velocities,
        np.tile(np.eye(4), (n, 1, 1)),
        np.zeros(n, int),
        np.ones(n),
        np.full(n, state),
        frame,
        stamp_s,
    )
