import numpy as np
import torch

from roadscope.benchmarks.train import (
    CropObjects,
    PixelSize,
    TargetMaps,
    box_loss,
    boxes_of,
    heat_loss,
    losses,
    targets_of,
)
from roadscope.detectors.camera import Maps


def toy_targets() -> TargetMaps:
    objects = CropObjects(
        np.array([[8.0, 8, 40, 30], [36, 4, 60, 28]]),
        np.array([0, 1]),
        np.array([1, 5]),
        np.array([True, True]),
    )
    return TargetMaps.stacked([targets_of(objects, PixelSize(32, 64))])


def perfect(targets: TargetMaps) -> Maps:
    heat = torch.where(targets.heat == 1.0, 12.0, -12.0)
    own = boxes_of(torch.zeros_like(targets.boxes))
    sides = (targets.boxes - own) * torch.tensor([-1, -1, 1, 1])[:, None, None]
    vehicles = torch.zeros(1, 5, *heat.shape[2:])
    vehicles[:, 1] = 20.0
    return Maps(heat, torch.where(targets.weights[:, None] > 0, sides, 1.0), vehicles)


def test_perfect_maps_cost_nothing() -> None:
    targets = toy_targets()
    assert float(losses(perfect(targets), targets).total) < 1e-3


def test_each_part_notices_its_own_error() -> None:
    targets = toy_targets()
    good = perfect(targets)
    base = losses(good, targets)
    cold = losses(good._replace(heat=-good.heat), targets)
    wide = losses(good._replace(distances=good.distances * 1.5), targets)
    other = losses(good._replace(vehicles=good.vehicles.flip(1)), targets)
    assert cold.heat > base.heat + 1
    assert wide.box > base.box + 0.2
    assert other.vehicle > base.vehicle + 1


def test_masked_squares_cost_nothing() -> None:
    hot = torch.full((1, 3, 4, 4), 5.0)
    assert float(heat_loss(hot, torch.zeros_like(hot), torch.zeros_like(hot))) == 0.0
    assert float(heat_loss(hot, torch.zeros_like(hot), torch.ones_like(hot))) > 1.0


def test_generalised_overlap_is_that_of_its_definition() -> None:
    boxes = torch.tensor([0.0, 0, 10, 10]).reshape(1, 4, 1, 1)
    distant_box = torch.tensor([20.0, 0, 30, 10]).reshape(1, 4, 1, 1)
    half = torch.tensor([5.0, 0, 15, 10]).reshape(1, 4, 1, 1)
    one = torch.ones(1, 1, 1)
    np.testing.assert_allclose(float(box_loss(boxes, boxes, one)), 0.0, atol=1e-6)
    np.testing.assert_allclose(float(box_loss(boxes, distant_box, one)), 1 + 100 / 300, rtol=1e-5)
    np.testing.assert_allclose(float(box_loss(boxes, half, one)), 1 - 50 / 150, rtol=1e-5)
