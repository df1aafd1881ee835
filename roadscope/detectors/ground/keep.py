"""No ground removal, for scans that have no ground in them."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.cloud import Cloud


def keep_all(cloud: Cloud) -> np.ndarray:
    """Return a mask that keeps every return."""
    return np.ones(len(cloud), bool)
