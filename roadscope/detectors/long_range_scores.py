"""The probability that a moving object is a vehicle, from its motion and the fit of its pose."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.moving.links import Chain, Sighting, unsteady
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.scoring import ScoreModel

MOVING_FEATURES = (
    "log_returns",
    "levels",
    "log_evidence",
    "sightings",
    "speed_m_s",
    "unsteady_m",
    "range_m",
    "top_m",
    "bottom_m",
    "long_m",
    "wide_m",
    "outside",
    "askew_deg",
    "length_m",
)
"""Names of the columns of `moving_features`."""
MOST_SIGHTINGS = 10
"""More sightings count as this many."""
MARGIN_M = 0.25
"""Returns count as outside a rectangle if they are farther than this from it."""


def moving_features(
    chain: Chain, sighting: Sighting, ring: np.ndarray, pose: VehiclePose
) -> np.ndarray:
    """Return the (F,) `MOVING_FEATURES` of a vehicle with a pose in the drive's frame.

    chain: its sightings in successive scans. sighting: the one to which the pose was fitted. ring:
    (N,) beams of its returns. `unsteady_m` is how far its positions lie from even motion. `long_m`
    and `wide_m` are the extents of the returns along and across the pose, `outside` is the share of
    them outside its rectangle, and `askew_deg` the angle between pose and velocity. Logarithms are
    natural.
    """
    speed_x, speed_y = chain.velocity.tolist()
    speed, (x, y) = math.hypot(speed_x, speed_y), sighting.origin.tolist()
    box = Box(pose.x, pose.y, pose.yaw, pose.length, pose.width)
    extent = extent_in(box, sighting.points, sighting.candidate.times_s, ring, chain.velocity)
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    along = abs(cos * speed_x + sin * speed_y)
    return np.array(
        [
            math.log(len(sighting.points)),
            extent.beams,
            math.log1p(max(sighting.candidate.evidence, 0.0)),
            min(chain.count, MOST_SIGHTINGS),
            speed,
            unsteadiness(chain),
            math.hypot(pose.x - x, pose.y - y),
            extent.top,
            extent.bottom,
            extent.along,
            extent.across,
            extent.outside,
            math.degrees(math.acos(min(along / speed, 1.0))) if speed > 0 else 45.0,
            pose.length,
        ]
    )


class Box(NamedTuple):
    """A rectangle in the drive's frame, metres and radians."""

    x: float
    y: float
    yaw: float
    length: float
    width: float


class Extent(NamedTuple):
    """The extent of returns, metres: highest and lowest z, length along and width across a box.

    beams: how many have a return. outside: share of the returns outside the box.
    """

    beams: int
    top: float
    bottom: float
    along: float
    across: float
    outside: float


@compiled()
def extent_in(
    box: Box, points: np.ndarray, times_s: np.ndarray, ring: np.ndarray, velocity: np.ndarray
) -> Extent:
    """Return the extent of points (N, 3), moved back to time 0 with a velocity (2,).

    times_s: (N,) seconds at which they were measured.
    """
    x, y, yaw, length, width = box
    cos, sin = np.cos(yaw), np.sin(yaw)
    has_beam, outside = np.zeros(ring.max() + 1, np.bool_), 0
    rear, front, right, left = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points)):
        dx = points[i, 0] - times_s[i] * velocity[0] - x
        dy = points[i, 1] - times_s[i] * velocity[1] - y
        u, v = cos * dx + sin * dy, cos * dy - sin * dx
        rear, front, right, left = min(rear, u), max(front, u), min(right, v), max(left, v)
        outside += abs(u) > 0.5 * length + MARGIN_M or abs(v) > 0.5 * width + MARGIN_M
        has_beam[ring[i]] = True
    high, low = points[:, 2].max(), points[:, 2].min()
    share = outside / len(points)
    return Extent(has_beam.sum(), high, low, front - rear, left - right, share)


def unsteadiness(chain: Chain) -> float:
    """Return how far a vehicle's positions lie from even motion, root mean square in metres."""
    return float(unsteady(chain.times, chain.positions, chain.velocity))


# --------------------------------------------------------------------------------------------------
# Weights of the score model: constant, and for every feature its knots and log odds.
#
# Fitted by `research.detector_scores moving` on train seeds 300 to 305 of 8 scenarios, rigs lux,
# vlp16, hdl32e, hdl64e, clear, rain and fog: 5007 detections, 4271 of them right.

CONSTANT = 1.453
CURVES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "log_returns": ((1.386, 2.996, 4.078, 5.412, 9.094), (-1.884, -1.186, 0.085, 0.118, 2.866)),
    "levels": ((1.0, 2.0, 3.0, 6.0, 41.0), (1.132, -0.205, -0.42, -0.627, 0.121)),
    "log_evidence": ((1.386, 2.444, 3.091, 3.885, 5.111), (-1.556, 0.015, 0.486, -0.316, 1.372)),
    "sightings": ((2.0, 5.0, 9.0, 10.0), (-0.293, -0.073, 0.064, 0.302)),
    "speed_m_s": ((1.842, 6.526, 11.371, 14.282, 28.758), (-0.134, 0.926, -0.098, 0.348, -1.042)),
    "unsteady_m": ((0.0, 0.005, 0.011, 0.024, 0.393), (-0.487, 1.154, 0.854, 0.321, -1.843)),
    "range_m": ((4.619, 18.65, 27.88, 42.18, 78.627), (-0.122, -1.082, -0.518, 0.396, 1.325)),
    "top_m": ((0.484, 0.993, 1.372, 1.73, 2.799), (-1.054, -0.588, 2.23, -0.785, 0.196)),
    "bottom_m": ((0.151, 0.219, 0.372, 0.656, 1.9), (-0.126, 1.408, 0.339, 0.009, -1.629)),
    "long_m": ((0.053, 0.43, 2.005, 4.097, 10.809), (-0.435, -0.176, 0.11, -0.074, 0.576)),
    "wide_m": ((0.022, 1.289, 1.676, 1.808, 3.067), (-2.762, 1.237, 2.173, 1.873, -2.52)),
    "outside": ((0.0, 1.0), (0.073, -0.073)),
    "askew_deg": ((0.012, 0.315, 0.898, 2.732, 35.956), (-0.307, -0.077, 0.537, 0.052, -0.205)),
    "length_m": ((1.965, 4.332, 4.441, 4.854, 16.445), (1.073, 0.959, 2.079, 0.351, -4.462)),
}


@cache
def moving_score_model() -> ScoreModel:
    """Return the model with the weights that ship with the package."""
    return ScoreModel(CONSTANT, CURVES, MOVING_FEATURES)
