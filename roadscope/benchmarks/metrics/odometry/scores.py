"""All scores of one episode of odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.odometry.errors import (
    SHORT_M,
    AbsoluteErrors,
    Alignment,
    absolute_errors,
    drift,
    relative_errors,
)
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms

GOOD_T_REL = 1.0
"""Per cent of the way; an episode that drifts less counts in `below_1`."""
FAILED_SHARE, FAILED_M = 0.05, 1.0
"""An episode has failed when the last position is off by more than 5 % of the way and 1 m:
bistable outcomes are near 0 or near 100 %, so that hardly any lies about the bound."""


@dataclass(frozen=True, slots=True)
class OdometryScores(ScoreFamily):
    """How well an odometry followed; positions once aligned, drift without any alignment.

    ate: root mean square of the positions' errors, first pose on first pose unless another
        alignment is asked for (Sturm et al. 2012 take the best one, which hides drift).
    rpe, rpe_rotation: of motions from frame to frame. t_rel, r_rel: over stretches
        (`metrics.odometry.drift`). end: of the last position.
    error_mean, error_std, error_min, error_max: of the positions' errors.
    below_1: 1 where t_rel is below 1 %; its mean is the share of episodes.
    failed: 1 where the end is too far off to be called odometry; its mean over episodes is the
        failure rate.
    """

    ate: Score
    rpe: Score
    rpe_rotation: Score
    t_rel: Score
    r_rel: Score
    end: Score
    error_mean: Score
    error_std: Score
    error_min: Score
    error_max: Score
    below_1: Score
    failed: Score


def score_odometry(
    both: Trajectories, *, alignment: Alignment = "origin", lengths_m: Sequence[float] = SHORT_M,
    every: int = 1,
) -> OdometryScores:  # fmt: skip
    """Return the scores of one episode.

    Episodes are short: stretches begin at every frame unless `every` says otherwise.
    """
    absolute, steps = absolute_errors(both, alignment), relative_errors(both)
    stretches = drift(both, lengths_m, every=every)
    off = absolute.positions_m
    n = len(off)
    return OdometryScores(
        ate=rms(float(off @ off), n, "m"),
        rpe=rms(float(steps.translations_m @ steps.translations_m), len(steps), "m"),
        rpe_rotation=rms(float(np.sum(np.rad2deg(steps.rotations_rad) ** 2)), len(steps), "deg"),
        t_rel=mean(100 * float(stretches.translations.sum()), len(stretches), "%"),
        r_rel=mean(100 * float(np.rad2deg(stretches.rotations.sum())), len(stretches), "deg/100m"),
        end=_one(absolute.end_m, "m", n),
        error_mean=mean(float(off.sum()), n, "m"),
        error_std=_one(float(off.std()) if n else math.nan, "m", n),
        error_min=_one(float(off.min()) if n else math.nan, "m", n),
        error_max=_one(float(off.max()) if n else math.nan, "m", n),
        below_1=ratio(stretches.t_rel < GOOD_T_REL, min(len(stretches), 1), "higher"),
        failed=ratio(has_failed(absolute_errors(both, "origin")), min(n, 1), "lower"),
    )


def has_failed(errors: AbsoluteErrors) -> bool:
    """Say whether the last of origin-aligned positions is too far off to be called odometry."""
    if not len(errors):
        return False
    return errors.end_m > max(FAILED_M, FAILED_SHARE * float(errors.distances_m[-1]))


def drift_curve(errors: AbsoluteErrors, step_m: float) -> np.ndarray:
    """Return (K, 2): distance driven, every `step_m` metres, and the position's error there."""
    if not step_m > 0:
        raise ValueError(f"step_m must be above 0, got {step_m}")
    if not len(errors):
        return np.empty((0, 2))
    marks = np.arange(0.0, errors.distances_m[-1] + 1e-9, step_m)
    # A sensor at rest is at one mark many times: the last counts.
    rows = np.searchsorted(errors.distances_m, marks + 1e-9, side="right") - 1
    return np.column_stack([marks, errors.positions_m[rows]])


def _one(value: float, unit: str, n: int) -> Score:
    """Return a figure of which each episode has one, lower is better."""
    return Score(value, unit, "lower", n, weight=float(n > 0))
