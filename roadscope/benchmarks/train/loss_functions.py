"""What the network should answer for a crop, and how far its answer is from that.

A `square` is one cell of the network's maps: STRIDE x STRIDE pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from roadscope.benchmarks.metrics.image_labels import FAMILIES
from roadscope.benchmarks.train.pictures import PixelSize
from roadscope.core.record import Record
from roadscope.detectors.camera.decoding import STRIDE
from roadscope.detectors.camera.network import Maps

# --------------------------------------------------------------------------------------------------
# Targets

HEAT_SPREAD = 0.54 / 6
"""Standard deviation of the heat around a centre, as a share of the side of the box (Liu 2020,
TTFNet)."""
LEAST_SPREAD = 0.8
"""Squares, chosen by hand; with less, small objects would have heat in one square alone."""
NEAR_CENTRE = 0.1
"""Squares with more heat than this answer for the box; around an object that is not eligible, they
have no effect on the loss."""
HEAT_REACH = 14.5
"""Standard deviations beyond which the heat is 0 in float32."""
NO_CATEGORY = -1


@dataclass(frozen=True, slots=True, eq=False)
class CropObjects(Record):
    """Objects of one crop.

    boxes: (N, 4) pixels of the crop. families, categories: (N,) integers.
    eligible: (N,) bool, whether the network should find it; else finding it is no error either.
    """

    boxes: np.ndarray
    families: np.ndarray
    categories: np.ndarray
    eligible: np.ndarray

    def __len__(self) -> int:
        return len(self.boxes)


class TargetMaps(NamedTuple):
    """Maps of h x w squares that the network should answer for one crop; (B, ...) for a batch.

    heat: (3, h, w) float32, by family, 1 at centres, falling to 0 around them.
    loss_mask: (3, h, w) float32, 0 where the answer has no effect on the loss, 1 elsewhere.
    boxes: (4, h, w) float32, pixels, left top right bottom.
    weights: (h, w) float32, how much a square answers for its box; those of one object sum to 1.
    vehicles: (h, w) int64, category of the vehicle, -1 where there is none.
    """

    heat: Tensor
    loss_mask: Tensor
    boxes: Tensor
    weights: Tensor
    vehicles: Tensor

    @staticmethod
    def stacked(crops: Sequence[TargetMaps]) -> TargetMaps:
        """Stack the targets of the crops of a batch."""
        return TargetMaps(*map(torch.stack, zip(*crops, strict=True)))


def targets_of(objects: CropObjects, size: PixelSize) -> TargetMaps:
    """Return the targets of a crop; in squares of several boxes the smallest box wins."""
    squares = PixelSize(size.height // STRIDE, size.width // STRIDE)
    heat = np.zeros((len(FAMILIES), *squares), np.float32)
    loss_mask = np.ones_like(heat)
    boxes, weights = np.zeros((4, *squares), np.float32), np.zeros(squares, np.float32)
    vehicles = np.full(squares, NO_CATEGORY, np.int64)
    areas = (objects.boxes[:, 2:] - objects.boxes[:, :2]).prod(axis=1)
    for i in np.argsort(-areas, kind="stable"):
        bell = _bell(objects.boxes[i], squares)
        region, family, near = bell.region, objects.families[i], bell.heat > NEAR_CENTRE
        if not objects.eligible[i]:
            loss_mask[family][region][near] = 0.0
            continue
        family_heat = heat[family][region]
        np.maximum(family_heat, bell.heat, out=family_heat)
        boxes[:, *region][:, near] = objects.boxes[i][:, None]
        weights[region][near] = bell.heat[near] / bell.heat[near].sum()
        vehicles[region][near] = objects.categories[i] if family == 0 else NO_CATEGORY
    loss_mask[heat == 1.0] = 1.0
    return TargetMaps(*map(torch.from_numpy, (heat, loss_mask, boxes, weights, vehicles)))


class _Bell(NamedTuple):
    """Heat of one object. region: rows and columns of the map. heat: float32, of that region."""

    region: tuple[slice, slice]
    heat: np.ndarray


def _bell(box: np.ndarray, squares: PixelSize) -> _Bell:
    """Return the heat of a box, (4,) pixels: 1 in the square of its centre, less around it.

    squares: size of the map. Outside the region the heat is 0 in float32.
    """
    sides = (box[2:] - box[:2]) / STRIDE
    counts = (squares.width, squares.height)
    centre = np.minimum((box[:2] + box[2:]) / (2 * STRIDE), np.array(counts) - 1e-3)
    spread = np.maximum(HEAT_SPREAD * sides, LEAST_SPREAD)
    slices, heats = [], []
    for count, c, sigma in zip(counts, centre.tolist(), spread.tolist(), strict=True):
        middle, reach = int(c // 1), int(HEAT_REACH * sigma) + 1
        low, high = max(middle - reach, 0), min(middle + reach + 1, count)
        slices.append(slice(low, high))
        heats.append(np.exp(-0.5 * ((np.arange(low, high) - middle) / sigma) ** 2))
    heat: np.ndarray = (heats[1][:, None] * heats[0]).astype(np.float32)
    return _Bell((slices[1], slices[0]), heat)


# --------------------------------------------------------------------------------------------------
# Losses

ALPHA = 2
"""Exponent of the focal loss that makes easy squares count less (Zhou 2019, eq. 1)."""
BETA = 4
"""Exponent that makes squares near a centre count less when they are not centres (Zhou 2019)."""
BOX_WEIGHT = 3.0
VEHICLE_WEIGHT = 0.3
"""Weights of the box loss and of the category loss beside the heat loss, chosen by hand."""


class Losses(NamedTuple):
    """Parts of the loss, and their weighted sum."""

    total: Tensor
    heat: Tensor
    box: Tensor
    vehicle: Tensor


def losses(maps: Maps, targets: TargetMaps) -> Losses:
    """Return the loss of a batch, each part divided by the number of its objects."""
    heat = heat_loss(maps.heat, targets.heat, targets.loss_mask)
    box = box_loss(boxes_of(maps.distances), targets.boxes, targets.weights)
    vehicle = vehicle_loss(maps.vehicles, targets.vehicles, targets.weights)
    return Losses(heat + BOX_WEIGHT * box + VEHICLE_WEIGHT * vehicle, heat, box, vehicle)


def heat_loss(log_odds: Tensor, target: Tensor, loss_mask: Tensor) -> Tensor:
    """Return the focal loss of heatmaps (Zhou 2019, eq. 1), all (B, 3, h, w)."""
    chance = torch.sigmoid(log_odds)
    centre = target == 1.0
    at_centres = -functional.logsigmoid(log_odds) * (1 - chance) ** ALPHA
    elsewhere = -functional.logsigmoid(-log_odds) * chance**ALPHA * (1 - target) ** BETA
    total = (torch.where(centre, at_centres, elsewhere) * loss_mask).sum()
    return total / centre.sum().clamp(min=1)


def boxes_of(distances: Tensor) -> Tensor:
    """Return boxes, left top right bottom, pixels, from (B, 4, h, w) distances to their sides."""
    height, width = distances.shape[-2:]
    y = (torch.arange(height, device=distances.device) + 0.5)[:, None] * STRIDE
    x = (torch.arange(width, device=distances.device) + 0.5)[None] * STRIDE
    left, top, right, bottom = distances.unbind(1)
    return torch.stack([x - left, y - top, x + right, y + bottom], dim=1)


def box_loss(boxes: Tensor, target: Tensor, weights: Tensor) -> Tensor:
    """Return one minus the generalised IoU (Rezatofighi 2019), weighted mean over squares.

    boxes, target: (B, 4, h, w). weights: (B, h, w).
    """
    low = torch.maximum(boxes[:, :2], target[:, :2])
    high = torch.minimum(boxes[:, 2:], target[:, 2:])
    hull = torch.maximum(boxes[:, 2:], target[:, 2:]) - torch.minimum(boxes[:, :2], target[:, :2])
    intersection = (high - low).clamp(min=0).prod(dim=1)
    areas = [(b[:, 2:] - b[:, :2]).clamp(min=0).prod(dim=1) for b in (boxes, target)]
    union = areas[0] + areas[1] - intersection
    hull_area = hull.prod(dim=1).clamp(min=1e-6)
    overlap = intersection / union.clamp(min=1e-6) - (hull_area - union) / hull_area
    return ((1 - overlap) * weights).sum() / weights.sum().clamp(min=1)


def vehicle_loss(log_odds: Tensor, categories: Tensor, weights: Tensor) -> Tensor:
    """Return the cross entropy of the categories of vehicles, weighted mean over squares.

    log_odds: (B, 5, h, w). categories: (B, h, w), -1 where no vehicle is. weights: (B, h, w).
    """
    entropy = functional.cross_entropy(log_odds, categories.clamp(min=0), reduction="none")
    vehicle_weights = weights * (categories >= 0)
    return (entropy * vehicle_weights).sum() / vehicle_weights.sum().clamp(min=1)
