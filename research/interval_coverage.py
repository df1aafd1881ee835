"""How often the intervals and verdicts of boards are right, on values whose truth is known.

python -m research.interval_coverage --trials 1000

The table shows how often a 95 % interval covers the true mean: ours, beside the BCa and the
percentile bootstrap. Then two entries are compared on many metrics at once, of which none or some
differ: which share of the verdicts of `roadscope compare` is false, and how many of the true
differences are noticed.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import bootstrap

from roadscope import compare
from roadscope.benchmarks.metrics import ratio
from roadscope.benchmarks.results import mean_interval, paired_interval, pooled_interval

Draw = Callable[[np.random.Generator, int], np.ndarray]

VALUES: Mapping[str, tuple[Draw, float]] = {
    "normal": (lambda rng, n: rng.normal(2.0, 1.0, n), 2.0),
    "skewed (exponential)": (lambda rng, n: rng.exponential(1.0, n), 1.0),
    "rates near 1 (beta 18, 2)": (lambda rng, n: rng.beta(18, 2, n), 0.9),
    "one in ten fails (0 or 1)": (lambda rng, n: (rng.random(n) < 0.9).astype(float), 0.9),
}
"""Values of episodes: how they are drawn, and their true mean."""
SEEDS = (3, 5, 10, 20, 30)
METRICS, DIFFERING = 20, 5


def covered(low: float, high: float, truth: float) -> bool:
    """Return whether an interval holds the truth; one without ends does not."""
    return bool(low <= truth <= high)


def coverage(draw: Draw, truth: float, n: int, trials: int) -> list[float]:
    """Return the shares of trials in which ours, BCa's and the percentile interval are right."""
    rng = np.random.default_rng(n)
    hits = np.zeros(3)
    for _ in range(trials):
        values = draw(rng, n)
        ours = mean_interval(values)
        hits[0] += covered(ours.low, ours.high, truth)
        for k, method in enumerate(("BCa", "percentile"), start=1):
            ends = _bootstrap(values, method)
            hits[k] += covered(*ends, truth)
    return list(hits / trials)


def _bootstrap(values: np.ndarray, method: str) -> tuple[float, float]:
    if np.ptp(values) == 0:
        return values[0], values[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of resamples that are all alike
        settings: dict[str, Any] = {"n_resamples": 999, "method": method, "rng": 0}
        found = bootstrap((values,), np.mean, **settings).confidence_interval
    return float(found.low), float(found.high)


def scenarios_coverage(trials: int) -> list[float]:
    """Return the coverage of a pooled ratio and of a paired difference, 6 scenarios of 3 seeds."""
    rng, hits = np.random.default_rng(0), np.zeros(2)
    hard = np.repeat(np.linspace(0.6, 0.95, 6), 3)
    strata = np.repeat(np.arange(6), 3).tolist()
    for _ in range(trials):
        rates = np.clip(hard + rng.normal(0, 0.03, 18), 0, 1)
        ones = [ratio(rng.binomial(200, r), 200) for r in rates]
        others = [ratio(rng.binomial(200, max(r - 0.04, 0)), 200) for r in rates]
        pooled = pooled_interval(ones, strata)
        paired = paired_interval(ones, others, strata)
        hits += [
            covered(pooled.low, pooled.high, float(hard.mean())),
            covered(paired.low, paired.high, 0.04),
        ]
    return list(hits / trials)


def discoveries(trials: int, difference: float) -> tuple[float, float]:
    """Return the mean share of false discoveries, and the share of true differences noticed.

    difference: of `DIFFERING` of the metrics, in standard deviations of one episode's difference.
    """
    rng = np.random.default_rng(1)
    false_shares, noticed = [], []
    for _ in range(trials):
        values = rng.normal(0, 1, (METRICS, 18))
        values[:DIFFERING] += difference
        changed = {d.metric for d in compare(_run(0 * values), _run(values)).changed}
        real = {f"m{k}" for k in range(DIFFERING)} if difference else set()
        false_shares.append(len(changed - real) / max(len(changed), 1))
        noticed.append(len(changed & real) / max(len(real), 1))
    return float(np.mean(false_shares)), float(np.mean(noticed))


def _run(values: np.ndarray) -> dict[str, Any]:
    """Return a run of one entry, 6 scenarios of 3 seeds, as `leaderboard.json` holds it."""
    jobs = []
    for block, of_metrics in enumerate(values.T.tolist()):
        scores = {
            f"m{k}": {"value": value, "unit": "1", "better": "higher", "n": 1, "least": None}
            for k, value in enumerate(of_metrics)
        }
        job = {"board": "tracking", "entry": "a", "scenario": f"s{block // 3}", "seed": block % 3}
        jobs.append({**job, "condition": "clear", "inputs": "", "scores": scores})
    return {"scores": jobs}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the shares."""
    parser = argparse.ArgumentParser(
        prog="python -m research.interval_coverage",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--trials", type=int, default=1000, help="default: %(default)s")
    trials = parser.parse_args(arguments).trials
    table = Table("values", "seeds", "ours", "BCa", "percentile")
    for name, (draw, truth) in VALUES.items():
        for n in SEEDS:
            shares = coverage(draw, truth, n, trials)
            table.add_row(name, str(n), *(f"{share:.3f}" for share in shares))
    Console().print(table)
    pooled, paired = scenarios_coverage(trials)
    print(f"6 scenarios of 3 seeds: pooled ratio {pooled:.3f}, paired difference {paired:.3f}")
    for difference in (0.0, 0.5, 1.0):
        false_share, noticed = discoveries(max(trials // 2, 1), difference)
        print(f"difference {difference:g}: false {false_share:.3f}, noticed {noticed:.3f}")


if __name__ == "__main__":
    main()
