"""Scores of an odometry on an episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms
from roadscope.benchmarks.metrics.trajectory_errors import (
    SHORT_M,
    AbsoluteErrors,
    Trajectories,
    absolute_errors,
    drift,
    pair_errors,
    relative_errors,
)

GOOD_T_REL = 1.0
"""Per cent of the distance; an episode that drifts less counts in `below_1`."""
FAILED_SHARE, FAILED_M = 0.05, 1.0
"""An episode has failed if its last position is off by more than 5 % of the distance and 1 m.
Failures are near 100 %, other episodes near 0 %, so hardly any is near the limit."""


@dataclass(frozen=True, slots=True)
class OdometryScores(ScoreFamily):
    """Scores of an odometry on one episode, lower is better but for below_1; nan without a pose.

    ate: root mean square error of positions, metres, with first pose on first pose (Sturm et al.
        2012 take the best alignment, which hides drift).
    rpe, rpe_rotation: root mean square errors of motions from frame to frame, metres and degrees.
    t_rel, r_rel: mean drift over stretches (`drift`), per cent and degrees per 100 m; nan if no
        stretch is long enough.
    end: error of the last position, metres.
    error_mean, error_std, error_min, error_max: of the positions' errors, metres.
    below_1: 1 if t_rel is below 1 %, else 0; its mean is the share of episodes.
    failed: 1 if the last position is off by more than 5 % of the distance and 1 m, else 0; its
        mean over episodes is the failure rate.
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
    trajectories: Trajectories, *, lengths_m: Sequence[float] = SHORT_M, every: int = 1
) -> OdometryScores:
    """Return the scores of one episode.

    lengths_m, every: as in `drift`. Episodes are short, so stretches begin at every frame.
    """
    absolute, steps = absolute_errors(trajectories, "origin"), relative_errors(trajectories)
    stretches = drift(trajectories, lengths_m, every=every)
    errors_m = absolute.positions_m
    n = len(errors_m)
    return OdometryScores(
        ate=rms(float(errors_m @ errors_m), n, "m"),
        rpe=rms(float(steps.translations_m @ steps.translations_m), len(steps), "m"),
        rpe_rotation=rms(float(np.sum(np.rad2deg(steps.rotations_rad) ** 2)), len(steps), "deg"),
        t_rel=mean(100 * float(stretches.translations.sum()), len(stretches), "%"),
        r_rel=mean(100 * float(np.rad2deg(stretches.rotations.sum())), len(stretches), "deg/100m"),
        end=_of_episode(absolute.end_m, n),
        error_mean=mean(float(errors_m.sum()), n, "m"),
        error_std=_of_episode(float(errors_m.std()) if n else math.nan, n),
        error_min=_of_episode(float(errors_m.min()) if n else math.nan, n),
        error_max=_of_episode(float(errors_m.max()) if n else math.nan, n),
        below_1=ratio(stretches.t_rel < GOOD_T_REL, min(len(stretches), 1), "higher"),
        failed=ratio(has_failed(absolute), min(n, 1), "lower"),
    )


def has_failed(errors: AbsoluteErrors) -> bool:
    """Return whether the last position, first pose on first pose, is too far off for odometry."""
    if not len(errors):
        return False
    return errors.end_m > max(FAILED_M, FAILED_SHARE * float(errors.distances_m[-1]))


def _of_episode(value: float, n: int) -> Score:
    """Return a figure in metres of which an episode with poses has one."""
    return Score(value, "m", "lower", n, weight=float(n > 0))


# --------------------------------------------------------------------------------------------------
# Drift by the distance travelled.

DISTANCE = "distance"
MARKS_M = (10, 20, 50, 100, 200, 400, 800)
"""Distances at which curves are read, metres."""


