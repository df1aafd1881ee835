"""The probability that what moves is a vehicle, from how it was followed and what fits it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.moving.links import Chain, Sighting, unsteady
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.scoring import ScoreModel

FEATURES = (
    "log_returns", "levels", "log_evidence", "sightings", "speed_m_s", "unsteady_m", "range_m",
    "top_m", "bottom_m", "long_m", "wide_m", "outside", "askew_deg", "length_m",
)  # fmt: skip
"""Names of the columns of `features`."""
MANY = 10
"""Sightings beyond which more say nothing new."""
MARGIN_M = 0.25


def features(chain: Chain, seen: Sighting, ring: np.ndarray, pose: VehiclePose) -> np.ndarray:
    """Return (F,) `FEATURES` of a vehicle that is followed and its pose in the drive's frame.

    seen: the sighting that the pose is of. ring: (N,) beams of its returns. How far marks lie
    from a straight line, how long and wide the returns reach along the pose, which share of them
    lies outside its rectangle and how far it is turned from the way; logarithms are natural.
    """
    way_x, way_y = chain.velocity.tolist()
    speed, (x, y) = math.hypot(way_x, way_y), seen.origin.tolist()
    levels, top, bottom, along, across, outside = _about(
        seen.points, seen.candidate.times_s, ring, chain.velocity,
        (pose.x, pose.y, pose.yaw, pose.length, pose.width),
    )  # fmt: skip
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    along_way = abs(cos * way_x + sin * way_y)
    return np.array(
        [
            math.log(len(seen.points)),
            levels,
            math.log1p(max(seen.candidate.evidence, 0.0)),
            min(chain.count, MANY),
            speed,
            unsteadiness(chain),
            math.hypot(pose.x - x, pose.y - y),
            top,
            bottom,
            along,
            across,
            outside,
            math.degrees(math.acos(min(along_way / speed, 1.0))) if speed > 0 else 45.0,
            pose.length,
        ]
    )


@compiled()
def _about(
    points: np.ndarray,
    times_s: np.ndarray,
    ring: np.ndarray,
    velocity: np.ndarray,
    box: tuple[float, float, float, float, float],
) -> tuple[float, float, float, float, float, float]:
    """Return beams, highest and lowest z, reach along and across a box, and share outside it.

    Points (N, 3) are carried back by their times (N,) with a (2,) velocity. box: x, y, yaw,
    length, width.
    """
    x, y, yaw, length, width = box
    cos, sin = np.cos(yaw), np.sin(yaw)
    met, outside = np.zeros(ring.max() + 1, np.bool_), 0
    rear, front, right, left = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points)):
        dx = points[i, 0] - times_s[i] * velocity[0] - x
        dy = points[i, 1] - times_s[i] * velocity[1] - y
        u, v = cos * dx + sin * dy, cos * dy - sin * dx
        rear, front, right, left = min(rear, u), max(front, u), min(right, v), max(left, v)
        outside += abs(u) > 0.5 * length + MARGIN_M or abs(v) > 0.5 * width + MARGIN_M
        met[ring[i]] = True
    high, low = points[:, 2].max(), points[:, 2].min()
    return met.sum(), high, low, front - rear, left - right, outside / len(points)


def unsteadiness(chain: Chain) -> float:
    """Return how far the marks lie from even motion, root mean square in metres."""
    return float(unsteady(chain.times, chain.marks, chain.velocity))


@cache
def shipped_model() -> ScoreModel:
    """Return the model with the weights that ship with the package."""
    from roadscope.detectors.long_range_weights import CONSTANT, CURVES

    return ScoreModel(CONSTANT, CURVES, FEATURES)
