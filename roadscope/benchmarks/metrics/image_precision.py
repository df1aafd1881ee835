"""Average precision of boxes in images, as COCO defines it.

Detections are taken by falling score, each for the free object that it overlaps most, if that is
enough; objects that are not asked for are matched last, and what is matched to one, or overlaps
none and is itself not of the size asked for, counts neither way. Precision is made monotonous and
read at 101 recalls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RECALLS = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, slots=True)
class Labelled:
    """Detections and objects of one class in one image.

    boxes: (N, 4), scores: (N,) of detections. objects: (M, 4), asked: (M,) bool, whether an
    object counts. Pixels, left top right bottom. counted: (N,) bool, whether a detection that
    matches nothing counts as false.
    """

    boxes: np.ndarray
    scores: np.ndarray
    objects: np.ndarray
    asked: np.ndarray
    counted: np.ndarray


@dataclass(frozen=True, slots=True)
class PrecisionCurve:
    """Average precision and what it is made of.

    ap: in 0 to 1, nan without an object. precision, recall: (D,) down the scores (D,).
    objects: number asked for.
    """

    ap: float
    precision: np.ndarray
    recall: np.ndarray
    scores: np.ndarray
    objects: int


def image_precision(images: Sequence[Labelled], least_iou: float = 0.5) -> PrecisionCurve:
    """Return the curve over all images at one threshold of intersection over union."""
    objects = sum(int(image.asked.sum()) for image in images)
    parts = [outcomes(image, least_iou) for image in images]
    told = (image.scores[rows] for image, (rows, _) in zip(images, parts, strict=True))
    scores = np.concatenate([np.empty(0), *told])
    hits = np.concatenate([np.empty(0, bool), *(h for _, h in parts)])
    order = np.argsort(-scores, kind="mergesort")
    found, false = np.cumsum(hits[order]), np.cumsum(~hits[order])
    precision = found / np.maximum(found + false, np.spacing(1.0))
    if objects == 0:
        return PrecisionCurve(np.nan, precision, np.full(len(found), np.nan), scores[order], 0)
    recall = found / objects
    best = np.maximum.accumulate(precision[::-1])[::-1]
    at = np.searchsorted(recall, RECALLS, side="left")
    read = np.append(best, 0.0)[np.minimum(at, len(best))]
    return PrecisionCurve(float(read.mean()), precision, recall, scores[order], objects)


def outcomes(image: Labelled, least_iou: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Return which detections count, (C,) rows by falling score, and whether each is a hit."""
    order = np.argsort(-image.scores, kind="mergesort")
    last = np.argsort(~image.asked, kind="mergesort")
    overlaps = box_ious(image.boxes[order], image.objects[last])
    asked = image.asked[last]
    free = np.ones(len(last), bool)
    hit, kept = np.zeros(len(order), bool), image.counted[order].copy()
    for i, row in enumerate(overlaps):
        match = _match(row, free, asked, least_iou)
        if match >= 0:
            free[match] = False
            hit[i] = kept[i] = asked[match]
    return order[kept], hit[kept]


def _match(row: np.ndarray, free: np.ndarray, asked: np.ndarray, least_iou: float) -> int:
    """Find the object a detection takes: one asked for before others; of equals the last."""
    enough = free & (row >= min(least_iou, 1 - 1e-10))
    for group in (enough & asked, enough & ~asked):
        if group.any():
            best = np.flatnonzero(group & (row == row[group].max()))
            return int(best[-1])
    return -1


def box_ious(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, M) intersection over union of (N, 4) and (M, 4) boxes."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    common = np.maximum(high - low, 0.0).prod(axis=-1)
    sizes = [np.maximum(b[:, 2:] - b[:, :2], 0.0).prod(axis=-1) for b in (first, second)]
    union = sizes[0][:, None] + sizes[1][None] - common
    result: np.ndarray = common / np.maximum(union, np.spacing(1.0))
    return result
