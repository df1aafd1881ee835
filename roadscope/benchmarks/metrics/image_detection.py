"""Scores of a camera detector on a set of images, of all objects and by bands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name, precision_by_score
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.image_labels import FAMILIES, Labels
from roadscope.benchmarks.metrics.matching import image_overlaps
from roadscope.benchmarks.metrics.ranked_precision import FALSE_ALARM, IGNORED, RECALL_LEVELS
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, averaged, mean, ratio
from roadscope.core import Category, ImageDetections
from roadscope.core.category import families_of

LEAST_IOU = 0.5
COCO_IOUS = np.linspace(0.5, 0.95, 10)
TALL_PX = 16.0
SMALL_PX2, LARGE_PX2 = 32.0**2, 96.0**2
"""COCO's limits between small, medium and large boxes, square pixels."""
NEAR_M, FAR_M = 25.0, 50.0
QUARTER, HALF = 0.25, 0.5
SCORE_THRESHOLD = 0.5
"""Detections with at least this score count for rates and false alarms."""

# --------------------------------------------------------------------------------------------------
# Average precision as COCO defines it.


@dataclass(frozen=True, slots=True)
class LabelledImage:
    """Detections and objects of one class in one image; boxes in pixels, left top right bottom.

    boxes: (N, 4), scores: (N,) of detections.
    objects: (M, 4) boxes of objects. eligible: (M,) bool, whether an object counts.
    counted: (N,) bool, whether a detection that is matched with nothing counts as false.
    """

    boxes: np.ndarray
    scores: np.ndarray
    objects: np.ndarray
    eligible: np.ndarray
    counted: np.ndarray


@dataclass(frozen=True, slots=True)
class PrecisionCurve:
    """Average precision and the curve behind it, of D detections from the highest score down.

    ap: 0 to 1, higher is better; nan without an object.
    precision, recall: (D,) of the detections so far, 0 to 1; recall is nan without an object.
    scores: (D,). objects: number of eligible objects.
    """

    ap: float
    precision: np.ndarray
    recall: np.ndarray
    scores: np.ndarray
    objects: int


def image_precision(images: Sequence[LabelledImage], least_iou: float = 0.5) -> PrecisionCurve:
    """Return average precision over all images at one threshold of intersection over union.

    AP is the mean over 101 recalls of the interpolated precision, the largest precision at this
    recall or a larger one (COCO, Lin et al. 2014).
    """
    objects = sum(int(image.eligible.sum()) for image in images)
    matched = [match_image(image, least_iou) for image in images]
    counted = (image.scores[rows] for image, (rows, _) in zip(images, matched, strict=True))
    scores = np.concatenate([np.empty(0), *counted])
    right = np.concatenate([np.empty(0, bool), *(hits for _, hits in matched)])
    order = np.argsort(-scores, kind="mergesort")
    hits, false = np.cumsum(right[order]), np.cumsum(~right[order])
    precision = hits / np.maximum(hits + false, np.spacing(1.0))
    if objects == 0:
        return PrecisionCurve(np.nan, precision, np.full(len(hits), np.nan), scores[order], 0)
    recall = hits / objects
    interpolated = np.maximum.accumulate(precision[::-1])[::-1]
    step = np.searchsorted(recall, RECALL_LEVELS, side="left")
    levels = np.append(interpolated, 0.0)[np.minimum(step, len(interpolated))]
    return PrecisionCurve(float(levels.mean()), precision, recall, scores[order], objects)


def hits_of(curve: PrecisionCurve) -> np.ndarray:
    """Return (D,) bool, which detections of a curve are right: those at which recall rises."""
    if curve.objects == 0:
        return np.zeros(len(curve.scores), bool)
    hits: np.ndarray = np.diff(np.rint(curve.recall * curve.objects), prepend=0.0) > 0
    return hits


