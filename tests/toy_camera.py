"""A camera that looks ahead along x of the ego frame, for tests."""

import numpy as np

from roadscope.core import Pose, Projection

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of the camera in the ego frame."""


def looking_ahead(x_m: float = 0.0, height_m: float = 1.4, focal_px: float = 500.0) -> Projection:
    """Return the projection of a camera of 640 x 480 pixels at a place of the ego."""
    intrinsics = np.array([[focal_px, 0, 320], [0, focal_px, 240], [0, 0, 1]])
    pose = Pose.from_parts(OPTICAL, np.array([x_m, 0.0, height_m]))
    return Projection.of(intrinsics, pose, 640, 480)


LOOK = looking_ahead()
