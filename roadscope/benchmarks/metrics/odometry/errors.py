"""Absolute, relative and drift errors of trajectories, and how these are aligned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories, angles, inverses, motions
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean
from roadscope.core.names import unknown
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Which motion brings an estimated trajectory nearest to the true one.

Alignment = Literal["none", "origin", "yaw", "se3"]
ALIGNMENTS = ("none", "origin", "yaw", "se3")


def aligned(both: Trajectories, how: Alignment) -> np.ndarray:
    """Return the (N, 4, 4) estimated poses in the truth's frame.

    none: as they are, for poses told in the same frame. origin: first pose on first pose, which
    needs no look at the rest. yaw: the shift and the turn about z, se3: the whole motion, with
    the least sum of squared distances (Umeyama 1991, without scale).
    """
    if how not in ALIGNMENTS:
        raise ValueError(unknown("alignment", how, ALIGNMENTS))
    if how == "none" or not len(both):
        return both.estimate
    if how == "origin":
        moved: np.ndarray = both.truth[0] @ np.linalg.inv(both.estimate[0]) @ both.estimate
        return moved
    moved = (
        truth_from_estimate(both.estimate[:, :3, 3], both.truth[:, :3, 3], yaw_only=how == "yaw")
        @ both.estimate
    )
    return moved


def truth_from_estimate(
    estimate: np.ndarray, truth: np.ndarray, *, yaw_only: bool = False
) -> np.ndarray:
    """Return the (4, 4) motion that brings (N, 3) places nearest to others.

    Where places leave a turn open, all on one line, say, one of the best is returned.
    """
    centre, aim = estimate.mean(axis=0), truth.mean(axis=0)
    spread = (truth - aim).T @ (estimate - centre) / len(truth)
    matrix = np.eye(4)
    if yaw_only:
        yaw = np.arctan2(spread[1, 0] - spread[0, 1], spread[0, 0] + spread[1, 1])
        cos, sin = np.cos(yaw), np.sin(yaw)
        matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    else:
        left, _, right = np.linalg.svd(spread)
        mirror = np.sign(np.linalg.det(left) * np.linalg.det(right))
        matrix[:3, :3] = left @ np.diag([1.0, 1.0, mirror]) @ right
    matrix[:3, 3] = aim - matrix[:3, :3] @ centre
    return matrix


# --------------------------------------------------------------------------------------------------
# ATE: how far estimated places are from true ones.


@dataclass(frozen=True, slots=True, eq=False)
class AbsoluteErrors(Record):
    """Absolute trajectory errors (Sturm et al. 2012) of each pose.

    positions_m: (N,) metres. rotations_rad: (N,) radians. distances_m: (N,) driven so far.
    """

    positions_m: np.ndarray
    rotations_rad: np.ndarray
    distances_m: np.ndarray

    def __len__(self) -> int:
        return len(self.positions_m)

    @property
    def rmse_m(self) -> float:
        """Root mean square of the positions' errors: what is called ATE."""
        return float(np.sqrt(np.mean(self.positions_m**2))) if len(self) else np.nan

    @property
    def end_m(self) -> float:
        """Error of the last position."""
        return float(self.positions_m[-1]) if len(self) else np.nan


def absolute_errors(both: Trajectories, alignment: Alignment = "se3") -> AbsoluteErrors:
    """Return how far each pose is from the true one, once the trajectories are aligned."""
    rest = inverses(both.truth) @ aligned(both, alignment)
    return AbsoluteErrors(
        np.linalg.norm(rest[:, :3, 3], axis=1), angles(rest[:, :3, :3]), both.distances
    )


# --------------------------------------------------------------------------------------------------
# RPE: how far off motions are from one pose to a later one.


@dataclass(frozen=True, slots=True, eq=False)
class RelativeErrors(Record):
    """Relative pose errors (Sturm et al. 2012), one a pair of poses.

    translations_m: (K,) metres. rotations_rad: (K,) radians. lengths_m: (K,) metres driven
        from the first to the second of a pair, in truth.
    """

    translations_m: np.ndarray
    rotations_rad: np.ndarray
    lengths_m: np.ndarray

    def __len__(self) -> int:
        return len(self.translations_m)

    @property
    def rmse_m(self) -> float:
        """Root mean square of the translations' errors."""
        return float(np.sqrt(np.mean(self.translations_m**2))) if len(self) else np.nan

    @property
    def rmse_rad(self) -> float:
        """Root mean square of the rotations' errors."""
        return float(np.sqrt(np.mean(self.rotations_rad**2))) if len(self) else np.nan


def relative_errors(both: Trajectories, step: int = 1) -> RelativeErrors:
    """Return the errors of the motions between all poses that are so many frames apart."""
    if step < 1:
        raise ValueError(f"step must be 1 or more frames, got {step}")
    first = np.arange(max(len(both) - step, 0))
    return pair_errors(both, first, first + step)


