"""How well an odometry tells which returns are of things that move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.score import Score, ScoreFamily, ratio


@dataclass(frozen=True, slots=True)
class MovingScores(ScoreFamily):
    """Of returns held to be dynamic, against the truth.

    dynamic_precision: share of them that are. dynamic_recall: share of those that are which were
        held to be.
    """

    dynamic_precision: Score
    dynamic_recall: Score


def score_moving(told: Sequence[np.ndarray], moving: Sequence[np.ndarray]) -> MovingScores:
    """Return the scores of one episode from (N,) bool of every scan, told and true."""
    right = sum(int((a & b).sum()) for a, b in zip(told, moving, strict=True))
    claimed, there = sum(int(a.sum()) for a in told), sum(int(b.sum()) for b in moving)
    return MovingScores(ratio(right, claimed), ratio(right, there))
