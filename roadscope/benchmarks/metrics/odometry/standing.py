"""Motion that is told while there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.odometry.relative import pair_errors
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean

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