def match_image(image: LabelledImage, least_iou: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of the C detections that count, by falling score, and which are right."""
    order = np.argsort(-image.scores, kind="mergesort")
    matched = matched_objects(image, least_iou)[order]
    counts = matched != IGNORED
    return order[counts], matched[counts] >= 0


def matched_objects(image: LabelledImage, least_iou: float = 0.5) -> np.ndarray:
    """Return (N,) int64, the eligible object of each detection, or `FALSE_ALARM` or `IGNORED`.

    From the highest score down, each detection is matched with the free object that it overlaps
    most, eligible objects first. A detection that is matched with an ineligible object is ignored;
    one that is matched with nothing is a false alarm if `counted` says that it counts.
    """
    order = np.argsort(-image.scores, kind="mergesort")
    eligible_first = np.argsort(~image.eligible, kind="mergesort")
    overlaps = image_overlaps(image.boxes[order], image.objects[eligible_first])
    eligible = image.eligible[eligible_first]
    free = np.ones(len(eligible), bool)
    matched = np.where(image.counted, FALSE_ALARM, IGNORED)
    for detection, row in zip(order, overlaps, strict=True):
        possible = free & (row >= min(least_iou, 1 - 1e-10))
        column = _most_overlapping(row, possible & eligible)
        if column is None:
            column = _most_overlapping(row, possible & ~eligible)
        if column is not None:
            free[column] = False
            matched[detection] = eligible_first[column] if eligible[column] else IGNORED
    return matched


def _most_overlapping(overlaps: np.ndarray, possible: np.ndarray) -> int | None:
    """Return the possible object of most overlap; of equal ones the last, as COCO does."""
    if not possible.any():
        return None
    return int(np.flatnonzero(possible & (overlaps == overlaps[possible].max()))[-1])


# --------------------------------------------------------------------------------------------------
# Scores of an episode.


@dataclass(frozen=True, slots=True)
class ImageScores(ScoreFamily):
    """Scores of a camera detector on a set of images; nan where no object is eligible.

    AP is average precision (`image_precision`), 0 to 1, the mean of the families that have
    objects. With TP matched objects, FP false alarms, FN misses, from a score of 0.5:

    ap50: AP at an intersection over union of 0.5; ap50_vehicle, _cyclist, _pedestrian: of a family.
    ap: mean AP at 0.5, 0.55, ..., 0.95, as COCO has it (Lin et al. 2014).
    ap50_16px: of objects at least 16 pixels high.
    ap50_small, _medium, _large: of boxes below 32 x 32 pixels, up to 96 x 96, above.
    ap50_near, _middle, _far: of objects within 25 m, up to 50 m, beyond.
    ap50_visible, _partly, _largely: of objects less than a quarter hidden, less than half, more. A
        false detection has no range and nothing hidden: it counts in each.
    detection_rate: TP / (TP + FN), 0 to 1, of all and of each family.
    false_alarms: FP per image, of all and of each family.
    category_accuracy: share of objects whose detection has the right category.
    calibration_error: expected calibration error of all scores, ten bins.
    objects_per_image: eligible objects, the same for every detector.
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


BoxFilter = Callable[[np.ndarray], np.ndarray]
"""Takes (N, 4) boxes and returns (N,) bool, which of them count."""
LabelFilter = Callable[[Labels], np.ndarray]
"""Takes N labels and returns (N,) bool, which of them count."""


def score_images(detections: Sequence[ImageDetections], labels: Sequence[Labels]) -> ImageScores:
    """Return the scores of detections; hardly visible objects and parked cars do not count."""
    curves = _family_curves(detections, labels)
    objects = [curve.objects for curve in curves]
    right = [hits_of(curve)[curve.scores >= SCORE_THRESHOLD] for curve in curves]
    hits, alarms = [int(r.sum()) for r in right], [int((~r).sum()) for r in right]
    by_family = {
        f"{name}_{family.value}": score
        for i, family in enumerate(FAMILIES)
        for name, score in (
            ("ap50", averaged(curves[i].ap, objects[i])),
            ("detection_rate", ratio(hits[i], objects[i])),
            ("false_alarms", mean(alarms[i], len(labels), "1/image")),
        )
    }
    scores, is_right = _scores_and_hits(curves)
    return ImageScores(
        **by_family,
        **_precision_of_parts(detections, labels),
        ap50=_mean_of_families(curves),
        ap=_coco_precision(detections, labels),
        detection_rate=ratio(sum(hits), sum(objects)),
        false_alarms=mean(sum(alarms), len(labels), "1/image"),
        category_accuracy=_category_accuracy(detections, labels),
        calibration_error=calibration_error(excess(scores, is_right)),
        objects_per_image=mean(sum(objects), len(labels), "1/image", "higher"),
    )


def images_of_family(
    detections: Sequence[ImageDetections],
    labels: Sequence[Labels],
    family: int,
    *,
    box_filter: BoxFilter | None = None,
    label_filter: LabelFilter | None = None,
) -> list[LabelledImage]:
    """Return the detections and objects of one family, image by image.

    family: index in `FAMILIES`.
    box_filter: which boxes count, of detections and objects; None: all.
    label_filter: which objects count; None: all.
    """
    images = []
    for detected, label in zip(detections, labels, strict=True):
        rows = np.flatnonzero(families_of(detected.categories) == family)
        columns = np.flatnonzero(label.families == family)
        boxes, objects = detected.boxes[rows], label.boxes[columns]
        eligible, counted = label.eligible[columns], np.ones(len(rows), bool)
        if box_filter is not None:
            eligible, counted = eligible & box_filter(objects), box_filter(boxes)
        if label_filter is not None:
            eligible = eligible & label_filter(label)[columns]
        images.append(LabelledImage(boxes, detected.scores[rows], objects, eligible, counted))
    return images


def _family_curves(
    detections: Sequence[ImageDetections],
    labels: Sequence[Labels],
    *,
    box_filter: BoxFilter | None = None,
    label_filter: LabelFilter | None = None,
) -> list[PrecisionCurve]:
    """Return the curve of each family at `LEAST_IOU`; filters as in `images_of_family`."""
    families = (
        images_of_family(
            detections, labels, family, box_filter=box_filter, label_filter=label_filter
        )
        for family in range(len(FAMILIES))
    )
    return [image_precision(images, LEAST_IOU) for images in families]


def _mean_of_families(curves: Sequence[PrecisionCurve]) -> Score:
    """Return the mean AP of the families that have objects."""
    with_objects = [c for c in curves if c.objects]
    value = float(np.mean([c.ap for c in with_objects])) if with_objects else np.nan
    return averaged(value, sum(c.objects for c in with_objects))


def _coco_precision(detections: Sequence[ImageDetections], labels: Sequence[Labels]) -> Score:
    families = [images_of_family(detections, labels, f) for f in range(len(FAMILIES))]
    by_iou = [
        _mean_of_families([image_precision(images, float(iou)) for images in families])
        for iou in COCO_IOUS
    ]
    return averaged(float(np.mean([s.value for s in by_iou])), by_iou[0].n)


def _precision_of_parts(
    detections: Sequence[ImageDetections], labels: Sequence[Labels]
) -> dict[str, Score]:
    """Return AP by size, range and occlusion, by the names of `ImageScores`."""
    box_filters: dict[str, BoxFilter] = {
        "ap50_16px": lambda b: b[:, 3] - b[:, 1] >= TALL_PX,
        "ap50_small": lambda b: _areas(b) < SMALL_PX2,
        "ap50_medium": lambda b: (_areas(b) >= SMALL_PX2) & (_areas(b) <= LARGE_PX2),
        "ap50_large": lambda b: _areas(b) > LARGE_PX2,
    }
    label_filters = {
        "ap50_near": _between("ranges_m", 0.0, NEAR_M),
        "ap50_middle": _between("ranges_m", NEAR_M, FAR_M),
        "ap50_far": _between("ranges_m", FAR_M, np.inf),
        "ap50_visible": _between("occluded", 0.0, QUARTER),
        "ap50_partly": _between("occluded", QUARTER, HALF),
        "ap50_largely": _between("occluded", HALF, np.inf),
    }
    by_box = {
        name: _family_curves(detections, labels, box_filter=each)
        for name, each in box_filters.items()
    }
    by_label = {
        name: _family_curves(detections, labels, label_filter=each)
        for name, each in label_filters.items()
    }
    return {name: _mean_of_families(curves) for name, curves in (by_box | by_label).items()}


def _between(column: str, low: float, high: float) -> LabelFilter:
    def inside(labels: Labels) -> np.ndarray:
        values = getattr(labels, column)
        chosen: np.ndarray = (values >= low) & (values < high)
        return chosen

    return inside


def _areas(boxes: np.ndarray) -> np.ndarray:
    areas: np.ndarray = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return areas


def _category_accuracy(detections: Sequence[ImageDetections], labels: Sequence[Labels]) -> Score:
    """Return the share of right categories.

    Of the objects that a detection of their family overlaps, by the detection that overlaps most.
    """
    right, total = 0, 0
    for detected, label in zip(detections, labels, strict=True):
        objects = np.flatnonzero(label.eligible)
        rows = np.flatnonzero(detected.scores >= SCORE_THRESHOLD)
        if not len(objects) or not len(rows):
            continue
        overlaps = image_overlaps(detected.boxes[rows], label.boxes[objects])
        families = families_of(detected.categories[rows])
        same_family = families[:, None] == label.families[objects][None]
        overlaps = np.where(same_family, overlaps, 0.0)
        hit = overlaps.max(axis=0) >= LEAST_IOU
        best = rows[overlaps.argmax(axis=0)]
        right += int((detected.categories[best] == label.categories[objects])[hit].sum())
        total += int(hit.sum())
    return ratio(right, total)


def _scores_and_hits(curves: Sequence[PrecisionCurve]) -> tuple[np.ndarray, np.ndarray]:
    """Return (K,) scores of all detections that count, and (K,) bool, which are right."""
    scores = np.concatenate([curve.scores for curve in curves])
    return scores, np.concatenate([hits_of(curve) for curve in curves])


# --------------------------------------------------------------------------------------------------
# Scores of an episode by their names on the board.

BAND_SUFFIXES = {
    "family": {family.value: f"_{family.value}" for family in FAMILIES},
    "size": {"small": "_small", "medium": "_medium", "large": "_large"},
    "range": {"0-25": "_near", "25-50": "_middle", "50+": "_far"},
    "occlusion": {"0-25": "_visible", "25-50": "_partly", "50-75": "_largely"},
}
"""By quantity and band, what its names in `ImageScores` end in."""


def camera_scores(
    detections: Sequence[ImageDetections], labels: Sequence[Labels]
) -> dict[str, Score]:
    """Return all scores of an episode's images; those of bands are named by `part_name`.

    By family: average precision, detection rate and false alarms. By size, range and occlusion:
    average precision. By category: detection rate. By score: precision and `EXCESS`.
    """
    named = score_images(detections, labels).named()
    suffixes = [suffix for bands in BAND_SUFFIXES.values() for suffix in bands.values()]
    scores = {n: s for n, s in named.items() if not n.endswith(tuple(suffixes))}
    for by, bands in BAND_SUFFIXES.items():
        for band, suffix in bands.items():
            for metric in ("ap50", "detection_rate", "false_alarms"):
                if metric + suffix in named:
                    scores[part_name(metric, by, band)] = named[metric + suffix]
    curves = _family_curves(detections, labels)
    return (
        scores
        | _rates_by_category(detections, labels)
        | precision_by_score(*_scores_and_hits(curves))
    )


def _rates_by_category(
    detections: Sequence[ImageDetections], labels: Sequence[Labels]
) -> dict[str, Score]:
    """Return the share of each category's objects that a detection of their family finds."""
    scores = {}
    for category in Category:
        family = FAMILIES.index(category.family)
        chosen = _of_category(category)
        images = images_of_family(detections, labels, family, label_filter=chosen)
        curve = image_precision(images, LEAST_IOU)
        hits = int((hits_of(curve) & (curve.scores >= SCORE_THRESHOLD)).sum())
        name = part_name("detection_rate", "category", category.name.lower())
        scores[name] = ratio(hits, curve.objects)
    return scores


def _of_category(category: Category) -> LabelFilter:
    def chosen(labels: Labels) -> np.ndarray:
        return np.asarray(labels.categories == category.value)

    return chosen
