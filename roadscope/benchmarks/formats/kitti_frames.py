"""KITTI's camera frame and ours: one file converts, and nothing else in the house knows.

Our ego frame of recorded data is KITTI's rectified camera turned to ISO 8855 and nothing more:
x = z, y = -x, z = -y, the origin in the camera, not on the rear axle. The files say nothing of
axles, and so the conversion loses nothing.
"""

from __future__ import annotations

import numpy as np

from roadscope.core import Pose, wrap_angle

EGO_FROM_CAMERA = Pose(
    np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
)
CAMERA_FROM_EGO = EGO_FROM_CAMERA.inverse()
NEAR_M = 0.1
"""What is nearer to the image plane is cut off before it is projected."""
EDGES = np.array(
    [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)], np.int64
)
"""(12, 2) corners, numbered by three bits, that a box's edges join."""


def centres_from_bottoms(bottoms: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Turn (N, 3) centres of bottom faces, camera frame, into box centres, ego frame."""
    raised = np.array(bottoms, np.float64).reshape(-1, 3)
    raised[:, 1] -= sizes[:, 2] / 2
    return EGO_FROM_CAMERA.apply(raised)


def bottoms_from_centres(centres: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Undo `centres_from_bottoms`."""
    lowered = CAMERA_FROM_EGO.apply(centres)
    lowered[:, 1] += sizes[:, 2] / 2
    return lowered


def yaws_from_rotations(rotations_y: np.ndarray) -> np.ndarray:
    """Turn angles about the camera's y, 0 along x, into ISO 8855 yaws."""
    return wrap_angle(-np.asarray(rotations_y) - np.pi / 2)


def rotations_from_yaws(yaws: np.ndarray) -> np.ndarray:
    """Undo `yaws_from_rotations`, up to whole turns."""
    return wrap_angle(-np.asarray(yaws) - np.pi / 2)


def alphas(bottoms: np.ndarray, rotations_y: np.ndarray) -> np.ndarray:
    """Return observation angles: rotations about y less the direction that an object is in."""
    return wrap_angle(rotations_y - np.arctan2(bottoms[:, 0], bottoms[:, 2]))


def corners(bottoms: np.ndarray, sizes: np.ndarray, rotations_y: np.ndarray) -> np.ndarray:
    """Return (N, 8, 3) corners, camera frame; bit 0 is the length's end, 1 the width's, 2 up."""
    bits = np.array([[(k >> b) & 1 for b in range(3)] for k in range(8)], np.float64)
    along = (bits[:, 0] - 0.5) * sizes[:, :1]
    across = (bits[:, 1] - 0.5) * sizes[:, 1:2]
    cosine, sine = np.cos(rotations_y)[:, None], np.sin(rotations_y)[:, None]
    x = bottoms[:, :1] + cosine * along + sine * across
    y = bottoms[:, 1:2] - bits[:, 2] * sizes[:, 2:]
    z = bottoms[:, 2:] - sine * along + cosine * across
    return np.stack([x, y, z], axis=-1)


def image_boxes(points: np.ndarray, projection: np.ndarray) -> np.ndarray:
    """Return (N, 4) left top right bottom in pixels around (N, 8, 3) corners, NaN behind.

    projection: (3, 4). A box that reaches behind the camera is cut at its near plane first.
    """
    ends = points[:, EDGES]
    near, far = ends[:, :, 0], ends[:, :, 1]
    depth = far[..., 2] - near[..., 2]
    share = np.divide(NEAR_M - near[..., 2], depth, out=np.full(depth.shape, -1.0),
                      where=np.abs(depth) > 1e-12)  # fmt: skip
    cut = near + share[..., None] * (far - near)
    every = np.concatenate([points, cut], axis=1)
    valid = np.concatenate([points[..., 2] >= NEAR_M, (share > 0) & (share < 1)], axis=1)
    flat = every @ projection[:, :3].T + projection[:, 3]
    pixels = flat[..., :2] / np.where(valid, flat[..., 2], 1.0)[..., None]
    lows = np.where(valid[..., None], pixels, np.inf).min(axis=1)
    highs = np.where(valid[..., None], pixels, -np.inf).max(axis=1)
    boxes = np.concatenate([lows, highs], axis=1)
    boxes[~valid.any(axis=1)] = np.nan
    return boxes


def clipped_boxes(
    points: np.ndarray, projection: np.ndarray, image_size: tuple[int, int]
) -> np.ndarray:
    """Return (N, 4) `image_boxes` within an image of (width, height) pixels, empty if outside."""
    width, height = image_size
    boxes = np.nan_to_num(image_boxes(points, projection), nan=0.0)
    last = np.array([width - 1, height - 1] * 2, np.float64)
    clipped: np.ndarray = np.clip(boxes, 0.0, last)
    return clipped
