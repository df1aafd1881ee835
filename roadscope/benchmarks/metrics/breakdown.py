"""Scores of parts of an episode: the bands of a quantity, and the names of their scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.calibration import BINS, excess, score_bins
from roadscope.benchmarks.metrics.score import Score, ratio
from roadscope.core import Category

EXCESS = "score_excess"
"""Name of what `excess` returns: mean score of a band of scores less the share that is right."""


@dataclass(frozen=True, slots=True)
class Bands:
    """Half-open bands of a quantity; the last one has no end.

    edges: where bands begin, ascending; no value is below the first.
    labels: one for each band.
    """

    edges: tuple[float, ...]
    labels: tuple[str, ...]

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return (N,) int64, the band of each value."""
        bands: np.ndarray = np.searchsorted(self.edges, values, side="right") - 1
        return bands


BANDS: Mapping[str, Bands] = {
    "range": Bands((0, 20, 40, 60, 80), ("0-20", "20-40", "40-60", "60-80", "80+")),
    "category": Bands(tuple(c.value for c in Category), tuple(c.name.lower() for c in Category)),
    "occlusion": Bands((0, 1, 25, 50, 75), ("none", "1-25", "25-50", "50-75", "75-100")),
    "points": Bands(
        (0, 5, 10, 20, 50, 100, 200), ("1-4", "5-9", "10-19", "20-49", "50-99", "100-199", "200+")
    ),
    "score": Bands(
        tuple(range(BINS)),
        ("0-.1", ".1-.2", ".2-.3", ".3-.4", ".4-.5", ".5-.6", ".6-.7", ".7-.8", ".8-.9", ".9-1"),
    ),
}
"""Bands of the range of an object's centre from the ego (metres), of its category, of the share of
its rays that end on something else (per cent), of its returns, and of a detection's score."""


def part_name(metric: str, by: str, band: str) -> str:
    """Return the name of one metric in one band of the quantity `by`."""
    return f"{metric} by {by}: {band}"


def split_name(name: str) -> tuple[str, str, str]:
    """Return metric, quantity and band of a `part_name`; the last two are empty of other names."""
    metric, _, place = name.partition(" by ")
    by, _, band = place.partition(": ")
    return metric, by, band


def precision_by_score(scores: np.ndarray, right: np.ndarray) -> dict[str, Score]:
    """Return precision and `EXCESS` of each band of scores, by `part_name`; n = 0 if it is empty.

    scores: (N,) in 0 to 1. right: (N,) bool, which detections are right.
    """
    bins, gaps, named = score_bins(scores), excess(scores, right), {}
    for index, band in enumerate(BANDS["score"].labels):
        inside = right[bins == index]
        named[part_name("precision", "score", band)] = ratio(int(inside.sum()), len(inside))
        named[part_name(EXCESS, "score", band)] = gaps[index]
    return named
