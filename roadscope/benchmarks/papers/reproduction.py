"""A paper's experiments, repeated: measured in parts, kept, summarised and judged."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from roadscope.benchmarks.cache import cache_dir, read_or_make
from roadscope.benchmarks.fingerprints import fingerprint, package_hash
from roadscope.benchmarks.workers import in_parallel

YES_OR_NO = "yes or no"
"""Unit of a claim: 1 where it holds and 0 where it does not. Tables print the words."""
POINTS, METRES_MORE, MILLISECONDS_MORE = "points", "m more", "ms more"
"""Units of differences, the first of percentages. Only differences can be negative."""
SEEDS = "% of seeds"
"""Unit of the share of seeds in which a claim holds."""
LOWER_BOUND = dict.fromkeys((POINTS, METRES_MORE, MILLISECONDS_MORE), -np.inf)
"""Least possible value by unit; 0 for the others."""
UPPER_BOUND = {YES_OR_NO: 1.0, "share": 1.0, SEEDS: 100.0, "%": 100.0}
"""Greatest possible value by unit; none for the others."""
FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds 10000 to 19999."""


class FigureKey(NamedTuple):
    """Names one figure: an experiment, what made the figure, and the quantity measured."""

    experiment: str
    method: str
    quantity: str


Figures = dict[FigureKey, float]
"""The figures of one seed; NaN where there is none."""
Measured = Mapping[FigureKey, Sequence[float]]
"""One value a seed, in the order of seeds; NaN for a seed without one."""


@dataclass(frozen=True, slots=True)
class ReproductionRow:
    """One quantity of one experiment.

    method: what made our figure, such as a detector and a tracker by their names.
    paper: the printed figure, None where the paper prints none.
    ours: mean over seeds; low, high: its 95 % interval; None where nothing was measured.
    n: number of seeds behind the mean.
    values: of the seeds, in their order; None for a seed without one. Empty where the figure is
        not one of seeds.
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
    values: tuple[float | None, ...] = ()

    def __post_init__(self) -> None:
        if self.paper is not None and self.ours is None:
            raise ValueError(
                f"{self.experiment}, {self.method}: the paper gives {self.paper} {self.unit} for "
                f"'{self.quantity}', and ours is missing"
            )


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a claim of a paper holds in our experiments.

    claim: what the paper claims. method: what was judged. unit: of the figure that judges it.
    verdict: one of `HOLDS`, `FAILS` and `OPEN`.
    value: mean over seeds; low, high: its 95 % interval, None with a single seed.
    n: number of seeds.
    """

    claim: str
    method: str
    unit: str
    verdict: str
    value: float | None
    low: float | None
    high: float | None
    n: int


@dataclass(frozen=True, slots=True)
class Reproduction:
    """What came out: verdicts on the claims, and all figures."""

    verdicts: list[Verdict]
    rows: list[ReproductionRow]


def student_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """Return the 95 % interval of the mean of finite values (Student's t), None of one value.

    It is not resampled: most seeds often agree to the last digit.
    """
    from scipy.special import stdtrit

    n = len(values)
    if n < 2:
        return None
    mean = float(np.mean(values))
    half_width = float(stdtrit(n - 1, 0.975)) * float(np.std(values, ddof=1)) / np.sqrt(n)
    return mean - half_width, mean + half_width


def summarise(
    key: FigureKey, unit: str, values: Sequence[float], paper: float | None = None
) -> ReproductionRow:
    """Return a row with the mean of one value a seed and its 95 % interval (Student's t).

    values: NaN for a seed that has none.
    """
    seed_values = tuple(float(value) if np.isfinite(value) else None for value in values)
    finite = [value for value in seed_values if value is not None]
    if not finite:
        return ReproductionRow(*key, unit, paper, None, None, None, 0, seed_values)
    low = high = None
    if interval := student_interval(finite):
        low = max(interval[0], LOWER_BOUND.get(unit, 0.0))
        high = min(interval[1], UPPER_BOUND.get(unit, np.inf))
    mean = float(np.mean(finite))
    return ReproductionRow(*key, unit, paper, mean, low, high, len(finite), seed_values)


