"""From the network's answers to boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.detectors.camera.suppression import distinct
from roadscope.detectors.camera.traits import TRAITS, looked_around

STRIDE = 2
"""Pixels from one answer to the next."""
FINE = 2
"""Answers along the side of each place of the last layer, so that people who walk side by side,
a few pixels wide, have answers of their own."""
UNIT_PX = 4.0
"""Distances are exponentials in this unit."""
LARGEST = 6.0
"""Of the logarithm of a distance over its unit."""
FLOOR = -2.5
"""Log odds of the heat below which an answer is not looked at: hardly any of these is right."""
MOST = 2000
"""Boxes of an image that are looked at, the surest first."""
SAME_IOU = 0.75
"""Boxes of a family that overlap more are of one and the same; others are told apart by traits."""
FIRST_CATEGORIES = (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN)
"""By family; vehicles are cars unless told otherwise."""


@dataclass(frozen=True, slots=True, eq=False)
class Peaks(Record):
    """Boxes of each family, the surest by heat first.

    No surer one covered much the same before answers were averaged; afterwards it may, and traits
    tell of it.

    boxes: (N, 4) float64, pixels, left top right bottom. families: (N,) int64, places among
        vehicle, cyclist, pedestrian. categories: (N,) int64, values of `Category`.
    traits: (N, 9) float64, see `TRAITS`.
    """

    boxes: np.ndarray
    families: np.ndarray
    categories: np.ndarray
    traits: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            boxes=(np.float64, ("N", 4)),
            families=(np.int64, ("N",)),
            categories=(np.int64, ("N",)),
            traits=(np.float64, ("N", len(TRAITS))),
        )

    def __len__(self) -> int:
        return len(self.boxes)

    @property
    def log_odds(self) -> np.ndarray:
        """(N,) of the heat."""
        return self.traits[:, 0]


def decode(answers: np.ndarray, size: tuple[int, int], least_log_odds: float = FLOOR) -> Peaks:
    """Read the answers of one image, (h, w, 4, 12), at four parts of each place, row by row.

    Log odds of a centre of each family, logarithms of the distances to left, top, right and bottom
    over their unit, log odds among the categories of vehicles. Every part may name a box, not the
    highest among its neighbours alone: centres of people who stand close together lie beside each
    other.

    size: height and width of the image, pixels; boxes end at its edges.
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
    boxes = np.clip(boxes, 0, [size[1], size[0], size[1], size[0]])
    kinds = said[:, 4:].argmax(axis=1)
    categories = np.array(FIRST_CATEGORIES)[families] + np.where(families == 0, kinds, 0)
    there = np.flatnonzero((boxes[:, 2:] > boxes[:, :2]).all(axis=1))
    boxes, families, values = boxes[there], families[there], values[order][there]
    kept = distinct(boxes, families, SAME_IOU)
    voted, traits = looked_around(boxes, families, values, kept)
    return Peaks(voted, families[kept], categories[there][kept], traits)
