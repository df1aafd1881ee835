"""The probability that what moves is a vehicle, from how it was followed and what fits it."""

from __future__ import annotations

from functools import cache

import numpy as np

from roadscope.detectors.moving.links import Chain, Sighting
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
    velocity, count = chain.velocity, len(seen.points)
    speed = float(np.hypot(*velocity))
    away = seen.at_stamp(velocity) - (pose.x, pose.y)
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    along, across = away @ (cos, sin), away @ (-sin, cos)
    sides = np.array([pose.length, pose.width]) / 2 + MARGIN_M
    outside = (np.abs(along) > sides[0]) | (np.abs(across) > sides[1])
    askew = np.degrees(np.arccos(min(abs(cos * velocity[0] + sin * velocity[1]) / speed, 1.0)))
    return np.array(
        [
            np.log(count),
            len(np.unique(ring)),
            np.log1p(max(seen.candidate.evidence, 0.0)),
            min(chain.count, MANY),
            speed,
            unsteadiness(chain),
            float(np.hypot(pose.x - seen.origin[0], pose.y - seen.origin[1])),
            seen.points[:, 2].max(),
            seen.points[:, 2].min(),
            np.ptp(along),
            np.ptp(across),
            outside.mean(),
            askew if speed > 0 else 45.0,
            pose.length,
        ]
    )


def unsteadiness(chain: Chain) -> float:
    """Return how far the marks lie from even motion, root mean square in metres."""
    times = np.array([s.met_s for s in chain.sightings])
    marks = np.array([s.mark for s in chain.sightings])
    off = marks - marks.mean(axis=0) - np.multiply.outer(times - times.mean(), chain.velocity)
    return float(np.sqrt((off**2).sum(axis=1).mean()))


@cache
def shipped_model() -> ScoreModel:
    """Return the model with the weights that ship with the package."""
    from roadscope.detectors.long_range_weights import CONSTANT, CURVES

    return ScoreModel(CONSTANT, CURVES, FEATURES)
