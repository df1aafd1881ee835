"""Pose from RANSAC line and corner fit, the method that Zhang 2017 compares with."""

from __future__ import annotations

from typing import Literal

import numpy as np

from roadscope.detectors.pose.estimate import (
    VehiclePose,
    positive,
    settled_origin,
    settled_points,
)
from roadscope.detectors.pose.matched_filter import away

LongSide = Literal["size", "main"]
CORNER_POINTS = 2
"""Returns off the first face that make a second one."""


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
    """Return the rectangle of known size at the line, or corner, that most returns agree with.

    points_xy: (N, 2) metres, returns of one vehicle, at least one. origin: (2,) the sensor in
    the same frame. inlier_m: greatest distance from a face, three times the range noise.
    trials: pairs of returns that are tried. yaw points away from the sensor. score: share of
    the returns on the two faces.

    Zhang 2017 refers to Morris 2008 for it and gives no numbers. Reading taken: the line with
    most returns is one face; those off it that agree on a perpendicular line behind its end are
    the other. long_side "size": the first face is the side whose size it comes nearest to.
    "main": it is always the long side, as the paper's introduction has it, which turns what is
    seen from behind by 90 deg.
    """
    points, place = settled_points(points_xy), settled_origin(origin)
    positive(length_m=length_m, width_m=width_m, inlier_m=inlier_m, trials=trials)
    if long_side not in ("size", "main"):
        raise ValueError(f"no long_side {long_side!r}; known: size, main")
    points = _by_range(points, place)
    mean = points.mean(axis=0)
    axis, held = _best_line(points, place, rng, (inlier_m, int(trials)))
    axis, corner, second = _with_corner(points, axis, held, place, inlier_m)
    normal = np.array([-axis[1], axis[0]])
    depth = float(np.median((points[held] - mean) @ normal))
    along = (points[held] - mean) @ axis
    seen = float(np.ptp(along))
    is_flank = long_side == "main" or abs(seen - length_m) < abs(seen - width_m)
    extent, other = (length_m, width_m) if is_flank else (width_m, length_m)
    if corner is None:
        middle = (along.min() + along.max()) / 2
    else:
        middle = corner + np.copysign(extent / 2, np.median(along) - corner)
    behind = np.copysign(other / 2, (mean - place) @ normal)
    x, y = mean + middle * axis + (depth + behind) * normal
    heading = axis if is_flank else normal
    yaw = away(float(np.arctan2(heading[1], heading[0])), mean - place)
    share = float(np.mean(held | second))
    return VehiclePose(float(x), float(y), yaw, length_m, width_m, score=share)


def _by_range(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Sort by range, then side: the same pairs are drawn however the points were given."""
    sights = points - place
    middle = sights.mean(axis=0)
    sides = middle[0] * sights[:, 1] - middle[1] * sights[:, 0]
    # Rounded to micrometres, so that a turned scene sorts alike.
    keys = np.round(np.stack([sides, np.hypot(*sights.T)]), 6)
    return np.asarray(points[np.lexsort(keys)])


def _best_line(
    points: np.ndarray,
    place: np.ndarray,
    rng: np.random.Generator,
    settings: tuple[float, int],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (2,) direction of the line with most points and the (N,) mask of those."""
    inlier_m, trials = settings
    first, second = rng.integers(0, len(points), (2, trials))
    ways = points[second] - points[first]
    lengths = np.hypot(*ways.T)
    drawn = lengths > 1e-9
    if not drawn.any():
        # One place has no line: a face square to the line of sight.
        sight = points.mean(axis=0) - place
        across = np.array([-sight[1], sight[0]]) / (np.hypot(*sight) or 1.0)
        axis = across if across.any() else np.array([1.0, 0.0])
        return axis, np.ones(len(points), bool)
    starts, ways = points[first[drawn]], ways[drawn] / lengths[drawn, None]
    crossed = np.multiply.outer(points[:, 1], ways[:, 0]) - np.multiply.outer(
        points[:, 0], ways[:, 1]
    )
    offsets = crossed - (starts[:, 1] * ways[:, 0] - starts[:, 0] * ways[:, 1])
    near = np.abs(offsets) <= inlier_m
    best = int(near.sum(axis=0).argmax())
    held = near[:, best]
    return _direction(_scatter(points[held])), held


def _with_corner(
    points: np.ndarray,
    axis: np.ndarray,
    held: np.ndarray,
    place: np.ndarray,
    inlier_m: float,
) -> tuple[np.ndarray, float | None, np.ndarray]:
    """Find a second face behind an end of the first.

    Returns the direction fitted to both, where the corner lies along it from the points' mean
    (None without one), and the (N,) mask of the second face.
    """
    normal = np.array([-axis[1], axis[0]])
    mean = points.mean(axis=0)
    depths = (points - points[held].mean(axis=0)) @ normal
    along = (points - mean) @ axis
    low, high = along[held].min() + inlier_m, along[held].max() - inlier_m
    # What is seen between the ends lies over the face: a rear window over a boot.
    behind = ~held & (depths * ((mean - place) @ normal) > 0) & ((along < low) | (along > high))
    if behind.sum() < CORNER_POINTS:
        return axis, None, np.zeros(len(points), bool)
    places = along[behind]
    ordered = np.sort(places)
    last = np.searchsorted(ordered, places + inlier_m, "right")
    agreed = last - np.searchsorted(ordered, places - inlier_m, "left")
    chosen = places[agreed.argmax()]
    second: np.ndarray = behind & (np.abs(along - chosen) <= inlier_m)
    if second.sum() < CORNER_POINTS:
        return axis, None, np.zeros(len(points), bool)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    both = _scatter(points[held]) + quarter @ _scatter(points[second]) @ quarter.T
    turned = _direction(both)
    turned = turned if turned @ axis >= 0 else -turned
    return turned, float(np.median((points[second] - mean) @ turned)), second


def _scatter(points: np.ndarray) -> np.ndarray:
    centred = points - points.mean(axis=0)
    return np.asarray(centred.T @ centred)


def _direction(scatter: np.ndarray) -> np.ndarray:
    """Return the unit vector of the greatest spread."""
    return np.asarray(np.linalg.eigh(scatter)[1][:, 1])
