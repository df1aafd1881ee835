"""Which metrics of perception predict those of driving: rank correlations over stacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.results.agreement import LEAST, spearman
from roadscope.benchmarks.results.job_scores import JobScores

RESAMPLES = 400
TAIL = 0.025


@dataclass(frozen=True, slots=True)
class Prediction:
    """How well a metric predicts another one.

    rho: Spearman's rank correlation over inputs, -1 to 1; positive: who is better in one is better
        in the other. low, high: its 95 % interval over episodes, which are drawn again with all
        their inputs; NaN with one seed.
    inputs: how many are compared.
    """

    metric: str
    predicted: str
    rho: float
    low: float
    high: float
    inputs: int


def predictions(jobs: Sequence[JobScores], board: str) -> list[Prediction]:
    """Return the correlations of a board's `predictors` with what they should predict.

    Entries with the same inputs are taken together; marks are left out.
    """
    described = board_named(board)
    sound = [j for j in jobs if j.board == board and j.reason is None and j.mark is None]
    names = list(dict.fromkeys(job.inputs for job in sound))
    episodes = list(dict.fromkeys((j.scenario, j.seed, j.condition) for j in sound))
    if len(names) < LEAST or not described.predictors:
        return []
    metrics = (*described.predictors, *described.predicted)
    tables = {metric: _table(sound, metric, names, episodes) for metric in metrics}
    rng = np.random.default_rng(0)
    several = len({job.seed for job in sound}) > 1
    draws = rng.integers(len(episodes), size=(RESAMPLES * several, len(episodes)))
    whole = np.arange(len(episodes))
    found = []
    for predicted in described.predicted:
        for metric in described.predictors:
            pair = tables[metric], tables[predicted]
            rho = _rho(*pair, whole)
            if not np.isfinite(rho):
                continue
            drawn = np.array([_rho(*pair, draw) for draw in draws])
            drawn = drawn[np.isfinite(drawn)]
            low, high = np.quantile(drawn, [TAIL, 1 - TAIL]) if len(drawn) else (np.nan, np.nan)
            found.append(Prediction(metric, predicted, rho, float(low), float(high), len(names)))
    return found


@dataclass(frozen=True, slots=True)
class _Table:
    """A metric by inputs and episode.

    sums, weights: (I, E) of weighted values and of their weights. sign: 1 if higher is better.
    """

    sums: np.ndarray
    weights: np.ndarray
    sign: float


def _table(
    jobs: Sequence[JobScores],
    metric: str,
    names: Sequence[str],
    episodes: Sequence[tuple[str, int, str]],
) -> _Table:
    shape = len(names), len(episodes)
    sums, weights, sign = np.zeros(shape), np.zeros(shape), 1.0
    for job in jobs:
        score: Score | None = job.scores.get(metric)
        if score is None or not np.isfinite(score.value) or score.weight <= 0:
            continue
        at = names.index(job.inputs), episodes.index((job.scenario, job.seed, job.condition))
        sums[at] += score.weight * score.value**score.power
        weights[at] += score.weight
        sign = 1.0 if score.better == "higher" else -1.0
    return _Table(sums, weights, sign)


def _rho(one: _Table, other: _Table, draw: np.ndarray) -> float:
    """Return the rank correlation of pooled values over the drawn episodes."""
    values = []
    for table in (one, other):
        with np.errstate(invalid="ignore", divide="ignore"):
            pooled = table.sums[:, draw].sum(axis=1) / table.weights[:, draw].sum(axis=1)
        values.append(table.sign * pooled)
    finite = np.isfinite(values).all(axis=0)
    if finite.sum() < LEAST:
        return float("nan")
    return spearman(values[0][finite].tolist(), values[1][finite].tolist())