def by_distance(
    trajectories: Trajectories, marks_m: Sequence[float] = MARKS_M, *, every: int = 1
) -> dict[str, Score]:
    """Return the scores of one episode at distances, metres, by `part_name`.

    t_rel, r_rel: drift over all stretches of that length. position_error: error of the first
    position farther than that along the true trajectory, metres, first pose on first pose. Beyond
    the end of the trajectory they are nan, with n = 0.
    every: of how many frames one begins a stretch.
    """
    stretches = drift(trajectories, marks_m, every=every)
    errors = absolute_errors(trajectories, "origin")
    scores = {}
    for mark_m in marks_m:
        part, band = stretches.over(mark_m), f"{mark_m:g}"
        n, rotations_deg = len(part), np.rad2deg(part.rotations)
        row = int(np.searchsorted(errors.distances_m, mark_m, side="right"))
        error_m = float(errors.positions_m[row]) if n else math.nan
        position_error = Score(error_m, "m", "lower", min(n, 1), weight=float(n > 0))
        t_rel = mean(100 * part.translations.sum(), n, "%")
        r_rel = mean(100 * rotations_deg.sum(), n, "deg/100m")
        scores[part_name("t_rel", DISTANCE, band)] = t_rel
        scores[part_name("r_rel", DISTANCE, band)] = r_rel
        scores[part_name("position_error", DISTANCE, band)] = position_error
    return scores


# --------------------------------------------------------------------------------------------------
# Motion that is estimated while the sensor stands.

AT_REST_M_S = 0.1
"""A slower sensor stands; a body that rocks on its springs after braking does so too."""
LEAST_REST_S = 1.0
"""Shorter rests are too short to show drift."""


@dataclass(frozen=True, slots=True)
class StandingScores(ScoreFamily):
    """Motion that an odometry estimates while the sensor stands, metres; nan without a rest.

    false_motion: largest distance from where a rest began, over all rests of an episode.
    false_motion_end: distance at the end of a rest, mean of the rests.
    """

    false_motion: Score
    false_motion_end: Score


def score_standing(trajectories: Trajectories, stamps_s: np.ndarray) -> StandingScores:
    """Return the false motion of one episode, without the true motion of the rests.

    stamps_s: (N,) of the poses, seconds.
    """
    largest_m, ends_m, frames = [], [], 0
    for rest in rests(trajectories, stamps_s):
        rows = np.arange(rest.first, rest.last + 1)
        errors = pair_errors(trajectories, np.full(len(rows), rest.first), rows)
        largest_m.append(float(errors.translations_m.max()))
        ends_m.append(float(errors.translations_m[-1]))
        frames += len(rows)
    largest = max(largest_m, default=np.nan)
    return StandingScores(
        false_motion=Score(largest, "m", "lower", frames, weight=float(bool(largest_m))),
        false_motion_end=mean(sum(ends_m), len(ends_m), "m"),
    )


class Rest(NamedTuple):
    """Numbers of the first and the last pose of a stretch in which the sensor stands."""

    first: int
    last: int


def rests(trajectories: Trajectories, stamps_s: np.ndarray) -> list[Rest]:
    """Return each stretch of at least `LEAST_REST_S` in which the sensor truly stands."""
    steps_m, steps_s = np.diff(trajectories.distances), np.diff(stamps_s)
    stands = np.concatenate([[False], steps_m <= AT_REST_M_S * steps_s, [False]])
    edges = np.flatnonzero(np.diff(stands.astype(np.int8))).tolist()
    stretches = [Rest(*pair) for pair in zip(edges[::2], edges[1::2], strict=True)]
    return [r for r in stretches if stamps_s[r.last] - stamps_s[r.first] >= LEAST_REST_S - 1e-9]


# --------------------------------------------------------------------------------------------------
# Returns of moving objects.


@dataclass(frozen=True, slots=True)
class MovingScores(ScoreFamily):
    """Precision and recall of the returns that an odometry classifies as dynamic, 0 to 1.

    dynamic_precision: share of these returns that are of moving objects; nan without one.
    dynamic_recall: share of the returns of moving objects that are among them; nan without one.
    """

    dynamic_precision: Score
    dynamic_recall: Score


def score_moving(dynamic: Sequence[np.ndarray], moving: Sequence[np.ndarray]) -> MovingScores:
    """Return the scores of one episode.

    dynamic: of each scan (N,) bool, returns that the odometry classifies as dynamic.
    moving: of each scan (N,) bool, returns of moving objects.
    """
    right = sum(int((a & b).sum()) for a, b in zip(dynamic, moving, strict=True))
    classified, true = sum(int(a.sum()) for a in dynamic), sum(int(b.sum()) for b in moving)
    return MovingScores(ratio(right, classified), ratio(right, true))
