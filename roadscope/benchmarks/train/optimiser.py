"""What moves the weights: Muon the kernels of convolutions, AdamW all the others."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from roadscope.benchmarks.train.recipe import Recipe

RISE = 0.15
"""Share of the steps in which the rates rise; after that they fall to nothing."""


class Optimiser:
    """Muon and AdamW, with rates on one cycle.

    Muon (Jordan 2024) turns a kernel, seen as a matrix of outputs by inputs, in all its directions
    equally: with few steps it comes much farther than AdamW. torch's takes matrices alone, so it
    is given views of the kernels; a network moved to another place in memory needs a new one.
    """

    def __init__(self, network: nn.Module, recipe: Recipe) -> None:
        """Take the network's weights as they lie in memory, kernels channels last."""
        self._kernels = [p for p in network.parameters() if p.ndim == 4 and p.shape[-1] > 1]
        self._matrices = [nn.Parameter(_matrix(p.detach())) for p in self._kernels]
        own = {id(p) for p in self._kernels}
        others = [p for p in network.parameters() if id(p) not in own]
        decay = recipe.weight_decay
        self._parts: dict[str, torch.optim.Optimizer] = {
            "muon": torch.optim.Muon(self._matrices, recipe.kernel_rate, weight_decay=decay),
            "adamw": torch.optim.AdamW(_groups(others, decay), recipe.learning_rate),
        }
        highest = {"muon": recipe.kernel_rate, "adamw": recipe.learning_rate}
        self._cycles = {
            name: torch.optim.lr_scheduler.OneCycleLR(
                part, highest[name], total_steps=recipe.steps + 1, pct_start=RISE,
                cycle_momentum=name == "adamw",
            )
            for name, part in self._parts.items()
        }  # fmt: skip

    def zero_grad(self) -> None:
        """Forget all gradients."""
        for part in self._parts.values():
            part.zero_grad(set_to_none=True)
        for kernel in self._kernels:
            kernel.grad = None

    def step(self) -> None:
        """Move all weights, then the rates."""
        for kernel, matrix in zip(self._kernels, self._matrices, strict=True):
            assert kernel.grad is not None
            matrix.grad = kernel.grad.permute(0, 2, 3, 1).flatten(1)
        for name, part in self._parts.items():
            part.step()
            self._cycles[name].step()

    def state_dict(self) -> dict[str, Any]:
        """Return all that is remembered from step to step."""
        parts = {name: part.state_dict() for name, part in self._parts.items()}
        return parts | {f"{name}-cycle": c.state_dict() for name, c in self._cycles.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from what `state_dict` returned."""
        for name, part in self._parts.items():
            part.load_state_dict(state[name])
            self._cycles[name].load_state_dict(state[f"{name}-cycle"])


def _matrix(kernel: torch.Tensor) -> torch.Tensor:
    """See (outs, ins, h, w), channels last, as (outs, h * w * ins): the same memory."""
    return kernel.permute(0, 2, 3, 1).view(len(kernel), -1)


def _groups(weights: list[nn.Parameter], weight_decay: float) -> list[dict[str, Any]]:
    """Norms and offsets are not pulled towards zero."""
    wide = [p for p in weights if p.ndim > 1]
    flat = [p for p in weights if p.ndim <= 1]
    return [
        {"params": wide, "weight_decay": weight_decay},
        {"params": flat, "weight_decay": 0.0},
    ]
