"""How wrong the network's maps are."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from roadscope.detectors.camera.decode import STRIDE
from roadscope.detectors.camera.network import Maps

FOCUS = 2
"""Exponent that makes easy squares count less; `CALM` does so near centres (Zhou 2019)."""
CALM = 4
BOX_WEIGHT = 3.0
VEHICLE_WEIGHT = 0.3


class TargetMaps(NamedTuple):
    """`Targets` of a batch as tensors, (B, ...) each."""

    heat: Tensor
    judged: Tensor
    boxes: Tensor
    weights: Tensor
    vehicles: Tensor


class Losses(NamedTuple):
    """Parts of the loss, and their weighted sum."""

    total: Tensor
    heat: Tensor
    box: Tensor
    vehicle: Tensor


def losses(maps: Maps, targets: TargetMaps) -> Losses:
    """Return the loss of a batch, each part divided by the number of its objects."""
    heat = heat_loss(maps.heat, targets.heat, targets.judged)
    box = box_loss(boxes_of(maps.distances), targets.boxes, targets.weights)
    vehicle = vehicle_loss(maps.vehicles, targets.vehicles, targets.weights)
    return Losses(heat + BOX_WEIGHT * box + VEHICLE_WEIGHT * vehicle, heat, box, vehicle)


def heat_loss(log_odds: Tensor, wanted: Tensor, judged: Tensor) -> Tensor:
    """Focal loss of heatmaps (Zhou 2019, eq. 1)."""
    chance = torch.sigmoid(log_odds)
    centre = wanted == 1.0
    right = -functional.logsigmoid(log_odds) * (1 - chance) ** FOCUS
    wrong = -functional.logsigmoid(-log_odds) * chance**FOCUS * (1 - wanted) ** CALM
    total = (torch.where(centre, right, wrong) * judged).sum()
    return total / centre.sum().clamp(min=1)


def boxes_of(distances: Tensor) -> Tensor:
    """Turn (B, 4, h, w) distances into boxes left top right bottom, pixels."""
    height, width = distances.shape[-2:]
    y = (torch.arange(height, device=distances.device) + 0.5)[:, None] * STRIDE
    x = (torch.arange(width, device=distances.device) + 0.5)[None] * STRIDE
    left, top, right, bottom = distances.unbind(1)
    return torch.stack([x - left, y - top, x + right, y + bottom], dim=1)


def box_loss(boxes: Tensor, wanted: Tensor, weights: Tensor) -> Tensor:
    """Return one minus the generalised IoU (Rezatofighi 2019), weighted mean over squares."""
    low = torch.maximum(boxes[:, :2], wanted[:, :2])
    high = torch.minimum(boxes[:, 2:], wanted[:, 2:])
    hull = torch.maximum(boxes[:, 2:], wanted[:, 2:]) - torch.minimum(boxes[:, :2], wanted[:, :2])
    common = (high - low).clamp(min=0).prod(dim=1)
    areas = [(b[:, 2:] - b[:, :2]).clamp(min=0).prod(dim=1) for b in (boxes, wanted)]
    union = areas[0] + areas[1] - common
    around = hull.prod(dim=1).clamp(min=1e-6)
    overlap = common / union.clamp(min=1e-6) - (around - union) / around
    return ((1 - overlap) * weights).sum() / weights.sum().clamp(min=1)


def vehicle_loss(log_odds: Tensor, categories: Tensor, weights: Tensor) -> Tensor:
    """Cross entropy of the categories of vehicles, weighted mean over squares."""
    told = categories >= 0
    each = functional.cross_entropy(log_odds, categories.clamp(min=0), reduction="none")
    here = weights * told
    return (each * here).sum() / here.sum().clamp(min=1)
