"""How far away things in an image are, from their height and from where they stand."""

from __future__ import annotations

import numpy as np

from roadscope.core.projection import Projection
from roadscope.fusion.sizes import SPREAD, USUAL_M

EDGE_PX = 2.0
"""Standard deviation of an edge of a box, beside a share of its size."""
EDGE_SHARE = 0.04
FARTHEST_M = 150.0
BORDER_PX = 2.0


def depths_of(
    boxes: np.ndarray, categories: np.ndarray, projection: Projection
) -> tuple[np.ndarray, np.ndarray]:
    """Return (N,) log depths, metres along the optical axis, and their standard deviations.

    Two readings are joined by their variances: the height in pixels against the usual height of
    the category, and the ground z = 0 under the lower edge. A box that touches the upper or the
    lower edge of the image is cut, and its height says little; at the lower edge it has no foot.
    """
    tall = np.maximum(boxes[:, 3] - boxes[:, 1], 1.0)
    edge = np.hypot(EDGE_PX, EDGE_SHARE * tall)
    focal = _focal(projection)
    by_height = np.log(focal * USUAL_M[categories, 2] / tall)
    sd_height = np.hypot(SPREAD[categories], 1.5 * edge / tall)
    cut_top = boxes[:, 1] <= BORDER_PX
    cut_foot = boxes[:, 3] >= projection.height - BORDER_PX
    sd_height = np.where(cut_top | cut_foot, 1.0, sd_height)
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    ground = ground_depths(np.column_stack([middles, boxes[:, 3]]), projection)
    beyond = ground_depths(np.column_stack([middles, boxes[:, 3] - edge]), projection)
    sd_ground = np.maximum(np.log(beyond / ground), 0.02)
    sd_ground = np.where(cut_foot | (ground >= FARTHEST_M), 3.0, sd_ground)
    weights = np.stack([sd_height**-2, sd_ground**-2])
    logs = (weights * np.stack([by_height, np.log(ground)])).sum(axis=0) / weights.sum(axis=0)
    return logs, 1 / np.sqrt(weights.sum(axis=0))


def ground_depths(pixels: np.ndarray, projection: Projection) -> np.ndarray:
    """(N,) depths of the ground behind (N, 2) pixels, 150 m at and above the horizon."""
    plane = np.linalg.inv(projection.matrix[:, [0, 1, 3]])
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ plane.T
    # The third entry is the reciprocal of the depth.
    depths: np.ndarray = 1 / np.maximum(rays[:, 2], 1 / FARTHEST_M)
    return depths


def places_at(pixels: np.ndarray, depths: np.ndarray, projection: Projection) -> np.ndarray:
    """(N, 3) points of the ego frame behind (N, 2) pixels at (N,) depths."""
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))]) * depths[:, None]
    inverse = np.linalg.inv(projection.matrix[:, :3])
    points: np.ndarray = (homogeneous - projection.matrix[:, 3]) @ inverse.T
    return points


def _focal(projection: Projection) -> float:
    """Focal length along rows, pixels."""
    return float(np.linalg.norm(np.cross(projection.matrix[1, :3], projection.matrix[2, :3])))
