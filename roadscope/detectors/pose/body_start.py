"""First guesses of a body's pose from its returns, one for each way it may stand."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.pose.body_model import BodyModel

ANGLES = np.radians(np.arange(0.0, 90.0, 3.0))
CLOSE_M = 0.2
"""Distance from a side beyond which a return says nothing of it."""
MOST = 64
"""Returns looked at."""


def starts(points: np.ndarray, origin: np.ndarray, model: BodyModel) -> list[np.ndarray]:
    """Return x, y, yaw (3,) for the four headings along the sides of an initial rectangle."""
    points = points[:: -(-len(points) // MOST)]
    first = _direction(points, origin)
    return [_placed(points, origin, model, first + turn * np.pi / 2) for turn in range(4)]


def _direction(points: np.ndarray, origin: np.ndarray) -> float:
    """Return the angle at which the sides next to the sensor are nearest to the returns."""
    if len(points) < 3:
        x, y = points.mean(axis=0) - origin
        return float(np.arctan2(y, x))
    axes = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    across = np.stack([-axes[1], axes[0]])
    off = np.full((len(points), len(ANGLES)), CLOSE_M)
    for axis in (axes, across):
        along = points @ axis
        low, high = along.min(axis=0), along.max(axis=0)
        ahead = (origin @ axis) > 0.5 * (low + high)
        off = np.minimum(off, np.where(ahead, high - along, along - low))
    return float(ANGLES[np.argmin(off.sum(axis=0))])


def _placed(points: np.ndarray, origin: np.ndarray, model: BodyModel, yaw: float) -> np.ndarray:
    axis = np.array([np.cos(yaw), np.sin(yaw)])
    centre = np.zeros(2)
    for direction, extent in ((axis, model.length_m[0]), (axis[::-1] * (-1, 1), model.width_m[0])):
        along, sensor = points @ direction, origin @ direction
        low, high = along.min(), along.max()
        middle = 0.5 * (low + high)
        if sensor > high:
            middle = high - extent / 2
        elif sensor < low:
            middle = low + extent / 2
        centre += middle * direction
    return np.array([*centre, yaw])
