"""LiDAR boxes projected into the image, and overlaps of boxes there."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections
from roadscope.core.projection import NEAR_M, Projection

_SLACK = 0.999
"""Share of `NEAR_M` from which on a point is in front of the camera: it allows for rounding."""
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_EDGES = np.array(
    [
        [a, b]
        for a in range(8)
        for b in range(a + 1, 8)
        if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1
    ]
)


def projected_boxes(lidar: Detections, projection: Projection) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 4) image boxes around projected boxes, and (N,) whether they lie in the image.

    Image boxes are pixels, left top right bottom, cut to the image, zeros where nothing of them
    lies in it. Boxes that reach behind the camera are cut at its near plane, edge by edge.

    lidar: detections in the ego frame.
    """
    cosine, sine = np.cos(lidar.yaws)[:, None], np.sin(lidar.yaws)[:, None]
    local = _CORNERS * lidar.sizes[:, None]
    corners = (
        np.stack(
            [
                local[..., 0] * cosine - local[..., 1] * sine,
                local[..., 0] * sine + local[..., 1] * cosine,
                local[..., 2],
            ],
            axis=-1,
        )
        + lidar.centres[:, None]
    )
    starts, ends = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    points = np.concatenate([corners, _at_near_plane(starts, ends, projection)], axis=1)
    pixels, depths = projection.project(points)
    in_front = (depths >= NEAR_M * _SLACK)[..., None]
    low = np.where(in_front, pixels, np.inf).min(axis=1, initial=np.inf)
    high = np.where(in_front, pixels, -np.inf).max(axis=1, initial=-np.inf)
    size = np.array([projection.width, projection.height], np.float64)
    low, high = np.clip(low, 0.0, size), np.clip(high, 0.0, size)
    in_image = (high > low).all(axis=1)
    return np.where(in_image[:, None], np.concatenate([low, high], axis=1), 0.0), in_image


def _at_near_plane(starts: np.ndarray, ends: np.ndarray, projection: Projection) -> np.ndarray:
    """Return (N, E, 3) points where edges cross the near plane; their starts where they do not."""
    _, first = projection.project(starts)
    _, last = projection.project(ends)
    crosses = (first < NEAR_M) != (last < NEAR_M)
    share = np.where(crosses, (NEAR_M - first) / np.where(crosses, last - first, 1.0), 0.0)
    points: np.ndarray = starts + share[..., None] * (ends - starts)
    return points


def intersections(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return (N, M) areas of the intersections of (N, 4) and (M, 4) boxes."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    common: np.ndarray = np.maximum(high - low, 0.0).prod(axis=-1)
    return common


def areas(boxes: np.ndarray) -> np.ndarray:
    """Return (N,) areas of (N, 4) boxes."""
    result: np.ndarray = np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0).prod(axis=-1)
    return result


def coverage(lidar: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Return (N, M) share of each camera box that a LiDAR box covers (Li 2021, 5.1)."""
    result: np.ndarray = intersections(lidar, camera) / np.maximum(areas(camera), 1e-9)
    return result


def ious(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of (N, 4) and (M, 4) boxes."""
    common = intersections(first, second)
    union = areas(first)[:, None] + areas(second)[None] - common
    result: np.ndarray = common / np.maximum(union, 1e-9)
    return result
