"""What the methods make of one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.benchmarks.papers.zhang2017_errors import (
    errors,
    nees,
    rmse,
    scored,
    typical,
)
from roadscope.benchmarks.papers.zhang2017_methods import METHODS, estimate
from roadscope.benchmarks.papers.zhang2017_scene import Run, film


@dataclass(frozen=True, slots=True)
class Taken:
    """One run.

    frames, few: all frames, and those with too few returns to be scored.
    rmse: columns of tables 1 and 2 by method.
    beside: medians, and percentages of scored frames, by method.
    nees: by method that gives a covariance.
    spent: milliseconds of each frame that was answered alone, by method.
    """

    drive: str
    body: str
    frames: int
    few: int
    rmse: dict[str, dict[str, float]]
    beside: dict[str, dict[str, float]]
    nees: dict[str, float]
    spent: dict[str, np.ndarray]


def take(run: Run, methods: Sequence[str]) -> Taken:
    """Run the methods."""
    few = int((~scored(run)).sum())
    taken = Taken(run.drive.name, run.body, len(run.shots), few, {}, {}, {}, {})
    for name in methods:
        poses, taken.spent[name] = estimate(METHODS[name], run)
        found = errors(run, poses)
        taken.rmse[name] = rmse(run, found)
        taken.beside[name] = typical(run, found)
        if np.isfinite(consistency := nees(run, poses)):
            taken.nees[name] = consistency
    return taken


@cache
def warm_up() -> None:
    """Have everything compiled, once a process, so that no frame's time tells of it."""
    for drive in ("curve", "following-10"):
        take(film(drive, 0, frames=4), tuple(METHODS))
