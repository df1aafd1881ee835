"""Which LiDAR box and which camera box show the same target, one to one."""

from __future__ import annotations

import numpy as np

from roadscope.fusion.assembly import Views
from roadscope.fusion.overlap import ious


def matched(views: Views, least_iou: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of LiDAR and camera, (M,) each, that maximise the sum of overlaps."""
    from scipy.optimize import linear_sum_assignment

    overlaps = ious(views.lidar_boxes, views.camera.boxes)
    overlaps[~views.in_image] = 0.0
    good = overlaps >= least_iou
    rows, columns = linear_sum_assignment(np.where(good, -overlaps - 1.0, 0.0))
    kept = good[rows, columns]
    return rows[kept], columns[kept]


def leftovers(count: int, taken: np.ndarray) -> np.ndarray:
    """Rows below count that are not taken."""
    return np.setdiff1d(np.arange(count), taken)
