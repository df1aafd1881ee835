"""Pose from RANSAC line and corner fit, the method that Zhang 2017 compares with."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from roadscope.core.arguments import check_positive
from roadscope.core.jit import compiled
from roadscope.core.sorting import stable_order
from roadscope.detectors.pose.estimate import (
    VehiclePose,
    checked_origin,
    checked_points,
    pointing_away,
)

LongSide = Literal["size", "main"]
CORNER_POINTS = 2
"""Least number of returns on a second face."""
APART_M = 1e-9
"""Two returns nearer to each other than this do not determine a line."""


def fit_ransac(
    points_xy: np.ndarray,
    origin: np.ndarray,
    rng: np.random.Generator,
    *,
    length_m: float,
    width_m: float,
    inlier_m: float = 0.06,
    trials: int = 100,
    long_side: LongSide = "size",
) -> VehiclePose:
    """Return the rectangle of known size at the line, or corner, with most inliers.

    points_xy: (N, 2) metres, returns of one vehicle, at least one. origin: (2,) metres, the sensor
    in the same frame. rng: draws the pairs. length_m, width_m: size of the vehicle. inlier_m:
    greatest distance of an inlier from a face, three times the range noise. trials: number of pairs
    of returns that are tried. yaw points away from the sensor. The score is the share of the
    returns on the two faces.

    Zhang 2017 refers to Morris 2008 and gives no numbers. Here the line with most inliers is one
    face. The other face is the perpendicular line with most inliers behind one of its ends. With
    long_side "size" the first face is the side whose size is nearest to its extent. With "main" it
    is always the long side, as the paper's introduction says; that turns vehicles seen from behind
    by 90 deg.
    """
    points, place = checked_points(points_xy), checked_origin(origin)
    check_positive(length_m=length_m, width_m=width_m, inlier_m=inlier_m, trials=trials)
    if long_side not in ("size", "main"):
        raise ValueError(f"no long_side {long_side!r}; known: size, main")
    points = by_range(points, place)
    pairs = rng.integers(0, len(points), (2, int(trials)))
    sides = Sides(float(length_m), float(width_m), long_side == "main")
    x, y, angle, share = fitted_rectangle(points, place, pairs, float(inlier_m), sides)
    yaw = pointing_away(angle, points.mean(axis=0) - place)
    return VehiclePose(x, y, yaw, length_m, width_m, score=share)


# --------------------------------------------------------------------------------------------------
# Kernels: the line and the corner with most inliers among the returns of a vehicle.


class Sides(NamedTuple):
    """Length and width of the body, metres. flank: whether the first face must be the long side."""

    length: float
    width: float
    flank: bool


@compiled()
def fitted_rectangle(
    points: np.ndarray, origin: np.ndarray, pairs: np.ndarray, inlier_m: float, sides: Sides
) -> tuple[float, float, float, float]:
    """Return x, y of the centre, direction of the long side in radians, and share of inliers.

    points: (N, 2) metres, sorted by `by_range`. origin: (2,) metres, the sensor. pairs: (2, T) rows
    of points, through each two of which a line is tried.
    """
    mean = _mean(points)
    axis, inliers = best_line(points, origin, pairs, inlier_m)
    axis, corner, second = with_corner(points, axis, inliers, origin, inlier_m)
    normal = np.array([-axis[1], axis[0]])
    first = points[inliers]
    depth = float(np.median(_along(first, mean, normal)))
    along = _along(first, mean, axis)
    low, high = along.min(), along.max()
    visible = high - low
    is_flank = sides.flank or abs(visible - sides.length) < abs(visible - sides.width)
    extent, other = (sides.length, sides.width) if is_flank else (sides.width, sides.length)
    if np.isnan(corner):
        middle = (low + high) / 2
    else:
        middle = corner + math.copysign(extent / 2, np.median(along) - corner)
    sight = (mean[0] - origin[0]) * normal[0] + (mean[1] - origin[1]) * normal[1]
    across = depth + math.copysign(other / 2, sight)
    x = mean[0] + middle * axis[0] + across * normal[0]
    y = mean[1] + middle * axis[1] + across * normal[1]
    heading = axis if is_flank else normal
    return x, y, math.atan2(heading[1], heading[0]), (inliers | second).sum() / len(points)


@compiled()
def by_range(points: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the points by range, then side, so that pairs do not depend on their order.

    points: (N, 2) and origin: (2,), the sensor, metres.
    """
    sights = points - origin
    middle = _mean(sights)
    # Rounded to micrometres, so that a rotated scene has the same order.
    sides = np.rint(1e6 * (middle[0] * sights[:, 1] - middle[1] * sights[:, 0]))
    ranges = np.rint(1e6 * np.hypot(sights[:, 0], sights[:, 1]))
    order = stable_order(sides)
    return np.asarray(points[order[stable_order(ranges[order])]])


