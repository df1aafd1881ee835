"""Detection scores broken down by what may explain them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.calibration import BINS, excess, score_bins
from roadscope.benchmarks.metrics.detection import GATE_M, judged
from roadscope.benchmarks.metrics.matching import Match, Pairing, centre_distances, match_all
from roadscope.benchmarks.metrics.score import Score, mean, ratio
from roadscope.core import Category, Detections, Truth

EXCESS = "score_excess"
"""Mean score of a band of scores less the share of it that is right."""


@dataclass(frozen=True, slots=True)
class Bands:
    """Half-open bands of a quantity; the last one has no end.

    edges: where bands begin, ascending; no value lies below the first.
    labels: one for each.
    """

    edges: tuple[float, ...]
    labels: tuple[str, ...]

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return (N,) int64, the band that each value lies in."""
        bands: np.ndarray = np.searchsorted(self.edges, values, side="right") - 1
        return bands


BANDS: Mapping[str, Bands] = {
    "range": Bands((0, 20, 40, 60, 80), ("0-20", "20-40", "40-60", "60-80", "80+")),
    "category": Bands(
        tuple(c.value for c in Category), tuple(c.name.lower() for c in Category)
    ),
    "occlusion": Bands((0, 1, 25, 50, 75), ("none", "1-25", "25-50", "50-75", "75-100")),
    "points": Bands(
        (0, 5, 10, 20, 50, 100, 200), ("1-4", "5-9", "10-19", "20-49", "50-99", "100-199", "200+")
    ),
    "score": Bands(
        tuple(range(BINS)),
        ("0-.1", ".1-.2", ".2-.3", ".3-.4", ".4-.5", ".5-.6", ".6-.7", ".7-.8", ".8-.9", ".9-1"),
    ),
}  # fmt: skip
"""What scores of one episode are broken down by: range of the centre from the ego, category,
share of an object's rays that something else caught, returns from it, score of detections."""


def part_name(metric: str, by: str, band: str) -> str:
    """Return the name of one metric in one band."""
    return f"{metric} by {by}: {band}"


def split_name(name: str) -> tuple[str, str, str]:
    """Undo `part_name`; what is not broken down has no quantity and no band."""
    metric, _, place = name.partition(" by ")
    by, _, band = place.partition(": ")
    return metric, by, band


def broken_down(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    *,
    gate_m: float = GATE_M,
) -> dict[str, Score]:
    """Return scores of an episode's bands by `part_name`; empty bands have n = 0.

    detections: in the world frame, like truth.
    Objects are broken down by what is true of them, detections by their own range and score.
    False alarms have no true category, occlusion or returns, so there is no precision by those.
    """
    matches = match_all(pairings, gate_m)
    scores = {}
    found = _found(pairings, matches)
    for by, values in _qualities(truths, pairings).items():
        bands = BANDS[by].of(values)
        for index, band in enumerate(BANDS[by].labels):
            inside = found[bands == index]
            scores[part_name("detection_rate", by, band)] = ratio(int(inside.sum()), len(inside))
    return scores | _by_range(detections, truths, matches) | _by_score(detections, matches)


QUALITIES: Mapping[str, Callable[[Truth], np.ndarray]] = {
    "range": lambda t: _ranges(t.centres, t),
    "category": lambda t: t.categories,
    "occlusion": lambda t: 100 * t.occluded_fraction,
    "points": lambda t: t.lidar_returns,
}


def _qualities(truths: Sequence[Truth], pairings: Sequence[Pairing]) -> dict[str, np.ndarray]:
    """Return what each eligible object of each frame is like."""
    rows = [np.flatnonzero(p.eligible) for p in pairings]
    return {
        by: np.concatenate([np.empty(0), *(of(t)[r] for t, r in zip(truths, rows, strict=True))])
        for by, of in QUALITIES.items()
    }


def _found(pairings: Sequence[Pairing], matches: Sequence[Match]) -> np.ndarray:
    """Return bool for each eligible object of each frame."""
    return np.concatenate(
        [
            np.empty(0, bool),
            *(
                np.isin(np.flatnonzero(p.eligible), m.truth)
                for p, m in zip(pairings, matches, strict=True)
            ),
        ]
    )


def _by_range(
    detections: Sequence[Detections], truths: Sequence[Truth], matches: Sequence[Match]
) -> dict[str, Score]:
    """Return precision and false alarms by the range of the detections."""
    bands, counts = BANDS["range"], np.zeros((2, len(BANDS["range"].labels)), np.int64)
    for found, truth, match in zip(detections, truths, matches, strict=True):
        inside = bands.of(_ranges(found.centres, truth))
        for row, index in enumerate((match.detected, match.false_alarms)):
            counts[row] += np.bincount(inside[index], minlength=counts.shape[1])
    scores = {}
    for band, hits, wrong in zip(bands.labels, *counts.tolist(), strict=True):
        scores[part_name("precision", "range", band)] = ratio(hits, hits + wrong)
        alarms = mean(wrong, len(matches), "1/frame")
        scores[part_name("false_alarms_per_frame", "range", band)] = alarms
    return scores


def _by_score(detections: Sequence[Detections], matches: Sequence[Match]) -> dict[str, Score]:
    """Return precision by score, and by how much scores promise more."""
    values, right = judged(detections, matches)
    bins, gaps, scores = score_bins(values), excess(values, right), {}
    for index, band in enumerate(BANDS["score"].labels):
        inside = right[bins == index]
        scores[part_name("precision", "score", band)] = ratio(int(inside.sum()), len(inside))
        scores[part_name(EXCESS, "score", band)] = gaps[index]
    return scores


def _ranges(centres: np.ndarray, truth: Truth) -> np.ndarray:
    """Return (N,) distances from the ego seen from above, metres."""
    return centre_distances(centres, truth.world_from_ego.translation[None])[:, 0]
