"""From the network's answers to boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.jit import compiled
from roadscope.core.record import Record

STRIDE = 2
"""Pixels from one answer to the next."""
FINE = 2
"""Answers along the side of each place of the last layer, so that people who walk side by side,
a few pixels wide, have answers of their own."""
UNIT_PX = 4.0
"""Distances are exponentials in this unit."""
LARGEST = 6.0
"""Of the logarithm of a distance over its unit."""
MOST = 2000
"""Boxes of an image that are looked at, the surest first."""
SAME_IOU = 0.55
"""Boxes of a family that overlap more are of one and the same."""
FIRST_CATEGORIES = (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN)
"""By family; vehicles are cars unless told otherwise."""


@dataclass(frozen=True, slots=True, eq=False)
class Peaks(Record):
    """Boxes of each family of which no surer one covers much the same, the surest first.

    boxes: (N, 4) float64, pixels, left top right bottom. families: (N,) int64, places among
        vehicle, cyclist, pedestrian. categories: (N,) int64, values of `Category`.
    log_odds: (N,) float64, of the heat.
    """

    boxes: np.ndarray
    families: np.ndarray
    categories: np.ndarray
    log_odds: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            boxes=(np.float64, ("N", 4)),
            families=(np.int64, ("N",)),
            categories=(np.int64, ("N",)),
            log_odds=(np.float64, ("N",)),
        )

    def __len__(self) -> int:
        return len(self.boxes)

    def select(self, index: np.ndarray) -> Peaks:
        """Keep the rows that a mask or an index array names."""
        return Peaks(
            self.boxes[index], self.families[index], self.categories[index], self.log_odds[index]
        )


def decode(answers: np.ndarray, least_log_odds: float) -> Peaks:
    """Read the answers of one image, (h, w, 4, 12), at four parts of each place, row by row.

    Log odds of a centre of each family, logarithms of the distances to left, top, right and bottom
    over their unit, log odds among the categories of vehicles. Every part may name a box, not the
    highest among its neighbours alone: centres of people who stand close together lie beside each
    other.
    """
    heat = answers[..., : len(FIRST_CATEGORIES)]
    places = np.nonzero(heat >= least_log_odds)
    values = heat[places].astype(np.float64)
    order = np.argsort(-values, kind="stable")[:MOST]
    rows, columns, parts, families = (each[order] for each in places)
    said = answers[rows, columns, parts, len(FIRST_CATEGORIES) :].astype(np.float64)
    sides = UNIT_PX * np.exp(np.minimum(said[:, :4], LARGEST))
    across, down = FINE * columns + parts % FINE, FINE * rows + parts // FINE
    middles = (np.stack([across, down], axis=1) + 0.5) * STRIDE
    boxes = np.concatenate([middles - sides[:, :2], middles + sides[:, 2:]], axis=1)
    kinds = said[:, 4:].argmax(axis=1)
    categories = np.array(FIRST_CATEGORIES)[families] + np.where(families == 0, kinds, 0)
    peaks = Peaks(boxes, families, categories, values[order])
    return peaks.select(distinct(peaks.boxes, peaks.families, SAME_IOU))


@compiled()
def distinct(boxes: np.ndarray, families: np.ndarray, most_iou: float) -> np.ndarray:
    """Return (K,) rows, of boxes sorted by falling score, that no better one of the family covers.

    boxes: (N, 4) float64. families: (N,) int64. Greedy non-maximum suppression.
    """
    kept = np.empty(len(boxes), np.int64)
    count = 0
    for i in range(len(boxes)):
        free = True
        for other in kept[:count]:
            if families[other] == families[i] and _iou(boxes[other], boxes[i]) > most_iou:
                free = False
                break
        if free:
            kept[count] = i
            count += 1
    return kept[:count].copy()


@compiled()
def _iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two boxes, 0 where both are empty."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    common = width * height
    areas = (one[2] - one[0]) * (one[3] - one[1]) + (other[2] - other[0]) * (other[3] - other[1])
    return float(common / (areas - common))
