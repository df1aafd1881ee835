"""From the network's maps to boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

STRIDE = 4
MOST = 200
"""Peaks of an image that are looked at, the highest first."""
SAME_IOU = 0.55
"""Boxes of a family that overlap more are of one and the same."""
FIRST_CATEGORIES = (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN)
"""By family; vehicles are cars unless told otherwise."""


@dataclass(frozen=True, slots=True, eq=False)
class Peaks(Record):
    """Boxes where a family's heat is highest among its neighbours, the surest first.

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


def decode(
    heat: np.ndarray, distances: np.ndarray, vehicles: np.ndarray, least_log_odds: float
) -> Peaks:
    """Read maps of one image: (3, h, w) log odds, (4, h, w) pixels, (5, h, w) log odds."""
    families, rows, columns = np.nonzero(_highest(heat) & (heat >= least_log_odds))
    values = heat[families, rows, columns]
    order = np.argsort(-values, kind="stable")[:MOST]
    families, rows, columns = families[order], rows[order], columns[order]
    sides = distances[:, rows, columns].T
    middles = (np.stack([columns, rows], axis=1) + 0.5) * STRIDE
    boxes = np.concatenate([middles - sides[:, :2], middles + sides[:, 2:]], axis=1)
    kinds = vehicles[:, rows, columns].argmax(axis=0)
    categories = np.array(FIRST_CATEGORIES)[families] + np.where(families == 0, kinds, 0)
    peaks = Peaks(boxes, families, categories, values[order])
    return peaks.select(distinct(peaks.boxes, peaks.families))


def _highest(heat: np.ndarray) -> np.ndarray:
    """Find what is at least as high as its eight neighbours, (F, h, w) bool."""
    padded = np.pad(heat, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    along = np.maximum(np.maximum(padded[:, :, :-2], padded[:, :, 1:-1]), padded[:, :, 2:])
    around = np.maximum(np.maximum(along[:, :-2], along[:, 1:-1]), along[:, 2:])
    highest: np.ndarray = heat >= around
    return highest


def distinct(boxes: np.ndarray, families: np.ndarray, most_iou: float = SAME_IOU) -> np.ndarray:
    """Return (K,) rows, of boxes sorted by falling score, that no better one of the family covers.

    Greedy non-maximum suppression.
    """
    low = np.maximum(boxes[:, None, :2], boxes[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:])
    common = np.maximum(high - low, 0.0).prod(axis=-1)
    areas = np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0).prod(axis=-1)
    union = np.maximum(areas[:, None] + areas[None] - common, np.spacing(1.0))
    same = (common > most_iou * union) & (families[:, None] == families[None])
    kept = np.ones(len(boxes), bool)
    for i in range(len(boxes)):
        if kept[i]:
            kept[i + 1 :] &= ~same[i, i + 1 :]
    return np.flatnonzero(kept)
