"""Which returns are not the ground, by name."""

from collections.abc import Callable, Mapping

import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.ground.grid import grid_above_ground
from roadscope.detectors.ground.keep import keep_all
from roadscope.detectors.ground.polar import polar_above_ground

Ground = Callable[[Cloud], np.ndarray]
"""Cloud of N returns -> (N,) bool, what stands on the ground rather than being it."""

GROUNDS: Mapping[str, Callable[..., np.ndarray]] = {
    "grid": grid_above_ground,
    "keep": keep_all,
    "polar": polar_above_ground,
}
"""Name -> a `Ground`; keyword arguments beyond the cloud are its options."""

__all__ = ["GROUNDS", "Ground"]
