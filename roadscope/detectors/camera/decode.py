"""From the network's answers to boxes, and what is around a box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.jit import compiled
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Of boxes that show much the same, the surest.


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
            if families[other] == families[i] and iou(boxes[other], boxes[i]) > most_iou:
                free = False
                break
        if free:
            kept[count] = i
            count += 1
    return kept[:count].copy()


@compiled(borrowing=True)
def iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two boxes, (4,) each, 0 where both are empty."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    common = width * height
    areas = (one[2] - one[0]) * (one[3] - one[1]) + (other[2] - other[0]) * (other[3] - other[1])
    return float(common / (areas - common))


# --------------------------------------------------------------------------------------------------
# Traits of a box, from which its score is made: other boxes around it, and answers that agree.

TRAITS = (
    "heat",
    "overlap",
    "behind",
    "other overlap",
    "other ahead",
    "height",
    "width over height",
    "agreeing",
    "agreement",
)
"""The heat's log odds; overlap with the surer box of the family that covers it most, and how much
less sure it is times that; the same of the box of another family, which may be less sure; the
logarithms of height in pixels, of width over height, of one and the chances of all answers that
agree; and their mean overlap with it."""
VOTING_IOU = 0.65
"""Answers whose boxes overlap more are averaged."""
AGREEING_IOU = 0.5
"""Answers whose boxes overlap more agree."""


class Answers(NamedTuple):
    """Boxes that the network suggests for one image, the surest first.

    boxes: (N, 4) pixels, inside the image. families: (N,) int64. log_odds: (N,) of the heat.
    """

    boxes: np.ndarray
    families: np.ndarray
    log_odds: np.ndarray


@compiled()
def averaged(answers: Answers, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return averaged boxes, (K, 4), and their traits, (K, 9), of some rows of answers, (K,)."""
    boxes, traits = np.zeros((len(rows), 4)), np.zeros((len(rows), len(TRAITS)))
    for k in range(len(rows)):
        _average(answers, rows[k], boxes[k], traits[k])
    means = Answers(boxes, answers.families[rows], answers.log_odds[rows])
    for k in range(len(rows)):
        _compare(means, k, traits[k])
        width, height = boxes[k, 2] - boxes[k, 0], boxes[k, 3] - boxes[k, 1]
        traits[k, 0] = means.log_odds[k]
        traits[k, 5], traits[k, 6] = np.log(height), np.log(width / height)
    return boxes, traits


@compiled()
def _average(answers: Answers, row: int, box: np.ndarray, traits: np.ndarray) -> None:
    """Write the mean box of the answers about one, and how many agree how well."""
    agreeing, agreement, votes = 0.0, 0.0, 0.0
    for other in range(len(answers.boxes)):
        if answers.families[other] != answers.families[row]:
            continue
        overlap = iou(answers.boxes[row], answers.boxes[other])
        if overlap <= AGREEING_IOU:
            continue
        chance = 1 / (1 + np.exp(-answers.log_odds[other]))
        agreeing += chance
        agreement += chance * overlap
        if overlap > VOTING_IOU:
            votes += chance * overlap
            for side in range(4):
                box[side] += chance * overlap * answers.boxes[other, side]
    for side in range(4):
        box[side] /= votes
    traits[7], traits[8] = np.log1p(agreeing), agreement / agreeing


@compiled()
def _compare(means: Answers, k: int, traits: np.ndarray) -> None:
    """Write how a box lies beside a surer one of its family, and beside one of another."""
    for other in range(len(means.boxes)):
        same = means.families[other] == means.families[k]
        if other == k or (same and other > k):
            continue
        at = 1 if same else 3
        overlap = iou(means.boxes[k], means.boxes[other])
        if overlap > traits[at]:
            traits[at] = overlap
            traits[at + 1] = overlap * (means.log_odds[other] - means.log_odds[k])


# --------------------------------------------------------------------------------------------------
# From the network's answers to boxes.

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
"""Log odds of the heat below which an answer is ignored: hardly any of these is right."""
MOST = 2000
"""Most boxes of an image, the surest first."""
SAME_IOU = 0.75
"""Boxes of a family that overlap more are one and the same; between others traits decide."""
FIRST_CATEGORIES = (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN)
"""By family; the network's log odds choose among the categories of vehicles."""


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
    rest = answers[rows, columns, parts, len(FIRST_CATEGORIES) :].astype(np.float64)
    sides = UNIT_PX * np.exp(np.minimum(rest[:, :4], LARGEST))
    across, down = FINE * columns + parts % FINE, FINE * rows + parts // FINE
    middles = (np.stack([across, down], axis=1) + 0.5) * STRIDE
    boxes = np.concatenate([middles - sides[:, :2], middles + sides[:, 2:]], axis=1)
    boxes = np.clip(boxes, 0, [size[1], size[0], size[1], size[0]])
    kinds = rest[:, 4:].argmax(axis=1)
    categories = np.array(FIRST_CATEGORIES)[families] + np.where(families == 0, kinds, 0)
    inside = np.flatnonzero((boxes[:, 2:] > boxes[:, :2]).all(axis=1))
    boxes, families, values = boxes[inside], families[inside], values[order][inside]
    rows = distinct(boxes, families, SAME_IOU)
    means, traits = averaged(Answers(boxes, families, values), rows)
    return Peaks(means, families[rows], categories[inside][rows], traits)