# --------------------------------------------------------------------------------------------------
# Verdicts.

HOLDS, FAILS, OPEN = "holds", "does not hold", "open"
"""Verdicts. Open: the 95 % interval does not decide."""
NOT_CLAIMED = "not claimed: "
"""Begins what is judged although the paper does not claim it."""


class ClaimRange(NamedTuple):
    """A claim holds if its quantity is from `low` to `high`."""

    low: float = -np.inf
    high: float = np.inf


MORE_THAN_HALF = ClaimRange(low=50.0)
"""A claim about events holds if it holds in more than half of all seeds."""


MORE_THAN_NONE = ClaimRange(low=np.nextafter(0.0, 1.0))
"""Of a difference: the first is greater."""
LESS_THAN_NONE = ClaimRange(high=-np.nextafter(0.0, 1.0))
"""Of a difference: the first is less."""


def judge(
    claim: str, method: str, unit: str, values: Sequence[float], within: ClaimRange
) -> Verdict:
    """Judge a claim by one value a seed; seeds without a value (NaN) are left out.

    It holds if the 95 % interval of the mean lies within the limits, and does not hold if it lies
    outside. A single seed is judged by its value.
    """
    row = summarise(FigureKey("", "", ""), unit, values)
    if row.ours is None:
        return Verdict(claim, method, unit, OPEN, None, None, None, 0)
    low, high = (row.ours, row.ours) if row.low is None or row.high is None else (row.low, row.high)
    verdict = OPEN
    if within.low <= low and high <= within.high:
        verdict = HOLDS
    elif high < within.low or low > within.high:
        verdict = FAILS
    return Verdict(claim, method, unit, verdict, row.ours, row.low, row.high, row.n)


def judge_share(claim: str, method: str, holds: Sequence[float]) -> Verdict:
    """Judge a claim that each seed decides, 1 or 0: it holds if more than half of all seeds do.

    The 95 % interval of the share is Wilson's.
    """
    from scipy.stats import binomtest

    percent = [100 * each for each in holds]
    judged = judge(claim, method, SEEDS, percent, MORE_THAN_HALF)
    if judged.value is None or judged.n < 2:
        return judged
    yes = round(judged.value * judged.n / 100)
    low, high = binomtest(yes, judged.n).proportion_ci(method="wilson")
    verdict = HOLDS if low > 0.5 else FAILS if high < 0.5 else OPEN
    return replace(judged, verdict=verdict, low=100 * float(low), high=100 * float(high))


def differences(measured: Measured, key: FigureKey, other: FigureKey) -> list[float]:
    """Return the figure `key` minus the figure `other`, seed by seed."""
    return [a - b for a, b in zip(measured[key], measured[other], strict=True)]


# --------------------------------------------------------------------------------------------------
# All seeds of a paper, in parts that are kept.


def _nothing_more(figures: Figures) -> Figures:
    return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class Paper:
    """How the experiments of one paper are repeated.

    parts: functions that return the figures of a seed, by name. Each is kept on its own, so that a
        stopped run goes on where it was, and processes share them.
    of_seed: returns what follows from all figures of one seed.
    hidden: experiments whose figures only serve `of_seed`.
    rows: returns the rows of all tables.
    verdicts: judges the paper's claims.
    note_of: returns what must be known to read the tables of an experiment.
    """

    parts: Mapping[str, Callable[[int], Figures]]
    of_seed: Callable[[Figures], Figures] = _nothing_more
    hidden: frozenset[str] = frozenset()
    rows: Callable[[Measured], list[ReproductionRow]]
    verdicts: Callable[[Measured], list[Verdict]]
    note_of: Callable[[str], str | None]