@compiled()
def best_line(
    points: np.ndarray, origin: np.ndarray, pairs: np.ndarray, inlier_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (2,) direction of the line with most inliers, and the (N,) mask of the inliers."""
    most, best, line = -1, np.zeros(3), np.empty(3)
    for t in range(pairs.shape[1]):
        start, end = points[pairs[0, t]], points[pairs[1, t]]
        x, y = end[0] - start[0], end[1] - start[1]
        length = math.hypot(x, y)
        if not length > APART_M:
            continue
        line[0], line[1] = x / length, y / length
        line[2] = start[1] * line[0] - start[0] * line[1]
        count = _count_near(points, line, inlier_m)
        if count > most:
            most = count
            best[:] = line
    if most < 0:
        return _across_sight(points, origin), np.ones(len(points), np.bool_)
    inliers = np.empty(len(points), np.bool_)
    for i in range(len(points)):
        inliers[i] = abs(points[i, 1] * best[0] - points[i, 0] * best[1] - best[2]) <= inlier_m
    return _direction(*_scatter(points[inliers])), inliers


@compiled(borrowing=True)
def _count_near(points: np.ndarray, line: np.ndarray, inlier_m: float) -> int:
    """Count the points within a distance of a line: its (2,) direction, then its offset."""
    count, x, y, offset = 0, line[0], line[1], line[2]
    for i in range(len(points)):
        count += abs(points[i, 1] * x - points[i, 0] * y - offset) <= inlier_m
    return count


@compiled()
def _across_sight(points: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the direction across the line of sight, for points that determine no line."""
    sight = _mean(points) - origin
    away = math.hypot(sight[0], sight[1])
    return np.array([-sight[1] / away, sight[0] / away]) if away > 0.0 else np.array([1.0, 0.0])


@compiled()
def with_corner(
    points: np.ndarray, axis: np.ndarray, inliers: np.ndarray, origin: np.ndarray, inlier_m: float
) -> tuple[np.ndarray, float, np.ndarray]:
    """Find a second face behind an end of the first.

    Returns the direction fitted to both, the coordinate of the corner along it from the points'
    mean (nan without a corner), and the (N,) mask of the second face.

    axis: (2,) direction of the first face. inliers: (N,) bool, the points on it.
    """
    none = np.zeros(len(points), np.bool_)
    mean, first, normal = _mean(points), points[inliers], np.array([-axis[1], axis[0]])
    side = (mean[0] - origin[0]) * normal[0] + (mean[1] - origin[1]) * normal[1]
    depths, along = _along(points, _mean(first), normal), _along(points, mean, axis)
    low, high = along[inliers].min() + inlier_m, along[inliers].max() - inlier_m
    # Returns between the ends are above the face, for example of a rear window above a boot.
    behind = ~inliers & (depths * side > 0.0) & ((along < low) | (along > high))
    if behind.sum() < CORNER_POINTS:
        return axis, np.nan, none
    places = along[behind]
    ordered = np.sort(places)
    last = np.searchsorted(ordered, places + inlier_m, "right")
    chosen = places[(last - np.searchsorted(ordered, places - inlier_m, "left")).argmax()]
    second = behind & (np.abs(along - chosen) <= inlier_m)
    if second.sum() < CORNER_POINTS:
        return axis, np.nan, none
    xx, xy, yy = _scatter(first)
    # Rotated by 90 degrees, the second face is parallel to the first.
    uu, uv, vv = _scatter(points[second])
    turned = _direction(xx + vv, xy - uv, yy + uu)
    if turned[0] * axis[0] + turned[1] * axis[1] < 0.0:
        turned = -turned
    return turned, float(np.median(_along(points[second], mean, turned))), second


@compiled()
def _mean(points: np.ndarray) -> np.ndarray:
    """Return the (2,) mean of points."""
    out = np.zeros(2)
    for i in range(len(points)):
        out[0], out[1] = out[0] + points[i, 0], out[1] + points[i, 1]
    return out / len(points)


@compiled()
def _along(points: np.ndarray, start: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the (N,) coordinates of points along a unit axis from a start, metres."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = (points[i, 0] - start[0]) * axis[0] + (points[i, 1] - start[1]) * axis[1]
    return out


@compiled()
def _scatter(points: np.ndarray) -> tuple[float, float, float]:
    """Return the sums of squares xx, xy, yy of points about their mean."""
    mean, xx, xy, yy = _mean(points), 0.0, 0.0, 0.0
    for i in range(len(points)):
        x, y = points[i, 0] - mean[0], points[i, 1] - mean[1]
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
    return xx, xy, yy


@compiled()
def _direction(xx: float, xy: float, yy: float) -> np.ndarray:
    """Return the unit vector of the greatest spread; (0, 1) if all directions are equal."""
    if xy == 0.0 and xx == yy:
        return np.array([0.0, 1.0])
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    return np.array([math.cos(angle), math.sin(angle)])