def pair_errors(both: Trajectories, first: np.ndarray, last: np.ndarray) -> RelativeErrors:
    """Return the errors of the motions between poses by their numbers, (K,) each."""
    rest = inverses(motions(both.truth, first, last)) @ motions(both.estimate, first, last)
    lengths_m = both.distances[last] - both.distances[first]
    return RelativeErrors(
        np.linalg.norm(rest[:, :3, 3], axis=1), angles(rest[:, :3, :3]), lengths_m
    )


# --------------------------------------------------------------------------------------------------
# t_rel and r_rel: drift over stretches of given lengths, as KITTI has it.

SHORT_M = (50.0, 100.0, 200.0)
KITTI_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
KITTI_EVERY = 10
"""KITTI begins a stretch at every tenth frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Drift(Record):
    """Errors of motions over stretches of the way, divided by their length.

    lengths_m: (K,) metres, nominal length of each stretch. first: (K,) its first pose.
    translations: (K,) metres a metre. rotations: (K,) radians a metre.
    """

    lengths_m: np.ndarray
    first: np.ndarray
    translations: np.ndarray
    rotations: np.ndarray

    def __len__(self) -> int:
        return len(self.lengths_m)

    @property
    def t_rel(self) -> float:
        """Mean translation error in per cent of the length; NaN where no stretch is long enough."""
        return float(100 * self.translations.mean()) if len(self) else np.nan

    @property
    def r_rel(self) -> float:
        """Mean rotation error in degrees a 100 m."""
        return float(100 * np.rad2deg(self.rotations.mean())) if len(self) else np.nan

    def over(self, length_m: float) -> Drift:
        """Return the stretches of one length."""
        rows = self.lengths_m == length_m
        return Drift(
            self.lengths_m[rows], self.first[rows], self.translations[rows], self.rotations[rows]
        )

    def curve(self) -> list[tuple[float, float, float, int]]:
        """Return, by length in metres, t_rel, r_rel and the number of stretches."""
        parts = [(float(m), self.over(m)) for m in np.unique(self.lengths_m)]
        return [(m, part.t_rel, part.r_rel, len(part)) for m, part in parts]


def drift(
    both: Trajectories, lengths_m: Sequence[float] = SHORT_M, *, every: int = KITTI_EVERY
) -> Drift:
    """Return the drift over all stretches of these lengths that begin at every so many-th frame.

    A stretch ends with the first pose farther along the true way than its length; one that the
    way does not hold is left out. With `KITTI_M` this is KITTI's definition.
    """
    if every < 1:
        raise ValueError(f"every must be 1 or more frames, got {every}")
    if not all(length_m > 0 for length_m in lengths_m):
        raise ValueError(f"lengths must be above 0 m, got {tuple(lengths_m)}")
    way, begins = both.distances, np.arange(0, len(both), every)
    first, nominal = (a.ravel() for a in np.meshgrid(begins, lengths_m, indexing="ij"))
    last = np.searchsorted(way, way[first] + nominal, side="right")
    whole = last < len(both)
    first, last, nominal = first[whole], last[whole], nominal[whole]
    errors = pair_errors(both, first, last)
    return Drift(nominal, first, errors.translations_m / nominal, errors.rotations_rad / nominal)


# --------------------------------------------------------------------------------------------------
# Drift against the distance driven.

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


# --------------------------------------------------------------------------------------------------
# Motion that is told while there is none.

AT_REST_M_S = 0.1
"""A sensor slower than this stands; a body that rocks on its springs after braking does so too."""
LEAST_S = 1.0
"""Shorter rests tell nothing of drift."""


@dataclass(frozen=True, slots=True)
class StandingScores(ScoreFamily):
    """What an odometry told of a sensor that stood.

    false_motion: largest distance from where a rest began, over all rests of an episode.
    false_motion_end: distance at the end of a rest, mean of the rests.
    """

    false_motion: Score
    false_motion_end: Score


def score_standing(both: Trajectories, stamps_s: np.ndarray) -> StandingScores:
    """Return the false motion of one episode; (N,) stamps. Without a rest nothing is measured.

    What the sensor truly moved meanwhile is taken off.
    """
    largest, ends, frames = [], [], 0
    for first, last in rests(both, stamps_s):
        rows = np.arange(first, last + 1)
        off = pair_errors(both, np.full(len(rows), first), rows).translations_m
        largest.append(float(off.max()))
        ends.append(float(off[-1]))
        frames += len(rows)
    return StandingScores(
        Score(max(largest, default=np.nan), "m", "lower", frames, weight=float(bool(largest))),
        mean(sum(ends), len(ends), "m"),
    )


def rests(both: Trajectories, stamps_s: np.ndarray) -> list[tuple[int, int]]:
    """Return first and last pose of each stretch in which the sensor truly stood."""
    steps_m, steps_s = np.diff(both.distances), np.diff(stamps_s)
    still = np.concatenate([[False], steps_m <= AT_REST_M_S * steps_s, [False]])
    edges = np.flatnonzero(np.diff(still.astype(np.int8)))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(a, b) for a, b in pairs if stamps_s[b] - stamps_s[a] >= LEAST_S - 1e-9]
