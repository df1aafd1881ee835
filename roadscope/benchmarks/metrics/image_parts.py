"""Scores of a camera detector on one episode, whole and broken down, by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.breakdown import BANDS, EXCESS, part_name
from roadscope.benchmarks.metrics.calibration import excess, score_bins
from roadscope.benchmarks.metrics.image_detection import (
    LEAST_IOU,
    TOLD,
    hits_of,
    of_family,
    score_images,
)
from roadscope.benchmarks.metrics.image_labels import FAMILIES, Labels
from roadscope.benchmarks.metrics.image_precision import image_precision
from roadscope.benchmarks.metrics.score import Score, ratio
from roadscope.core import Category, ImageDetections

PARTS = {
    "family": {family.value: f"_{family.value}" for family in FAMILIES},
    "size": {"small": "_small", "medium": "_medium", "large": "_large"},
    "range": {"0-25": "_near", "25-50": "_middle", "50+": "_far"},
    "occlusion": {"0-25": "_visible", "25-50": "_partly", "50-75": "_largely"},
}
"""Endings of the names in `ImageScores`, by what they are parts of and by band."""


def camera_scores(found: Sequence[ImageDetections], labels: Sequence[Labels]) -> dict[str, Score]:
    """Return all scores of an episode's images; parts are named by `part_name`.

    By family average precision, detection rate and false alarms, by size, range and occlusion
    average precision, by category the detection rate, by score precision and what it promises too
    much.
    """
    named = score_images(found, labels).named()
    scores = {n: s for n, s in named.items() if not _is_part(n)}
    for by, bands in PARTS.items():
        for band, ending in bands.items():
            for metric in ("ap50", "detection_rate", "false_alarms"):
                if metric + ending in named:
                    scores[part_name(metric, by, band)] = named[metric + ending]
    return scores | _by_category(found, labels) | _by_score(found, labels)


def _is_part(name: str) -> bool:
    endings = [ending for bands in PARTS.values() for ending in bands.values()]
    return any(name.endswith(ending) for ending in endings)


def _by_category(found: Sequence[ImageDetections], labels: Sequence[Labels]) -> dict[str, Score]:
    """Return how many of each category were found as one of their family."""
    scores = {}
    for category in Category:
        family = FAMILIES.index(category.family)
        images = of_family(
            list(zip(found, labels, strict=True)), family,
            asked=lambda each, wanted=category.value: each.categories == wanted,  # type: ignore[misc]
        )  # fmt: skip
        curve = image_precision(images, LEAST_IOU)
        hits = int((hits_of(curve) & (curve.scores >= TOLD)).sum())
        name = part_name("detection_rate", "category", category.name.lower())
        scores[name] = ratio(hits, curve.objects)
    return scores


def _by_score(found: Sequence[ImageDetections], labels: Sequence[Labels]) -> dict[str, Score]:
    pairs = list(zip(found, labels, strict=True))
    curves = [image_precision(of_family(pairs, f), LEAST_IOU) for f in range(len(FAMILIES))]
    values = np.concatenate([curve.scores for curve in curves])
    right = np.concatenate([hits_of(curve) for curve in curves])
    return scores_by_score(values, right)


def scores_by_score(values: np.ndarray, right: np.ndarray) -> dict[str, Score]:
    """Return precision by (N,) scores, and by how much scores promise more; (N,) bool right."""
    bins, gaps, scores = score_bins(values), excess(values, right), {}
    for index, band in enumerate(BANDS["score"].labels):
        inside = right[bins == index]
        scores[part_name("precision", "score", band)] = ratio(int(inside.sum()), len(inside))
        scores[part_name(EXCESS, "score", band)] = gaps[index]
    return scores
