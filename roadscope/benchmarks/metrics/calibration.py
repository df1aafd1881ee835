"""Calibration of scores: whether a score is the probability that its detection is right."""

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
    """Return for each of ten bins the mean score less the share of detections that are right.

    A positive excess says that the scores are too high. -1 to 1, no unit, best at 0; each has its
    number of detections; nan for an empty bin.

    scores: (N,) in 0 to 1. right: (N,) bool, which detections are matched with an object.
    """
    bins, gaps = score_bins(scores), scores - right
    return [signed_mean(float(gaps[bins == b].sum()), int((bins == b).sum())) for b in range(BINS)]


def calibration_error(bins: Sequence[Score]) -> Score:
    """Return the expected calibration error of an episode (Naeini et al. 2015).

    ECE = sum over bins of n_b / N |excess_b|, 0 to 1, no unit, lower is better; nan without a
    detection.

    bins: what `excess` returns.
    """
    return pooled_calibration([bins])[0]


def pooled_calibration(episodes: Sequence[Sequence[Score]]) -> list[Score]:
    """Return each episode's part in the expected calibration error of all episodes together.

    The mean of the parts, weighted by detections, is the error of the pooled bins. (The mean of
    the episodes' own errors is not: in a bin with few detections it adds up chance.) Each part
    takes the signs of the pooled excesses, so the error is a ratio of sums, and its interval is
    computed like that of other scores.

    episodes: what `excess` returns for each.
    """
    counts = np.array([[s.weight for s in bins] for bins in episodes], np.float64)
    sums = counts * np.array([[s.value if s.weight else 0.0 for s in bins] for bins in episodes])
    signs = np.sign(sums.sum(axis=0))
    return [
        Score(part / n if n else np.nan, "1", "lower", int(n), 0.0, 1.0, weight=n)
        for part, n in zip((sums * signs).sum(axis=1), counts.sum(axis=1).tolist(), strict=True)
    ]
