"""Intersection over union of detections and truth, seen from above."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Truth
from roadscope.core.box_overlap import box_overlaps


def overlaps(found: Detections, truth: Truth) -> np.ndarray:
    """Return (N, M) intersection over union of boxes of one frame, seen from above, 0 to 1."""
    return box_overlaps(rectangles(found), rectangles(truth))


def rectangles(boxes: Detections | Truth) -> np.ndarray:
    """Return (N, 5) centre x, y, length, width (metres) and yaw (radians)."""
    return np.column_stack([boxes.centres[:, :2], boxes.sizes[:, :2], boxes.yaws])
