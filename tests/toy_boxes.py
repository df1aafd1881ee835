"""Small truths, detections and tracks made by hand."""

from dataclasses import replace

import numpy as np

from roadscope.core import Category, Detections, ImageDetections, Pose, Tracks, TrackState, Truth

CAR_SIZE = (4.5, 1.8, 1.5)


def _centres(positions) -> np.ndarray:
    """Return (N, 3) centres: as given, or those of cars at (N, 2) places on the ground."""
    places = np.asarray(positions, float)
    if places.ndim == 2 and places.shape[1] == 3:
        return places
    places = places.reshape(-1, 2)
    return np.column_stack([places, np.full(len(places), CAR_SIZE[2] / 2)])


def truth(positions, *, ids=None, returns=100, stamp_s=0.0, velocities=None, **changes) -> Truth:
    """Return cars at (N, 2) places on the ground, or at (N, 3) centres. changes: other fields."""
    centres = _centres(positions)
    n = len(centres)
    fields = {
        "ids": np.arange(n) if ids is None else np.asarray(ids),
        "categories": np.zeros(n, int),
        "centres": centres,
        "sizes": np.tile(CAR_SIZE, (n, 1)),
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


def detections(
    positions,
    *,
    sizes=CAR_SIZE,
    yaws=0.0,
    categories=Category.CAR,
    scores=1.0,
    frame="world",
    stamp_s=0.0,
) -> Detections:
    """Return boxes at (N, 2) places on the ground, or at (N, 3) centres."""
    centres = _centres(positions)
    n = len(centres)
    return Detections(
        centres,
        np.broadcast_to(sizes, (n, 3)),
        np.broadcast_to(yaws, n),
        np.broadcast_to(categories, n),
        np.broadcast_to(scores, n),
        frame,
        stamp_s,
    )


def tracks(positions, ids, *, velocities=None, state=TrackState.CONFIRMED, **boxes) -> Tracks:
    """Return tracks of boxes. boxes: what `detections` takes."""
    made = Tracks.of(detections(positions, **boxes), np.asarray(ids, int).reshape(-1))
    return replace(
        made,
        velocities=made.velocities if velocities is None else velocities,
        states=np.broadcast_to(state, len(made)),
    )


def detections_of(truth: Truth, *, off_m=0.0, scores=1.0) -> Detections:
    """Return all objects of a truth as detections in the world frame, shifted along x."""
    return Detections(
        truth.centres + np.array([off_m, 0, 0]),
        truth.sizes,
        truth.yaws,
        truth.categories,
        np.broadcast_to(scores, len(truth)),
        "world",
        truth.stamp_s,
    )


def image_detections(boxes, *, categories=Category.CAR, scores=0.9, stamp_s=0.0) -> ImageDetections:
    """Return detections of (N, 4) boxes in pixels."""
    boxes = np.asarray(boxes, float).reshape(-1, 4)
    n = len(boxes)
    return ImageDetections(
        boxes, np.broadcast_to(categories, n), np.broadcast_to(scores, n), stamp_s
    )