class PartOfSeed(NamedTuple):
    """What one worker measures: a part of a module's paper with one seed."""

    module: str
    part: str
    seed: int


@dataclass(frozen=True, slots=True)
class KeptFigures:
    """Figures as a kept file."""

    figures: Figures

    def save(self, file: BinaryIO) -> None:
        """Write them as JSON; NaN becomes null."""
        rows = [
            [*key, value if np.isfinite(value) else None] for key, value in self.figures.items()
        ]
        file.write(json.dumps(rows).encode())

    @staticmethod
    def load(file: BinaryIO) -> KeptFigures:
        """Read what `save` wrote."""
        rows = json.loads(file.read())
        return KeptFigures(
            {FigureKey(*key): np.nan if value is None else value for *key, value in rows}
        )


def measure_part(part: PartOfSeed) -> Figures:
    """Return the figures of a part with a seed, those that an earlier run kept if there are any."""
    path = kept_path(part.module.rpartition(".")[2], part)
    measure = paper_of(part.module).parts[part.part]
    return read_or_make(path, KeptFigures.load, lambda: KeptFigures(measure(part.seed))).figures


def kept_path(paper: str, *what: object) -> Path:
    """Return where something that today's code measured for a paper is kept."""
    code = fingerprint([package_hash(), *what])
    return cache_dir() / "papers" / f"{paper}-{code}.cache"


def paper_of(module: str) -> Paper:
    """Return the paper that a module repeats."""
    paper: Paper = import_module(module).REPRODUCTION
    return paper


def measure_paper(
    module: str, seeds: int, progress: Callable[[int, int], None] | None = None, *, jobs: int = 1
) -> dict[FigureKey, list[float]]:
    """Return the figures of all parts and seeds of a paper, one value a seed.

    module: where its `REPRODUCTION` is. progress: called with parts done and parts in all.
    jobs: processes that share the parts; all figures but times are the same for any number.
    """
    if seeds < 1:
        raise ValueError(f"at least one seed is needed, got {seeds}")
    paper = paper_of(module)
    parts = [PartOfSeed(module, part, FIRST_SEED + k) for k in range(seeds) for part in paper.parts]
    if progress is not None:
        progress(0, len(parts))
    of_parts: dict[int, Figures] = {}
    for index, figures in in_parallel(measure_part, parts, jobs):
        of_parts[index] = figures
        if progress is not None:
            progress(len(of_parts), len(parts))
    of_seeds: list[Figures] = [{} for _ in range(seeds)]
    for index in sorted(of_parts):
        of_seeds[parts[index].seed - FIRST_SEED] |= of_parts[index]
    return by_figure([paper.of_seed(each) | each for each in of_seeds], paper.hidden)


def by_figure(
    of_seeds: Sequence[Figures], hidden: frozenset[str] = frozenset()
) -> dict[FigureKey, list[float]]:
    """Return one value a seed for each figure, NaN for a seed without it."""
    keys = dict.fromkeys(key for figures in of_seeds for key in figures)
    return {
        key: [figures.get(key, np.nan) for figures in of_seeds]
        for key in keys
        if key.experiment not in hidden
    }


def reproduce_module(
    module: str,
    seeds: int = 30,
    progress: Callable[[int, int], None] | None = None,
    *,
    jobs: int = 1,
) -> Reproduction:
    """Repeat the experiments of a paper and judge its claims; arguments as of `measure_paper`."""
    paper, measured = paper_of(module), measure_paper(module, seeds, progress, jobs=jobs)
    return Reproduction(paper.verdicts(measured), paper.rows(measured))


def write_reproduction(result: Reproduction, path: Path | str) -> None:
    """Write verdicts and rows as JSON."""
    content = {
        name: [asdict(each) for each in getattr(result, name)] for name in ("verdicts", "rows")
    }
    text = json.dumps(content, indent=1, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")
