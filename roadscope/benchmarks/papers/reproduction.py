"""A paper's figures beside ours."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.workers import in_parallel


@dataclass(frozen=True, slots=True)
class ReproductionRow:
    """One quantity of one experiment.

    method: what made our figure, a detector and a tracker by their names.
    paper: the printed figure, None where the paper prints none.
    ours: mean over seeds; low, high: its 95 % interval; None where nothing was measured.
    n: number of seeds behind it.
    """

    experiment: str
    method: str
    quantity: str
    unit: str
    paper: float | None
    ours: float | None
    low: float | None
    high: float | None
    n: int

    def __post_init__(self) -> None:
        if self.paper is not None and self.ours is None:
            raise ValueError(
                f"{self.experiment}, {self.method}: the paper gives {self.paper} {self.unit} for "
                f"'{self.quantity}', and ours is missing"
            )


YES_OR_NO = "yes or no"
"""Unit of what is 1 where a claim holds and 0 where it does not; tables say it in words."""
POINTS = "points"
"""Unit of a difference of percentages, which alone can be negative."""
LEAST = {POINTS: -np.inf}
MOST = {YES_OR_NO: 1.0, "share": 1.0, "%": 100.0}
Key = tuple[str, str, str]
"""Experiment, method, quantity."""


def over_seeds(
    measure: Callable[[int], dict[Key, float]],
    seeds: Sequence[int],
    progress: Callable[[int, int], None] | None = None,
    *,
    jobs: int = 1,
) -> dict[Key, list[float]]:
    """Return what is measured with each seed, in the order of seeds; a seed need not have all.

    progress: called with seeds done and seeds in all, after each.
    jobs: processes that share the seeds.
    """
    if not seeds:
        raise ValueError(f"at least one seed is needed, got {len(seeds)}")
    found: list[dict[Key, float]] = [{} for _ in seeds]
    for done, (index, values) in enumerate(in_parallel(measure, seeds, jobs), start=1):
        found[index] = values
        if progress is not None:
            progress(done, len(seeds))
    measured: dict[Key, list[float]] = {}
    for values in found:
        for key, value in values.items():
            measured.setdefault(key, []).append(value)
    return measured


def summarise(
    place: tuple[str, str], quantity: str, unit: str, values: Sequence[float], paper: float | None
) -> ReproductionRow:
    """Make a row from one value a seed; NaN stands for a seed that has none.

    place: experiment and method. The interval is Student's t: most seeds often agree to the last
    digit, where resampling has nothing to go by.
    """
    known = np.array([value for value in values if np.isfinite(value)])
    n = len(known)
    if n == 0:
        return ReproductionRow(*place, quantity, unit, paper, None, None, None, 0)
    mean = float(known.mean())
    if n == 1:
        return ReproductionRow(*place, quantity, unit, paper, mean, None, None, 1)
    half = _student_quantile(n - 1) * float(known.std(ddof=1)) / np.sqrt(n)
    low = max(mean - half, LEAST.get(unit, 0.0))
    high = min(mean + half, MOST.get(unit, np.inf))
    return ReproductionRow(*place, quantity, unit, paper, mean, float(low), float(high), n)


def _student_quantile(freedom: int) -> float:
    """Return the 97.5 % quantile of Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975))


def write_rows(rows: Sequence[ReproductionRow], path: Path | str) -> None:
    """Write rows as a JSON list."""
    text = json.dumps([asdict(row) for row in rows], indent=1, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")
