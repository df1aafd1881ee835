"""Pose from RANSAC line and corner fit, the method that Zhang 2017 compares with."""

from __future__ import annotations

from typing import Literal

import numpy as np

from roadscope.detectors.pose.estimate import (
    VehiclePose,
    check_positive,
    checked_origin,
    checked_points,
    pointing_away,
)
from roadscope.detectors.pose.ransac_kernels import Sides, agreed, by_range

LongSide = Literal["size", "main"]


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

    points_xy: (N, 2) metres, returns of one vehicle, at least one. origin: (2,) metres, the sensor
    in the same frame. inlier_m: greatest distance of an inlier from a face, three times the range
    noise. trials: number of pairs of returns that are tried. yaw points away from the sensor. The
    score is the share of the returns on the two faces.

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
    x, y, angle, share = agreed(points, place, pairs, float(inlier_m), sides)
    yaw = pointing_away(angle, points.mean(axis=0) - place)
    return VehiclePose(x, y, yaw, length_m, width_m, score=share)
