"""Whether a score says how often its detections are right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.score import Score, signed_mean

BINS = 10


def score_bins(scores: np.ndarray) -> np.ndarray:
    """Return which of ten equal bins of 0 to 1 each of the (N,) scores is in, (N,) int64."""
    bins: np.ndarray = np.minimum((scores * BINS).astype(np.int64), BINS - 1)
    return bins


def excess(scores: np.ndarray, right: np.ndarray) -> list[Score]:
    """Return for each bin how far its mean score exceeds the share that is right.

    scores: (N,) in 0 to 1. right: (N,) bool, which detections are matched. Ten signed means of
    no unit, each with its number of detections; nan where there is none.
    """
    bins, gaps = score_bins(scores), scores - right
    return [signed_mean(float(gaps[bins == b].sum()), int((bins == b).sum())) for b in range(BINS)]


def calibration_error(bins: Sequence[Score]) -> Score:
    """Return the expected calibration error (Naeini et al. 2015) of an episode's bins.

    bins: what `excess` returns. From 0 to 1, lower is better; nan without a detection.
    """
    return pooled_calibration([bins])[0]


def pooled_calibration(episodes: Sequence[Sequence[Score]]) -> list[Score]:
    """Return each episode's part in the expected calibration error of all together.

    episodes: what `excess` returns for each.
    Pooled by weight they give the error of the pooled bins: the sum over bins of the size of
    the excess, weighed by the number of detections. Errors of single episodes do not: chance
    in sparse bins adds up in them. With the signs of the pooled excess held, the error is a
    ratio of sums, so its interval is found like all others.
    """
    counts = np.array([[s.weight for s in bins] for bins in episodes], np.float64)
    sums = counts * np.array([[s.value if s.weight else 0.0 for s in bins] for bins in episodes])
    signs = np.sign(sums.sum(axis=0))
    return [
        Score(part / n if n else np.nan, "1", "lower", int(n), 0.0, 1.0, weight=n)
        for part, n in zip((sums * signs).sum(axis=1), counts.sum(axis=1).tolist(), strict=True)
    ]
