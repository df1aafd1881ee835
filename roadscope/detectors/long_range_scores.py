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

FEATURES = (
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
"""Names of the columns of `features`."""
MOST_SIGHTINGS = 10
"""More sightings count as this many."""
MARGIN_M = 0.25
"""Returns count as outside a rectangle if they are farther than this from it."""


def features(chain: Chain, sighting: Sighting, ring: np.ndarray, pose: VehiclePose) -> np.ndarray:
    """Return the (F,) `FEATURES` of a vehicle with a pose in the drive's frame.

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


@cache
def shipped_model() -> ScoreModel:
    """Return the model with the weights that ship with the package."""
    from roadscope.detectors.long_range_weights import CONSTANT, CURVES

    return ScoreModel(CONSTANT, CURVES, FEATURES)
