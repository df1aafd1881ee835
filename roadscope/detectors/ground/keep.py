"""No ground removal, for scans that have no ground in them."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.cloud import Cloud


def keep_all(cloud: Cloud) -> np.ndarray:
    """Keep every return.

    Returns (N,) bool, all true.
    """
    return np.ones(len(cloud), bool)
