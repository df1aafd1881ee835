"""From the network's outputs to boxes with traits, from which their scores are computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.jit import compiled
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Non-maximum suppression.


@compiled()
def distinct(boxes: np.ndarray, families: np.ndarray, most_iou: float) -> np.ndarray:
    """Return the (K,) rows of boxes that overlap no better box of their family too much.

    Greedy non-maximum suppression. boxes: (N, 4) float64, pixels, sorted by falling score.
    families: (N,) int64. most_iou: greatest intersection over union with a better box.
    """
    rows = np.empty(len(boxes), np.int64)
    count = 0
    for i in range(len(boxes)):
        free = True
        for other in rows[:count]:
            if families[other] == families[i] and iou(boxes[other], boxes[i]) > most_iou:
                free = False
                break
        if free:
            rows[count] = i
            count += 1
    return rows[:count].copy()


@compiled(borrowing=True)
def iou(one: np.ndarray, other: np.ndarray) -> float:
    """Return the intersection over union of two boxes, (4,) each, 0 if they do not overlap."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    common = width * height
    areas = (one[2] - one[0]) * (one[3] - one[1]) + (other[2] - other[0]) * (other[3] - other[1])
    return float(common / (areas - common))


# --------------------------------------------------------------------------------------------------
# Traits of a box, from which its score is computed: other boxes near it, and outputs that agree.

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
"""Names of a box's traits.

heat: log odds of the heat.
overlap: greatest overlap with a box of the same family and greater heat.
behind: difference of the log odds of that box and this one, times the overlap.
other overlap, other ahead: the same for the box of another family, whose heat may be less.
height, width over height: logarithms, the height in pixels.
agreeing: logarithm of one plus the sum of the probabilities of all outputs that agree.
agreement: mean overlap of these outputs with the box, weighted by probability.
"""
VOTING_IOU = 0.65
"""Outputs whose boxes overlap a box by more are averaged with it. Chosen by hand."""
AGREEING_IOU = 0.5
"""Outputs whose boxes overlap a box by more agree with it. Chosen by hand."""


class Answers(NamedTuple):
    """Boxes in the network's outputs for one image, the greatest heat first.

    boxes: (N, 4) pixels, inside the image. families: (N,) int64. log_odds: (N,) of the heat.
    """

    boxes: np.ndarray
    families: np.ndarray
    log_odds: np.ndarray


@compiled()
def averaged(answers: Answers, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the averaged boxes, (K, 4), of (K,) rows of answers, and their traits, (K, 9)."""
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
    """Write the mean of the boxes that overlap one box, and the traits of their agreement."""
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
    """Write the traits of a box's overlap with boxes of its own family and of others."""
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
# From the network's outputs to boxes.

STRIDE = 2
"""Pixels from one output to the next."""
FINE = 2
"""A position of the last layer has 2 x 2 outputs, so that people side by side, who are a few pixels
wide, have different outputs."""
UNIT_PX = 4.0
"""The network gives distances as logarithms, in this unit."""
LARGEST = 6.0
"""Greatest logarithm of a distance over its unit."""
FLOOR = -2.5
"""Log odds of the heat below which an output is ignored: hardly any of these is right."""
MOST = 2000
"""Most boxes of an image; those of greatest heat are used. Chosen by hand."""
SAME_IOU = 0.75
"""Boxes of a family that overlap more are of the same object; for others the score decides. Chosen
by hand."""
FIRST_CATEGORIES = (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN)
"""The first category of each family; the network's log odds choose among those of vehicles."""


@dataclass(frozen=True, slots=True, eq=False)
class Peaks(Record):
    """Boxes of each family, the greatest heat first, after non-maximum suppression.

    Boxes are averaged afterwards, so they may still overlap; the traits say how much.

    boxes: (N, 4) float64, pixels: left, top, right, bottom. families: (N,) int64, 0 vehicle, 1
        cyclist, 2 pedestrian. categories: (N,) int64, values of `Category`.
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
        """(N,) log odds of the heat."""
        return self.traits[:, 0]


def decode(
    answers: np.ndarray, *, height_px: int, width_px: int, least_log_odds: float = FLOOR
) -> Peaks:
    """Return the boxes in the network's outputs for one image.

    answers: (h, w, 4, 12) outputs; the four parts of a position are row by row. An output has 3 log
        odds of a centre of each family, 4 logarithms of the distances to left, top, right and
        bottom over their unit, and 5 log odds among the categories of vehicles.
    height_px, width_px: of the image; boxes end at its edges.
    least_log_odds: every output of more heat gives a box, not only the greatest among its
        neighbours, because the centres of people who stand close together lie side by side.
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
    boxes = np.clip(boxes, 0, [width_px, height_px, width_px, height_px])
    kinds = rest[:, 4:].argmax(axis=1)
    categories = np.array(FIRST_CATEGORIES)[families] + np.where(families == 0, kinds, 0)
    inside = np.flatnonzero((boxes[:, 2:] > boxes[:, :2]).all(axis=1))
    boxes, families, values = boxes[inside], families[inside], values[order][inside]
    rows = distinct(boxes, families, SAME_IOU)
    means, traits = averaged(Answers(boxes, families, values), rows)
    return Peaks(means, families[rows], categories[inside][rows], traits)
