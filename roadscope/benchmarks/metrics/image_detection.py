"""How well boxes in images cover the road users that could be seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.image_labels import FAMILIES, FAMILY_OF, Labels
from roadscope.benchmarks.metrics.image_precision import (
    Labelled,
    PrecisionCurve,
    box_ious,
    image_precision,
)
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio
from roadscope.core import ImageDetections

LEAST_IOU = 0.5
STRICTER = np.linspace(0.5, 0.95, 10)
TALL_PX = 16.0
SMALL, LARGE = 32.0**2, 96.0**2
"""COCO's borders between small, medium and large boxes, square pixels."""
NEAR_M, FAR_M = 25.0, 50.0
QUARTER, HALF = 0.25, 0.5
TOLD = 0.5
"""Score from which on a detection counts for rates and false alarms."""

Choice = Callable[[np.ndarray], np.ndarray]
"""Says which of (N, 4) boxes are of the size asked for, (N,) bool."""


@dataclass(frozen=True, slots=True)
class ImageScores(ScoreFamily):
    """Scores of a camera detector on a set of images, per family and over all.

    ap50: average precision at an intersection over union of 0.5, mean of the families that there
        are, and of each. ap: mean over 0.5 to 0.95 as COCO has it.
    ap50_16px: of objects at least 16 pixels high. ap50_small, _medium, _large: below 32 x 32
        pixels, up to 96 x 96, above. ap50_near, _middle, _far: within 25 m, to 50 m, beyond;
        ap50_visible, _partly, _largely: less than a quarter hidden, less than half, more. A false
        detection has no range and nothing hidden, and counts in each.
    detection_rate: objects found with a score of at least 0.5, and of each family.
    false_alarms: detections with such a score that belong to no object, per image.
    category_accuracy: share of the objects found whose category is right.
    calibration_error: expected calibration error of all scores, ten bins.
    objects_per_image: of those asked for, the same for every detector.
    """

    ap50: Score
    ap50_vehicle: Score
    ap50_cyclist: Score
    ap50_pedestrian: Score
    ap: Score
    ap50_16px: Score
    ap50_small: Score
    ap50_medium: Score
    ap50_large: Score
    ap50_near: Score
    ap50_middle: Score
    ap50_far: Score
    ap50_visible: Score
    ap50_partly: Score
    ap50_largely: Score
    detection_rate: Score
    detection_rate_vehicle: Score
    detection_rate_cyclist: Score
    detection_rate_pedestrian: Score
    false_alarms: Score
    false_alarms_vehicle: Score
    false_alarms_cyclist: Score
    false_alarms_pedestrian: Score
    category_accuracy: Score
    calibration_error: Score
    objects_per_image: Score


def score_images(found: Sequence[ImageDetections], labels: Sequence[Labels]) -> ImageScores:
    """Score detections against what their images show.

    Objects that are hardly seen and parked cars count neither way.
    """
    pairs = list(zip(found, labels, strict=True))
    curves = [image_precision(of_family(pairs, f), LEAST_IOU) for f in range(len(FAMILIES))]
    objects = [c.objects for c in curves]
    hits, alarms = zip(*(_at(curve, TOLD) for curve in curves), strict=True)
    each = {
        f"{name}_{family.value}": score
        for i, family in enumerate(FAMILIES)
        for name, score in (
            ("ap50", _share(curves[i].ap, objects[i])),
            ("detection_rate", ratio(hits[i], objects[i])),
            ("false_alarms", mean(alarms[i], len(pairs), "1/image")),
        )
    }
    return ImageScores(
        **each,
        **_by_kind(pairs),
        ap50=_over_families(curves),
        ap=_strict(pairs),
        detection_rate=ratio(sum(hits), sum(objects)),
        false_alarms=mean(sum(alarms), len(pairs), "1/image"),
        category_accuracy=_category_accuracy(pairs),
        calibration_error=_calibration(curves),
        objects_per_image=mean(sum(objects), len(pairs), "1/image", "higher"),
    )


Pairs = Sequence[tuple[ImageDetections, Labels]]


def of_family(
    pairs: Pairs,
    family: int,
    sized: Choice | None = None,
    asked: Callable[[Labels], np.ndarray] | None = None,
) -> list[Labelled]:
    """Return one family's detections and objects, image by image.

    sized: boxes that are asked for; others count neither way, on both sides. asked: likewise
        objects, (N,) bool.
    """
    images = []
    for found, labels in pairs:
        mine = np.flatnonzero(FAMILY_OF[found.categories] == family)
        theirs = np.flatnonzero(labels.families == family)
        boxes, objects = found.boxes[mine], labels.boxes[theirs]
        wanted, counted = labels.asked[theirs], np.ones(len(mine), bool)
        if sized is not None:
            wanted, counted = wanted & sized(objects), sized(boxes)
        if asked is not None:
            wanted = wanted & asked(labels)[theirs]
        images.append(Labelled(boxes, found.scores[mine], objects, wanted, counted))
    return images


