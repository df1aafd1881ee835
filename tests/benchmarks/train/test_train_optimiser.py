import numpy as np
import pytest
import torch

from roadscope.benchmarks.train import Optimiser, Recipe
from roadscope.detectors.camera import CentreNetwork, channels_last

RECIPE = Recipe(steps=5, kernel_rate=0.01, learning_rate=1e-3, weight_decay=0.0)


def stepped(network: CentreNetwork, optimiser: Optimiser, seed: int) -> None:
    torch.manual_seed(seed)
    for weight in network.parameters():
        weight.grad = torch.randn_like(weight)
    optimiser.step()


@pytest.mark.slow
def test_every_weight_is_moved_once() -> None:
    network = channels_last(CentreNetwork())
    before = {k: v.clone() for k, v in network.named_parameters()}
    optimiser = Optimiser(network, RECIPE)
    stepped(network, optimiser, 0)
    for name, weight in network.named_parameters():
        moved = (weight - before[name]).detach()
        assert bool((moved != 0).any()), name
        if weight.ndim == 4 and weight.shape[-1] == 3:
            rows = moved.permute(0, 2, 3, 1).flatten(1)
            sizes = torch.linalg.svdvals(rows) / torch.linalg.matrix_norm(rows, 2)
            # All directions alike, as far as five rounds of Newton and Schulz go.
            assert float(sizes.min()) > 0.5, name
        else:
            assert moved.abs().max() <= 1.1e-3
    optimiser.zero_grad()
    assert all(w.grad is None for w in network.parameters())


def test_kernels_not_laid_out_channels_last_are_refused() -> None:
    with pytest.raises(RuntimeError, match="view"):
        Optimiser(CentreNetwork(), RECIPE)


def test_it_goes_on_as_if_never_stopped() -> None:
    first, second = (channels_last(CentreNetwork()) for _ in range(2))
    second.load_state_dict(first.state_dict())
    whole, part = Optimiser(first, RECIPE), Optimiser(second, RECIPE)
    for seed in range(4):
        stepped(first, whole, seed)
        stepped(second, part, seed)
        if seed == 1:
            state = part.state_dict()
            part = Optimiser(second, RECIPE)
            part.load_state_dict(state)
    for one, two in zip(first.parameters(), second.parameters(), strict=True):
        np.testing.assert_array_equal(one.detach().numpy(), two.detach().numpy())
