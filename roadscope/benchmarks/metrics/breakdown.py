"""Detection scores broken down by what may explain them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.average_precision import (
    Ranked,
    precision_by_group,
    ranked_by_distance,
)
from roadscope.benchmarks.metrics.calibration import BINS, excess, score_bins
from roadscope.benchmarks.metrics.detection import AP_GATES_M, GATE_M, judged
from roadscope.benchmarks.metrics.errors import BoxErrors, box_errors
from roadscope.benchmarks.metrics.grouped import (
    f1_by_group,
    precision_and_alarms,
    rate_by_group,
    rms_by_group,
)
from roadscope.benchmarks.metrics.matching import Match, Pairing, centre_distances, match_all
from roadscope.benchmarks.metrics.score import Score, ratio
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
    Objects, and errors of what was matched with them, are broken down by what is true of the
    object, detections by their own range and score, false alarms by their own category too. F1
    is of objects found and missed and of false alarms, each in its band. False alarms have no
    occlusion and no returns: there is neither precision nor F1 by those, and in average
    precision they count in each band.
    """
    matches = match_all(pairings, gate_m)
    pairs = _pairs(pairings, matches)
    hits = _among_all([len(d) for d in detections], [m.detected for m in matches])
    alarms = _among_all([len(d) for d in detections], [m.false_alarms for m in matches])
    squares = _squares(box_errors(detections, truths, matches))
    scores_of = [d.scores for d in detections]
    ranked = [ranked_by_distance(pairings, scores_of, gate) for gate in AP_GATES_M]
    own_bands, scores = _own_bands(detections, truths), {}
    for by, values in _qualities(truths, pairings).items():
        objects, own, count = BANDS[by].of(values), own_bands.get(by), len(BANDS[by].labels)
        columns = {
            "detection_rate": rate_by_group(objects, objects[pairs], count),
            "ap": _ap_by_group(ranked, objects, own, count),
            **{n: rms_by_group(s, objects[pairs], count, u) for n, (s, u) in squares.items()},
        }
        if own is not None:
            # By what they are called, cars taken for vans would make vans found that were not.
            right = own[hits] if by == "range" else objects[pairs]
            columns |= precision_and_alarms(right, own[alarms], count, len(matches))
            columns["f1"] = f1_by_group(objects, objects[pairs], own[alarms], count)
        for metric, column in columns.items():
            for band, score in zip(BANDS[by].labels, column, strict=True):
                scores[part_name(metric, by, band)] = score
    return scores | _by_score(detections, matches)


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


def _own_bands(detections: Sequence[Detections], truths: Sequence[Truth]) -> dict[str, np.ndarray]:
    """Return the bands of all detections, frame after frame, by what is known of them too."""
    ranges = [_ranges(d.centres, t) for d, t in zip(detections, truths, strict=True)]
    values = {"range": ranges, "category": [d.categories for d in detections]}
    return {by: BANDS[by].of(np.concatenate([np.empty(0), *v])) for by, v in values.items()}


def _pairs(pairings: Sequence[Pairing], matches: Sequence[Match]) -> np.ndarray:
    """Return for each matched pair which of all eligible objects it is with."""
    eligible = np.concatenate([np.empty(0, bool), *(p.eligible for p in pairings)])
    columns = _among_all([len(p.eligible) for p in pairings], [m.truth for m in matches])
    numbers: np.ndarray = np.cumsum(eligible)[columns] - 1
    return numbers


def _among_all(lengths: Sequence[int], indices: Sequence[np.ndarray]) -> np.ndarray:
    """Turn indices within frames into those within all frames one after another."""
    starts = np.cumsum([0, *lengths])[:-1]
    moved = (start + index for start, index in zip(starts, indices, strict=True))
    return np.concatenate([np.empty(0, np.int64), *moved])


def _squares(errors: BoxErrors) -> dict[str, tuple[np.ndarray, str]]:
    """Return squared errors of each pair, and their unit, by the name of their RMS."""
    return {
        "position_rmse_m": ((errors.along**2 + errors.across**2)[:, None], "m"),
        "heading_rmse_deg": ((errors.heading_deg**2)[:, None], "deg"),
        "size_rmse_m": (errors.size**2, "m"),
    }


def _ap_by_group(
    ranked: Sequence[Ranked], groups: np.ndarray, own: np.ndarray | None, count: int
) -> list[Score]:
    """Return the mean over the gates in each group."""
    values = np.mean([precision_by_group(each, groups, own, count) for each in ranked], axis=0)
    totals = np.bincount(groups, minlength=count)
    pairs = zip(values.tolist(), totals.tolist(), strict=True)
    return [ratio(value * n if n else 0.0, n) for value, n in pairs]


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
