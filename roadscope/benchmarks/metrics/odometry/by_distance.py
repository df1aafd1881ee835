"""Drift against the distance driven."""

from __future__ import annotations

import math

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.odometry.absolute import absolute_errors
from roadscope.benchmarks.metrics.odometry.drift import drift
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories
from roadscope.benchmarks.metrics.score import Score, mean

DISTANCE = "distance"
MARKS_M = (10, 20, 50, 100, 200, 400, 800)
"""Where curves are read, metres."""


def by_distance(both: Trajectories) -> dict[str, Score]:
    """Return by `part_name` the curves of one episode at `MARKS_M`.

    t_rel, r_rel: drift over all stretches of that length. position_error: of the first position
    farther than that along the true way, first pose on first pose. What the way does not hold
    has n = 0.
    """
    stretches = drift(both, MARKS_M, every=1)
    errors = absolute_errors(both, "origin")
    scores = {}
    for mark_m in MARKS_M:
        part, band = stretches.over(mark_m), str(mark_m)
        n, turns = len(part), np.rad2deg(part.rotations)
        off_m = float(errors.positions_m[_at(errors.distances_m, mark_m)]) if n else math.nan
        at = Score(off_m, "m", "lower", min(n, 1), weight=float(n > 0))
        scores[part_name("t_rel", DISTANCE, band)] = mean(100 * part.translations.sum(), n, "%")
        scores[part_name("r_rel", DISTANCE, band)] = mean(100 * turns.sum(), n, "deg/100m")
        scores[part_name("position_error", DISTANCE, band)] = at
    return scores


def _at(distances_m: np.ndarray, mark_m: float) -> int:
    return int(np.searchsorted(distances_m, mark_m, side="right"))
