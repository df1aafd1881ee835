"""First guesses of a body's pose from its returns, one for each way it may stand."""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_model import BodyModel

ANGLES = np.radians(np.arange(0.0, 90.0, 3.0))
CLOSE_M = 0.2
"""Distance from a side beyond which a return says nothing of it."""
MOST = 64
"""Returns looked at."""


def starts(
    points: np.ndarray, origin: np.ndarray, model: BodyModel, *, cut: bool = False
) -> np.ndarray:
    """Return x, y, yaw (4, 3) for the headings along the sides of an initial rectangle.

    points: (N, 2) metres, N at least 1. origin: (2,) metres, the sensor. cut: the sweep began or
    ended on the body, so that its near end may be missing; (16, 3) more have each end at one of
    the points' own.
    """
    length, width = model.length_m[0], model.width_m[0]
    guesses = np.asarray(along_sides(points, origin, length, width))
    if not cut:
        return guesses
    more = []
    for x, y, yaw in guesses:
        for turned, extent in ((yaw, length), (yaw + 0.5 * np.pi, width)):
            axis = np.array([np.cos(turned), np.sin(turned)])
            low, high = _reach(points, (axis[0], axis[1]))
            for middle in (low + 0.5 * extent, high - 0.5 * extent):
                moved = np.array([x, y]) + (middle - axis @ (x, y)) * axis
                more.append([*moved, yaw])
    return np.concatenate([guesses, more])


@compiled()
def along_sides(points: np.ndarray, origin: np.ndarray, length: float, width: float) -> np.ndarray:
    """Return what `starts` does, of a body's length and width in metres."""
    points = points[:: -(-len(points) // MOST)]
    out, first = np.empty((4, 3)), _direction(points, origin)
    for k in range(4):
        yaw = first + k * 0.5 * np.pi
        cos, sin = math.cos(yaw), math.sin(yaw)
        along = _middle(points, origin, (cos, sin), length)
        across = _middle(points, origin, (-sin, cos), width)
        out[k] = along * cos - across * sin, along * sin + across * cos, yaw
    return out


@compiled()
def _direction(points: np.ndarray, origin: np.ndarray) -> float:
    """Return the angle at which the sides next to the sensor are nearest to the returns."""
    if len(points) < 3:
        x, y = points[:, 0].mean() - origin[0], points[:, 1].mean() - origin[1]
        return math.atan2(y, x)
    off, best, least = np.empty(len(points)), 0.0, np.inf
    for angle in ANGLES:
        cos, sin = math.cos(angle), math.sin(angle)
        off[:] = CLOSE_M
        _nearer(points, origin, (cos, sin), off)
        _nearer(points, origin, (-sin, cos), off)
        total = off.sum()
        if total < least:
            best, least = angle, total
    return best


@compiled(borrowing=True)
def _nearer(
    points: np.ndarray, origin: np.ndarray, axis: tuple[float, float], off: np.ndarray
) -> None:
    """Lower `off` (N,) to the distances from the side across an axis that faces the sensor."""
    low, high = _reach(points, axis)
    ahead = origin[0] * axis[0] + origin[1] * axis[1] > 0.5 * (low + high)
    for i in range(len(points)):
        along = points[i, 0] * axis[0] + points[i, 1] * axis[1]
        off[i] = min(off[i], high - along if ahead else along - low)


@compiled(borrowing=True)
def _reach(points: np.ndarray, axis: tuple[float, float]) -> tuple[float, float]:
    low, high = np.inf, -np.inf
    for i in range(len(points)):
        along = points[i, 0] * axis[0] + points[i, 1] * axis[1]
        low, high = min(low, along), max(high, along)
    return low, high


@compiled(borrowing=True)
def _middle(
    points: np.ndarray, origin: np.ndarray, axis: tuple[float, float], extent: float
) -> float:
    """Return the middle of a body of this extent along an axis, its near side where points are."""
    low, high = _reach(points, axis)
    sensor = origin[0] * axis[0] + origin[1] * axis[1]
    if sensor > high:
        return high - 0.5 * extent
    if sensor < low:
        return low + 0.5 * extent
    return 0.5 * (low + high)
