"""From scores to evidence.

A calibrated score is the share of detections like this one that are what they say. That share of
the belief goes to classes, split as the detector confuses them; the rest is ignorance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core import Category, Detections, Family, ImageDetections, RecordError
from roadscope.fusion.weights import confusion, odds_model

FAMILIES = (Family.VEHICLE, Family.CYCLIST, Family.PEDESTRIAN)
"""The frame of discernment; masses have these columns and then ignorance."""
MOST = 0.98
"""No sensor is believed without reserve: full conflict cannot come from scores."""

Confusion = Sequence[Sequence[float]] | np.ndarray

_FAMILY_OF = np.array([FAMILIES.index(category.family) for category in Category])


def families_of(categories: np.ndarray) -> np.ndarray:
    """(N,) columns of `FAMILIES` of (N,) categories."""
    families: np.ndarray = _FAMILY_OF[np.asarray(categories, np.int64)]
    return families


def masses_of(detections: Detections | ImageDetections, split: Confusion) -> np.ndarray:
    """Return (N, 4) masses: a detection's own where it has some, else of score and category.

    split: of what is called one family (row), the share that is each (column).
    """
    if detections.masses is not None:
        return _own(detections.masses)
    belief = MOST * detections.scores[:, None]
    shares = np.asarray(split)[families_of(detections.categories)]
    return np.concatenate([belief * shares, 1 - belief], axis=1)


def _own(masses: np.ndarray) -> np.ndarray:
    """Return a detector's masses; refuse those on another frame of discernment."""
    if masses.shape[1] != len(FAMILIES) + 1:
        raise RecordError(
            "fusion: expected masses on vehicle, cyclist, pedestrian and ignorance, got "
            f"{masses.shape[1]} columns"
        )
    return masses


def lidar_masses(lidar: Detections) -> np.ndarray:
    """Return (N, 4) masses of LiDAR detections."""
    return masses_of(lidar, confusion("lidar"))


def camera_masses(camera: ImageDetections) -> np.ndarray:
    """Return (N, 4) masses of camera detections, after how reliable their scores are by size."""
    if camera.masses is not None:
        return _own(camera.masses)
    reliable = 1 / (1 + np.exp(-odds_model("camera_masses").odds(camera_features(camera))))
    belief = MOST * reliable[:, None]
    shares = confusion("camera")[families_of(camera.categories)]
    return np.concatenate([belief * shares, 1 - belief], axis=1)


def camera_features(camera: ImageDetections) -> np.ndarray:
    """(N, 4): log odds of the score, log of the height in pixels over 40, and of which family."""
    heights = np.maximum(camera.boxes[:, 3] - camera.boxes[:, 1], 1.0)
    family = families_of(camera.categories)
    return np.column_stack(
        [log_odds(camera.scores), np.log(heights / 40.0), family == 1, family == 2]
    )


def log_odds(chances: np.ndarray) -> np.ndarray:
    """(N,) log odds, bounded at 5."""
    bounded = np.clip(chances, 0.0067, 0.9933)
    odds: np.ndarray = np.log(bounded / (1 - bounded))
    return odds
