"""Confidence intervals of means over episodes, also for few seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.benchmarks.metrics.score import Score

SMALL = 10
"""Strata below this size get Student's t: studentised resampling is unstable there."""
DEGENERATE = 0.01
"""A resample with less than this share of the variance is degenerate; more than this share of
degenerate resamples makes the bootstrap unusable."""
MOST_EXACT = 13
"""Most episodes for which all flips of signs are tried: 2 to the power of their number."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean with its confidence interval; low and high are NaN where it has none.

    n: number of values that were not NaN.
    """

    mean: float
    low: float
    high: float
    n: int

    def clipped(self, least: float, most: float) -> Interval:
        """Return the interval with its ends clipped to the range of possible values."""
        low, high = np.clip([self.low, self.high], least, most)
        return Interval(self.mean, float(low), float(high), self.n)


def mean_interval(
    values: Sequence[float] | np.ndarray,
    strata: Sequence[object] | None = None,
    *,
    level: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Return the mean of values over seeds, each stratum (scenario) weighing the same.

    The seeds are the sample, the strata are fixed. With 10 values or more in every stratum the
    interval is the bootstrap-t (Efron and Tibshirani 1993, ch. 12.5), which follows skewed
    values; below that, and where most values are alike, Student's t with Welch-Satterthwaite
    degrees of freedom. BCa and percentile intervals cover too little under 30 values. NaN
    values are left out.
    """
    from scipy.special import stdtrit

    groups = _grouped(np.asarray(values, np.float64), strata)
    n = sum(map(len, groups))
    if n == 0:
        return Interval(np.nan, np.nan, np.nan, 0)
    mean, error, freedom = _mean_and_error(groups)
    if not np.isfinite(error):
        return Interval(mean, np.nan, np.nan, n)
    if error <= 1e-12 * max(abs(mean), 1e-3):
        return Interval(mean, mean, mean, n)
    tail = (1 - level) / 2
    t_high = float(stdtrit(freedom, 1 - tail))
    t_low = -t_high
    if min(map(len, groups)) >= SMALL:
        drawn = _studentised(groups, resamples, np.random.default_rng(0))
        if drawn is not None:
            t_low, t_high = np.quantile(drawn, [tail, 1 - tail])
    return Interval(mean, float(mean - t_high * error), float(mean - t_low * error), n)


def pooled_interval(scores: Sequence[Score], strata: Sequence[object] | None = None) -> Interval:
    """Return a score pooled over episodes by weight, with an interval.

    The pooled value is a ratio of sums, in RMS errors the root of one; its spread over episodes
    is that of the linearised ratio (Cochran 1977, ch. 6), w_i (x_i - r) / mean(w), to which
    `mean_interval` is applied. Episodes in which nothing was measured are left out.
    """
    used = [i for i, s in enumerate(scores) if measured(s)]
    if not used:
        return Interval(np.nan, np.nan, np.nan, 0)
    power = scores[used[0]].power
    pooled, influence = _ratio([scores[i] for i in used])
    labels = None if strata is None else [strata[i] for i in used]
    spread = mean_interval(influence, labels)
    ends = pooled + np.array([spread.low, spread.high]) - spread.mean
    if power > 1:
        ends, pooled = np.maximum(ends, 0.0) ** (1 / power), pooled ** (1 / power)
    return Interval(pooled, float(ends[0]), float(ends[1]), len(used))


def paired_interval(
    ones: Sequence[Score],
    others: Sequence[Score],
    strata: Sequence[object] | None = None,
    *,
    level: float = 0.95,
) -> Interval:
    """Return by how much one pooled score exceeds another on the same episodes, with an interval.

    Both are linearised (`linearised`) and subtracted episode by episode, so what makes an episode
    hard for both cancels. Episodes in which either measured nothing are left out.
    """
    pairs = list(zip(ones, others, strict=True))
    used = [i for i, pair in enumerate(pairs) if all(measured(s) for s in pair)]
    if not used:
        return Interval(np.nan, np.nan, np.nan, 0)
    one, influence = linearised([ones[i] for i in used])
    other, other_influence = linearised([others[i] for i in used])
    labels = None if strata is None else [strata[i] for i in used]
    interval = mean_interval(influence - other_influence, labels, level=level)
    shift = one - other - interval.mean
    return Interval(one - other, interval.low + shift, interval.high + shift, len(used))


def paired_p_value(
    ones: Sequence[Score], others: Sequence[Score], strata: Sequence[object]
) -> float:
    """Return the p-value of no difference of two pooled scores on the same episodes.

    It is that of Student's t, stratified, with the degrees of freedom of Welch and Satterthwaite.
    Where several episodes differ by the same amount, as counts do, Student's t gives too small
    p-values for few episodes: the result is then at least that of the exact test of sign flips.
    NaN if no stratum has two episodes. All scores must be measured.
    """
    from scipy.special import stdtr
    from scipy.stats import permutation_test

    one, influence = linearised(ones)
    other, other_influence = linearised(others)
    difference = one - other
    amounts = np.array([a.value - b.value for a, b in zip(ones, others, strict=True)])
    if not amounts.any() and difference == 0:
        return 1.0
    shares = difference + influence - other_influence
    _, error, freedom = _mean_and_error(_grouped(shares, strata))
    if np.isnan(error):
        return float("nan")
    student = 0.0
    if error > 1e-12 * float(np.abs(shares).max(initial=0.0)):
        student = 2 * float(stdtr(freedom, -abs(difference) / error))
    sizes = np.abs(amounts[amounts != 0])
    if len(np.unique(np.round(sizes / sizes.max(initial=0), 9))) == len(sizes):
        return student
    if len(shares) > MOST_EXACT:
        return max(student, 2.0 ** (1 - len(sizes)))
    of_sign_flips = permutation_test(
        (shares,),
        lambda x, axis: x.mean(axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=2**MOST_EXACT,
    )
    return max(student, float(of_sign_flips.pvalue))


def linearised(scores: Sequence[Score]) -> tuple[float, np.ndarray]:
    """Return the pooled value of scores, all measured, and the (N,) influence of each on it.

    RMS errors are linearised at their pooled value (the delta method).
    """
    power = scores[0].power
    pooled, influence = _ratio(scores)
    if power == 1:
        return pooled, influence
    root = pooled ** (1 / power)
    slope = power * root ** (power - 1)
    return root, influence / slope if slope else influence


def _ratio(scores: Sequence[Score]) -> tuple[float, np.ndarray]:
    """Return the weighted mean of values to their power, and the spread of its linearisation."""
    x = np.array([s.value for s in scores]) ** scores[0].power
    w = np.array([s.weight for s in scores])
    pooled = float((w * x).sum() / w.sum())
    return pooled, w * (x - pooled) / w.mean()


def merged(scores: Sequence[Score]) -> Score:
    """Return a score pooled over dependent episodes, such as one in two weathers."""
    used = [s for s in scores if measured(s)]
    first = used[0] if used else scores[0]
    if len(used) < 2:
        return first
    weight = sum(s.weight for s in used)
    power = sum(s.weight * s.value**first.power for s in used) / weight
    n = sum(s.n for s in used)
    return replace(first, value=power ** (1 / first.power), n=n, weight=weight)


def measured(score: Score) -> bool:
    """Return whether a score has a value that counts."""
    return bool(np.isfinite(score.value)) and score.weight > 0


def _grouped(values: np.ndarray, strata: Sequence[object] | None) -> list[np.ndarray]:
    """Return the values of each stratum that are not NaN."""
    labels = [str(s) for s in strata] if strata is not None else [""] * len(values)
    finite = [(s, v) for s, v in zip(labels, values, strict=True) if np.isfinite(v)]
    names = sorted({s for s, _ in finite})
    return [np.array([v for s, v in finite if s == name]) for name in names]


def _mean_and_error(groups: list[np.ndarray]) -> tuple[float, float, float]:
    """Return the mean over strata, its standard error and the degrees of freedom.

    A stratum of one value gets the pooled variance of the others; NaN if all have one value.
    """
    mean = float(np.mean([g.mean() for g in groups]))
    repeated = [g for g in groups if len(g) > 1]
    if not repeated:
        return mean, np.nan, np.nan
    pooled = sum(((g - g.mean()) ** 2).sum() for g in repeated) / sum(len(g) - 1 for g in repeated)
    shares = [(g.var(ddof=1) if len(g) > 1 else pooled) / len(g) for g in groups]
    variance = sum(shares) / len(groups) ** 2
    spread = (
        sum(s**2 / (len(g) - 1) for s, g in zip(shares, groups, strict=True) if len(g) > 1)
        / len(groups) ** 4
    )
    freedom = variance**2 / spread if spread > 0 else 1.0
    return mean, float(np.sqrt(variance)), float(max(freedom, 1.0))


def _studentised(
    groups: list[np.ndarray], resamples: int, rng: np.random.Generator
) -> np.ndarray | None:
    """Return the studentised mean of resamples within strata, (R,).

    If a few values differ from many equal ones, resamples without those few have nearly no variance
    and the quotient is unbounded: then None.
    """
    shift, variance = np.zeros(resamples), np.zeros(resamples)
    observed = 0.0
    for group in groups:
        drawn = group[rng.integers(len(group), size=(resamples, len(group)))]
        shift += (drawn.mean(axis=1) - group.mean()) / len(groups)
        variance += drawn.var(axis=1, ddof=1) / len(group) / len(groups) ** 2
        observed += float(group.var(ddof=1)) / len(group) / len(groups) ** 2
    if (variance < DEGENERATE * observed).mean() > DEGENERATE:
        return None
    studentised: np.ndarray = shift / np.sqrt(np.maximum(variance, DEGENERATE * observed))
    return studentised
