"""What the network should say of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.image_labels import FAMILIES
from roadscope.core.record import Record
from roadscope.detectors.camera.decode import STRIDE

SPREAD = 0.54 / 6
"""Standard deviation of the heat over the side of the box (Liu 2020, TTFNet)."""
LEAST_SPREAD = 0.8
"""Squares; smaller objects have this much, or nothing but one square would be taught."""
NEAR_CENTRE = 0.1
"""Heat from which on a square answers for the box, and is not asked when the object is not."""
FARTHEST = 14.5
"""Standard deviations at which the heat is less than any float32 above 0."""
NO_CATEGORY = -1


@dataclass(frozen=True, slots=True, eq=False)
class Objects(Record):
    """Objects of one crop. boxes: (N, 4) pixels. families, categories: (N,). asked: (N,) bool."""

    boxes: np.ndarray
    families: np.ndarray
    categories: np.ndarray
    asked: np.ndarray

    def __len__(self) -> int:
        return len(self.boxes)


@dataclass(frozen=True, slots=True, eq=False)
class Targets(Record):
    """Maps of h x w squares of 2 x 2 pixels.

    heat: (3, h, w) float32, 1 at centres, falling to 0 around them.
    judged: (3, h, w) float32, 0 where finding something is neither right nor wrong.
    boxes: (4, h, w) float32, pixels, left top right bottom. weights: (h, w) float32, how much a
        square answers for its box; those of one object sum to one.
    vehicles: (h, w) int64, category of the vehicle, -1 where there is none.
    """

    heat: np.ndarray
    judged: np.ndarray
    boxes: np.ndarray
    weights: np.ndarray
    vehicles: np.ndarray


def targets_of(objects: Objects, height: int, width: int) -> Targets:
    """Draw the maps of a crop of height x width pixels; where boxes overlap the smaller wins."""
    shape = (height // STRIDE, width // STRIDE)
    heat = np.zeros((len(FAMILIES), *shape), np.float32)
    judged = np.ones_like(heat)
    boxes, weights = np.zeros((4, *shape), np.float32), np.zeros(shape, np.float32)
    vehicles = np.full(shape, NO_CATEGORY, np.int64)
    areas = (objects.boxes[:, 2:] - objects.boxes[:, :2]).prod(axis=1)
    for i in np.argsort(-areas, kind="stable"):
        place, bell = _bell(objects.boxes[i], shape)
        family, near = objects.families[i], bell > NEAR_CENTRE
        if not objects.asked[i]:
            judged[family][place][near] = 0.0
            continue
        warm = heat[family][place]
        np.maximum(warm, bell, out=warm)
        boxes[:, *place][:, near] = objects.boxes[i][:, None]
        weights[place][near] = bell[near] / bell[near].sum()
        vehicles[place][near] = objects.categories[i] if family == 0 else NO_CATEGORY
    judged[heat == 1.0] = 1.0
    return Targets(heat, judged, boxes, weights, vehicles)


def _bell(box: np.ndarray, shape: tuple[int, int]) -> tuple[tuple[slice, slice], np.ndarray]:
    """Return float32, 1 in the square that holds the centre of a box, less around it; and where.

    Beyond these rows and columns of the (h, w) squares float32 has nothing but 0.
    """
    sides = (box[2:] - box[:2]) / STRIDE
    middle = np.minimum((box[:2] + box[2:]) / (2 * STRIDE), np.array(shape[::-1]) - 1e-3)
    spread = np.maximum(SPREAD * sides, LEAST_SPREAD)
    squares, heats = [], []
    for n, m, s in zip(shape[::-1], middle.tolist(), spread.tolist(), strict=True):
        first, reach = int(m // 1), int(FARTHEST * s) + 1
        low, high = max(first - reach, 0), min(first + reach + 1, n)
        squares.append(slice(low, high))
        heats.append(np.exp(-0.5 * ((np.arange(low, high) - first) / s) ** 2))
    bell: np.ndarray = (heats[1][:, None] * heats[0]).astype(np.float32)
    return (squares[1], squares[0]), bell