def hits_of(curve: PrecisionCurve) -> np.ndarray:
    """(D,) bool, which detections of a curve are right."""
    if curve.objects == 0:
        return np.zeros(len(curve.scores), bool)
    hits: np.ndarray = np.diff(np.rint(curve.recall * curve.objects), prepend=0.0) > 0
    return hits


def _at(curve: PrecisionCurve, score: float) -> tuple[int, int]:
    """Return how many with such a score are right and wrong."""
    told = hits_of(curve)[curve.scores >= score]
    return int(told.sum()), int((~told).sum())


def _share(value: float, objects: int) -> Score:
    return Score(value, "1", "higher", objects, 0.0, 1.0, weight=objects)


def _over_families(curves: Sequence[PrecisionCurve]) -> Score:
    there = [c for c in curves if c.objects]
    value = float(np.mean([c.ap for c in there])) if there else np.nan
    return _share(value, sum(c.objects for c in there))


def _strict(pairs: Pairs) -> Score:
    images = [of_family(pairs, f) for f in range(len(FAMILIES))]
    levels = [
        _over_families([image_precision(each, float(iou)) for each in images]) for iou in STRICTER
    ]
    return _share(float(np.mean([s.value for s in levels])), levels[0].n)


def _by_kind(pairs: Pairs) -> dict[str, Score]:
    sizes: dict[str, Choice] = {
        "ap50_16px": lambda b: b[:, 3] - b[:, 1] >= TALL_PX,
        "ap50_small": lambda b: _areas(b) < SMALL,
        "ap50_medium": lambda b: (_areas(b) >= SMALL) & (_areas(b) <= LARGE),
        "ap50_large": lambda b: _areas(b) > LARGE,
    }
    kinds = {
        "ap50_near": _between("ranges_m", 0.0, NEAR_M),
        "ap50_middle": _between("ranges_m", NEAR_M, FAR_M),
        "ap50_far": _between("ranges_m", FAR_M, np.inf),
        "ap50_visible": _between("occluded", 0.0, QUARTER),
        "ap50_partly": _between("occluded", QUARTER, HALF),
        "ap50_largely": _between("occluded", HALF, np.inf),
    }
    scores = {name: _precision(pairs, sized=sized) for name, sized in sizes.items()}
    return scores | {name: _precision(pairs, asked=asked) for name, asked in kinds.items()}


def _between(column: str, low: float, high: float) -> Callable[[Labels], np.ndarray]:
    def inside(labels: Labels) -> np.ndarray:
        values = getattr(labels, column)
        chosen: np.ndarray = (values >= low) & (values < high)
        return chosen

    return inside


def _precision(
    pairs: Pairs,
    *,
    sized: Choice | None = None,
    asked: Callable[[Labels], np.ndarray] | None = None,
) -> Score:
    families = range(len(FAMILIES))
    return _over_families(
        [image_precision(of_family(pairs, f, sized, asked), LEAST_IOU) for f in families]
    )


def _areas(boxes: np.ndarray) -> np.ndarray:
    areas: np.ndarray = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return areas


def _category_accuracy(pairs: Pairs) -> Score:
    """Of the objects that a detection of their family overlaps, by the one that does most."""
    right, total = 0, 0
    for found, labels in pairs:
        asked = np.flatnonzero(labels.asked)
        told = np.flatnonzero(found.scores >= TOLD)
        if not len(asked) or not len(told):
            continue
        overlaps = box_ious(found.boxes[told], labels.boxes[asked])
        same = FAMILY_OF[found.categories[told]][:, None] == labels.families[asked][None]
        overlaps = np.where(same, overlaps, 0.0)
        hit = overlaps.max(axis=0) >= LEAST_IOU
        taken = told[overlaps.argmax(axis=0)]
        right += int((found.categories[taken] == labels.categories[asked])[hit].sum())
        total += int(hit.sum())
    return ratio(right, total)


def _calibration(curves: Sequence[PrecisionCurve]) -> Score:
    scores = np.concatenate([c.scores for c in curves])
    return calibration_error(excess(scores, np.concatenate([hits_of(c) for c in curves])))
