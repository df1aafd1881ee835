"""From scores to evidence.

A calibrated score is the share of detections like this one that are what they say. That share of
the belief goes to classes, split as the detector confuses them; the rest is ignorance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core import Category, Detections, Family, ImageDetections

FAMILIES = (Family.VEHICLE, Family.CYCLIST, Family.PEDESTRIAN)
"""The frame of discernment; masses have these columns and then ignorance."""
MOST = 0.98
"""No sensor is believed without reserve: full conflict cannot come from scores."""

Confusion = Sequence[Sequence[float]]

LIDAR_CONFUSION: Confusion = ((0.94, 0.04, 0.02), (0.12, 0.64, 0.24), (0.04, 0.26, 0.70))
CAMERA_CONFUSION: Confusion = ((0.98, 0.01, 0.01), (0.05, 0.86, 0.09), (0.01, 0.06, 0.93))
"""Of what is called one family (row), the share that is each (column)."""

_FAMILY_OF = np.array([FAMILIES.index(category.family) for category in Category])


def families_of(categories: np.ndarray) -> np.ndarray:
    """(N,) columns of `FAMILIES` of (N,) categories."""
    families: np.ndarray = _FAMILY_OF[np.asarray(categories, np.int64)]
    return families


def masses_of(detections: Detections | ImageDetections, confusion: Confusion) -> np.ndarray:
    """Return (N, 4) masses: a detection's own where it has some, else of score and category."""
    if detections.masses is not None:
        return detections.masses
    belief = MOST * detections.scores[:, None]
    split = np.asarray(confusion)[families_of(detections.categories)]
    return np.concatenate([belief * split, 1 - belief], axis=1)
