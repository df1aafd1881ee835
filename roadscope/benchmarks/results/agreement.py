"""Rank correlations: of two boards, and of metrics of perception with those of driving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.results.rows import JobScores
from roadscope.core import Bounds

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
    def interval(self) -> Bounds | None:
        """The 95 % interval of rho over entries."""
        return rank_interval(self.rho, len(self.entries))

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


def rank_interval(rho: float, count: int) -> Bounds | None:
    """Return the 95 % interval of Spearman's rank correlation of `count` pairs.

    It is that of Bonett and Wright (2000): for other pairs of the same kind. None with three pairs,
    or if all ranks agree or all are reversed: nothing varies then.
    """
    if count <= LEAST_ENTRIES or abs(rho) > 1 - 1e-9:
        return None
    spread = NORMAL_95 * np.sqrt((1 + rho**2 / 2) / (count - 3))
    low, high = np.tanh(np.arctanh(rho) + np.array([-spread, spread]))
    return Bounds(float(low), float(high))


@dataclass(frozen=True, slots=True)
class Prediction:
    """How well a metric of the inputs of entries predicts how well entries do.

    rho: Spearman's rank correlation over inputs, -1 to 1; positive: inputs that are better in the
        metric also do better.
    over_inputs: its 95 % interval for other inputs of the same kind, by `rank_interval`.
    over_seeds: range of 95 % of its values for the same inputs when seeds are drawn again within
        each scenario, with all inputs and conditions of a seed; None with one seed.
    inputs: how many are compared. episodes: how many all of them have finished.
    """

    metric: str
    predicted: str
    rho: float
    over_inputs: Bounds | None
    over_seeds: Bounds | None
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
    episodes = len({_episode(job) for job in sound})
    correlations = []
    for predicted in described.predicted:
        for metric in described.predictors:
            pair = tables[metric], tables[predicted]
            rhos, counts = _rhos(*pair, draws)
            rho, count = float(rhos[0]), int(counts[0])
            if np.isfinite(rho):
                intervals = rank_interval(rho, count), _range(rhos[1:])
                prediction = Prediction(metric, predicted, rho, *intervals, count, episodes)
                correlations.append(prediction)
    return correlations


def _episode(job: JobScores) -> tuple[str, int, str]:
    return job.scenario, job.seed, job.condition


def _draws(blocks: Sequence[tuple[str, int]]) -> np.ndarray:
    """Return (D, B) rows of blocks: first all, then resamples of seeds within each scenario."""
    rng = np.random.default_rng(0)
    of_scenario = [
        np.flatnonzero([block[0] == scenario for block in blocks])
        for scenario in dict.fromkeys(block[0] for block in blocks)
    ]
    resamples = RESAMPLES if min(map(len, of_scenario)) > 1 else 0
    draws = [
        np.concatenate([rng.choice(rows, len(rows)) for rows in of_scenario])
        for _ in range(resamples)
    ]
    return np.array([np.arange(len(blocks)), *draws])


def _range(rhos: np.ndarray) -> Bounds | None:
    """Return the range of most resamples; None if too few of them have a value."""
    finite = rhos[np.isfinite(rhos)]
    if not len(rhos) or len(finite) < LEAST_MEASURED * len(rhos):
        return None
    low, high = np.quantile(finite, [TAIL, 1 - TAIL])
    return Bounds(float(low), float(high))


@dataclass(frozen=True, slots=True)
class _MetricTable:
    """A metric by inputs and block, a scenario with a seed.

    sums, weights: (I, B) of weighted values and of their weights. sign: 1 if higher is better.
    """

    sums: np.ndarray
    weights: np.ndarray
    sign: float


def _table(
    jobs: Sequence[JobScores], metric: str, names: Sequence[str], blocks: Sequence[tuple[str, int]]
) -> _MetricTable:
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
    return _MetricTable(sums, weights, sign)


def _rhos(
    one: _MetricTable, other: _MetricTable, draws: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (D,) rank correlations of the values in two tables, and (D,) of how many inputs.

    draws: (D, B) blocks over which values are pooled.
    """
    from scipy.stats import rankdata

    values = []
    for table in (one, other):
        with np.errstate(invalid="ignore", divide="ignore"):
            pooled = table.sums[:, draws].sum(axis=2) / table.weights[:, draws].sum(axis=2)
        values.append(table.sign * pooled.T)
    are_finite = np.isfinite(values).all(axis=0)
    counts = are_finite.sum(axis=1)
    centred = []
    for each in values:
        ranks = rankdata(np.where(are_finite, each, np.nan), axis=1, nan_policy="omit")
        means = np.nansum(ranks, axis=1, keepdims=True) / np.maximum(counts, 1)[:, None]
        centred.append(ranks - means)
    x, y = centred
    squares = np.nansum(x**2, axis=1) * np.nansum(y**2, axis=1)
    measured = (counts >= LEAST_ENTRIES) & (squares > 0)
    rhos = np.nansum(x * y, axis=1) / np.sqrt(np.where(measured, squares, np.nan))
    return rhos, counts
