"""Ground removals by name: which returns are not the ground."""

from collections.abc import Callable, Mapping

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.ground.grid import cell_spans, grid_above_ground
from roadscope.detectors.ground.polar import PolarRule, polar_above_ground
from roadscope.detectors.ground.surface import GroundRule, GroundSurface

Ground = Callable[[Cloud], np.ndarray]
"""Cloud of N returns -> (N,) bool, whether each is from something above the ground."""


def keep_all(cloud: Cloud) -> np.ndarray:
    """Keep every return, for scans without ground.

    Returns (N,) bool, all true.
    """
    return np.ones(len(cloud), bool)


GROUNDS: Mapping[str, Callable[..., np.ndarray]] = {
    "grid": grid_above_ground,
    "keep": keep_all,
    "polar": polar_above_ground,
}
"""Name -> a `Ground`; keyword arguments beyond the cloud are its options."""

__all__ = [
    "GROUNDS",
    "Ground",
    "GroundRule",
    "GroundSurface",
    "PolarRule",
    "cell_spans",
    "grid_above_ground",
    "keep_all",
    "polar_above_ground",
]
