"""What the methods make of one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.benchmarks.papers.zhang2017_errors import (
    errors,
    floor_nees,
    floor_rmse,
    nees,
    rmse,
    scored,
    typical,
)
from roadscope.benchmarks.papers.zhang2017_floor import floors
from roadscope.benchmarks.papers.zhang2017_methods import METHODS, OURS, estimate
from roadscope.benchmarks.papers.zhang2017_names import floor_name
from roadscope.benchmarks.papers.zhang2017_scene import Run, film

FLOOR_DRAWS = 512


@dataclass(frozen=True, slots=True)
class Taken:
    """One run.

    frames, few: all frames, and those with too few returns to be scored.
    rmse: columns of tables 1 and 2 by method, the information floors among them.
    beside: medians, and percentages of scored frames, by method.
    nees: by method that gives a covariance, the floors' posteriors among them.
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


def take(run: Run, methods: Sequence[str], *, floored: bool = False) -> Taken:
    """Run the methods, and, if floored, compute the floors of as many frames as ours use."""
    few = int((~scored(run)).sum())
    taken = Taken(run.drive.name, run.body, len(run.shots), few, {}, {}, {}, {})
    for name in methods:
        poses, taken.spent[name] = estimate(METHODS[name], run)
        found = errors(run, poses)
        taken.rmse[name] = rmse(run, found)
        taken.beside[name] = typical(run, found)
        if np.isfinite(consistency := nees(run, poses)):
            taken.nees[name] = consistency
    for told in (False, True) if floored else ():
        found_by = floors(
            run, tuple(OURS.values()), draws=FLOOR_DRAWS,
            knows_corners=told, knows_acceleration=told,
        )  # fmt: skip
        for frames, least in found_by.items():
            name = floor_name(frames, told=told)
            taken.rmse[name] = floor_rmse(run, least, expected=told)
            taken.nees[name] = floor_nees(run, least)
    return taken


@cache
def warm_up() -> None:
    """Have everything compiled, once a process, so that no frame's time tells of it."""
    for drive in ("curve", "following-10"):
        take(film(drive, 0, frames=4), tuple(METHODS))
