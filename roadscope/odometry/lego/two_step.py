"""The motion between two scans in two steps (Shan and Englot 2018, section III-D)."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.loam.feature_match import FeatureMatch, match_features
from roadscope.odometry.loam.features import Features

LEVEL = (False, False, True, True, True, False)
"""z, roll and pitch: what the ground tells."""
ALONG = (True, True, False, False, False, True)
"""x, y and yaw: what edges tell, with the others held."""


def match_two_steps(now: Features, before: Features, start: np.ndarray) -> FeatureMatch:
    """Return the motion by planes for height, roll and pitch, then by edges for the rest.

    start: (4, 4) `before_from_now`. Each step's information is of what it sought.
    """
    first = match_features(now, before, start, edges=False, free=LEVEL)
    second = match_features(now, before, first.before_from_now, planes=False, free=ALONG)
    level, along = np.diag(np.array(LEVEL, float)), np.diag(np.array(ALONG, float))
    information = level @ first.information @ level + along @ second.information @ along
    held = min(first.held, second.held)
    return FeatureMatch(second.before_from_now, information, second.residual_m, held)
