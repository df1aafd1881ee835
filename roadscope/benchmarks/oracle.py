"""The upper mark of a board: a detector that reads the truth. It is no plug-in."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.core import Detections, Truth

ORACLE = "oracle"


def oracle_detections(truth: Truth, eligibility: Eligibility) -> Detections:
    """Return the true boxes of all eligible objects, world frame."""
    rows = np.flatnonzero(eligibility.of(truth))
    return Detections(
        truth.centres[rows], truth.sizes[rows], truth.yaws[rows], truth.categories[rows],
        np.ones(len(rows)), "world", truth.stamp_s,
    )  # fmt: skip
