"""What a front LiDAR could see of scripted vehicles, by pure geometry of their boxes."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.script_motion import Motion

SENSOR_AHEAD_M = 5.0
"""Where the LUX sits ahead of the ego's rear axle, as in the rig `lux`."""
LEFT_EDGE = np.deg2rad(55.0)
"""Azimuth of the left end of the field of view, radians; the right end is its mirror image."""

Size = tuple[float, float, float]


def corners(motion: Motion, size: Size, ego: Motion, times: np.ndarray) -> np.ndarray:
    """Return the (T, 4, 2) corners of a body seen from the LiDAR; the ego drives along x."""
    length, width, _ = size
    vx, vy = motion.velocities(times).T
    yaw = np.arctan2(vy, vx)
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)[:, None]
    left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)[:, None]
    along = np.array([length, length, 0.0, 0.0])[:, None]
    across = np.array([-0.5, 0.5, 0.5, -0.5])[:, None] * width
    offset = motion.places(times) - ego.places(times) - np.array([SENSOR_AHEAD_M, 0.0])
    points: np.ndarray = offset[:, None] + along * ahead + across * left
    return points


def depth_in_view(motion: Motion, size: Size, ego: Motion, times: np.ndarray) -> np.ndarray:
    """(T,) metres by which a body on the left reaches over the left end of the field of view."""
    points = corners(motion, size, ego, times)
    over: np.ndarray = points[..., 0] * np.sin(LEFT_EDGE) - points[..., 1] * np.cos(LEFT_EDGE)
    deepest: np.ndarray = over.max(axis=1)
    return deepest


def azimuths(motion: Motion, size: Size, ego: Motion, times: np.ndarray) -> np.ndarray:
    """Return (T, 2) least and largest azimuth of a body ahead of the LiDAR, radians."""
    points = corners(motion, size, ego, times)
    angles = np.arctan2(points[..., 1], points[..., 0])
    return np.stack([angles.min(axis=1), angles.max(axis=1)], axis=-1)
