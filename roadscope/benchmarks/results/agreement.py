"""Rank correlations: of two boards, and of metrics of perception with those of driving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.results.rows import JobScores

LEAST_ENTRIES = 3
"""Least number of entries that are compared: two can only agree or disagree completely."""
NORMAL_95 = 1.959964
"""The 97.5 % quantile of the standard normal distribution."""
RESAMPLES = 400
TAIL = 0.025
"""Share of the resampled correlations below their range, and above it."""
LEAST_MEASURED = 0.9
"""A correlation has a range if at least this share of its resamples has a value."""


@dataclass(frozen=True, slots=True)
class BoardAgreement:
    """Agreement of the ranks on a board with those on a suite.

    board: of recorded data.
    suite: of simulated traffic, with its version.
    rho: Spearman's rank correlation, -1 to 1.
    entries: those on both boards, in the order of the suite.
    """

    board: str
    suite: str
    rho: float
    entries: tuple[str, ...]

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of rho over entries (Bonett and Wright 2000).

        None with three entries, or if all ranks agree or all are reversed: nothing varies then.
        """
        count = len(self.entries)
        if count <= LEAST_ENTRIES or abs(self.rho) > 1 - 1e-9:
            return None
        spread = NORMAL_95 * np.sqrt((1 + self.rho**2 / 2) / (count - 3))
        low, high = np.tanh(np.arctanh(self.rho) + np.array([-spread, spread]))
        return float(low), float(high)

    @staticmethod
    def of(
        board: str, suite: str, recorded: Mapping[str, float], simulated: Mapping[str, float]
    ) -> BoardAgreement | None:
        """Return the rank correlation of entries; None with fewer than three on both boards.

        Entries without a figure (NaN) are left out. None also if all figures of a board are equal.
        """
        both = [
            entry
            for entry, figure in simulated.items()
            if np.isfinite([figure, recorded.get(entry, np.nan)]).all()
        ]
        if len(both) < LEAST_ENTRIES:
            return None
        rho = spearman([simulated[entry] for entry in both], [recorded[entry] for entry in both])
        return BoardAgreement(board, suite, rho, tuple(both)) if np.isfinite(rho) else None


def spearman(ones: Sequence[float], others: Sequence[float]) -> float:
    """Return Spearman's rank correlation; NaN if all values of one side are equal."""
    from scipy.stats import spearmanr

    if min(len(set(ones)), len(set(others))) < 2:
        return float("nan")
    return float(spearmanr(ones, others).statistic)


@dataclass(frozen=True, slots=True)
class Prediction:
    """How well a metric of the inputs of entries predicts how well entries do.

    rho: Spearman's rank correlation over inputs, -1 to 1; positive: inputs that are better in the
        metric also do better.
    low, high: range of 95 % of its values when seeds are drawn again within each scenario, with all
        inputs and conditions of a seed; NaN with one seed.
    inputs: how many are compared. episodes: how many all of them have finished.
    """

    metric: str
    predicted: str
    rho: float
    low: float
    high: float
    inputs: int
    episodes: int


def predictions(jobs: Sequence[JobScores], board: str) -> list[Prediction]:
    """Return the correlations of a board's `predictors` with what they should predict.

    Entries with the same inputs are taken together. Marks are left out, and episodes that an entry
    has not finished.
    """
    described = board_named(board)
    ranked = [job for job in jobs if job.board == board and job.mark is None]
    names = list(dict.fromkeys(job.inputs for job in ranked))
    failed = {_episode(job) for job in ranked if job.reason is not None}
    sound = [job for job in ranked if _episode(job) not in failed]
    blocks = list(dict.fromkeys((job.scenario, job.seed) for job in sound))
    if len(names) < LEAST_ENTRIES or not described.predictors or not blocks:
        return []
    metrics = (*described.predictors, *described.predicted)
    tables = {metric: _table(sound, metric, names, blocks) for metric in metrics}
    draws = _draws(blocks)
    found = []
    for predicted in described.predicted:
        for metric in described.predictors:
            pair = tables[metric], tables[predicted]
            rho = _rho(*pair, np.arange(len(blocks)))
            if np.isfinite(rho):
                low, high = _range([_rho(*pair, draw) for draw in draws])
                episodes = len({_episode(job) for job in sound})
                found.append(Prediction(metric, predicted, rho, low, high, len(names), episodes))
    return found


def _episode(job: JobScores) -> tuple[str, int, str]:
    return job.scenario, job.seed, job.condition


def _draws(blocks: Sequence[tuple[str, int]]) -> list[np.ndarray]:
    """Return resamples of the rows of blocks: seeds are drawn within each scenario."""
    rng = np.random.default_rng(0)
    of_scenario = [
        np.flatnonzero([block[0] == scenario for block in blocks])
        for scenario in dict.fromkeys(block[0] for block in blocks)
    ]
    if min(map(len, of_scenario)) < 2:
        return []
    return [
        np.concatenate([rng.choice(rows, len(rows)) for rows in of_scenario])
        for _ in range(RESAMPLES)
    ]


def _range(rhos: Sequence[float]) -> tuple[float, float]:
    """Return the range of most resamples; NaN if too few of them have a value."""
    finite = np.array(rhos)[np.isfinite(rhos)]
    if not len(rhos) or len(finite) < LEAST_MEASURED * len(rhos):
        return np.nan, np.nan
    low, high = np.quantile(finite, [TAIL, 1 - TAIL])
    return float(low), float(high)


@dataclass(frozen=True, slots=True)
class _Table:
    """A metric by inputs and block, a scenario with a seed.

    sums, weights: (I, B) of weighted values and of their weights. sign: 1 if higher is better.
    """

    sums: np.ndarray
    weights: np.ndarray
    sign: float


def _table(
    jobs: Sequence[JobScores], metric: str, names: Sequence[str], blocks: Sequence[tuple[str, int]]
) -> _Table:
    shape = len(names), len(blocks)
    sums, weights, sign = np.zeros(shape), np.zeros(shape), 1.0
    for job in jobs:
        score = job.scores.get(metric)
        if score is None or not np.isfinite(score.value) or score.weight <= 0:
            continue
        at = names.index(job.inputs), blocks.index((job.scenario, job.seed))
        sums[at] += score.weight * score.value**score.power
        weights[at] += score.weight
        sign = 1.0 if score.better == "higher" else -1.0
    return _Table(sums, weights, sign)


def _rho(one: _Table, other: _Table, draw: np.ndarray) -> float:
    """Return the rank correlation of pooled values over the drawn blocks."""
    values = []
    for table in (one, other):
        with np.errstate(invalid="ignore", divide="ignore"):
            pooled = table.sums[:, draw].sum(axis=1) / table.weights[:, draw].sum(axis=1)
        values.append(table.sign * pooled)
    finite = np.isfinite(values).all(axis=0)
    if finite.sum() < LEAST_ENTRIES:
        return float("nan")
    return spearman(values[0][finite].tolist(), values[1][finite].tolist())
