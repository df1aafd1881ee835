"""The pose that a fit returns, and checks of the points that it gets."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record

SPREAD_M = 200.0
"""Most that returns of one vehicle may lie apart along x or y; a search takes time in
proportion."""


@dataclass(frozen=True, slots=True, eq=False)
class VehiclePose(Record):
    """A vehicle's rectangle in the frame of the points that it was fitted to.

    x, y: centre of the rectangle, metres. yaw: direction of the long side, radians in [-pi, pi).
    length, width: metres.
    covariance: (3, 3) of x, y, yaw in metres and radians; None where the method gives none.
    score: of the method that made it, greater is better; comparable only within one method.
    """

    x: float
    y: float
    yaw: float
    length: float
    width: float
    covariance: np.ndarray | None = None
    score: float = 0.0

    def __post_init__(self) -> None:
        place = self.x, self.y, self.yaw, self.score
        require(all(map(isfinite, place)), self, "x, y, yaw, score", "finite numbers", place)
        sides = self.length, self.width
        fits = all(0 < side < np.inf for side in sides)
        require(fits, self, "length, width", "positive lengths in metres", sides)
        object.__setattr__(self, "yaw", float((self.yaw + pi) % (2 * pi) - pi))
        if self.covariance is not None:
            settle_arrays(self, covariance=(np.float64, (3, 3)))

    @property
    def centre(self) -> np.ndarray:
        """The centre of the rectangle, (2,) metres."""
        return np.array([self.x, self.y])

    @property
    def corners(self) -> np.ndarray:
        """(4, 2) metres, counter-clockwise from the rear right one (yaw taken as ahead)."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        half = 0.5 * np.array([self.length, self.width])
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        turn = np.array([[cos, sin], [-sin, cos]])
        return np.asarray((signs * half) @ turn + self.centre)


def axis_difference(yaw: np.ndarray | float, reference: np.ndarray | float) -> np.ndarray:
    """Return angles from a reference to the axis along yaw, radians in [-pi/2, pi/2).

    A rectangle has no front: yaw and yaw + pi are the same axis.
    """
    return (np.asarray(yaw) - reference + np.pi / 2) % np.pi - np.pi / 2


def pointing_away(angle: float, sight: np.ndarray) -> float:
    """Return the direction of an axis that points away along the line of sight (2,), radians."""
    is_away = np.cos(angle) * sight[0] + np.sin(angle) * sight[1] >= 0
    return float(angle if is_away else angle + np.pi)


def checked_points(points_xy: np.ndarray) -> np.ndarray:
    """Return points as (N, 2) float64; `ValueError` unless they are finite points in the plane."""
    points = np.ascontiguousarray(points_xy, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must be (N, 2) x and y in metres, got shape {points.shape}")
    if not len(points):
        raise ValueError("a pose needs at least 1 point, got 0")
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise ValueError(f"points must be finite, got {points[row]} in row {row}")
    return points


def check_spread(points_xy: np.ndarray) -> None:
    """Raise `ValueError` for returns (N, 2), metres, farther apart than any vehicle is long."""
    spread = float(np.ptp(points_xy, axis=0).max())
    if spread > SPREAD_M:
        raise ValueError(
            f"returns of one vehicle must lie within {SPREAD_M:g} m, got {spread:.4g} m between two"
        )


def checked_origin(origin: np.ndarray) -> np.ndarray:
    """Return the sensor's position as (2,) float64; `ValueError` unless it is finite x and y."""
    place = np.ascontiguousarray(origin, dtype=np.float64)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise ValueError(f"origin must be finite x and y of the sensor in metres, got {origin!r}")
    return place
