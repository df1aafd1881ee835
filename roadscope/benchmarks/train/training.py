"""The training loop, its optimiser and its checkpoints; weights are averaged over steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from roadscope.benchmarks.cache import write_atomically
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.train.crops import Batch, ShuffledPictures, batch
from roadscope.benchmarks.train.loss_functions import losses
from roadscope.benchmarks.train.pictures import Pictures
from roadscope.benchmarks.train.recipe import Recipe
from roadscope.detectors.camera.network import CentreNetwork, channels_last

CHECKPOINT_EVERY = 100
"""Steps from one checkpoint to the next."""
AVERAGE_DECAY = 0.998
"""Share of the averaged weights that stays in a step; less in the first steps."""
AVERAGE_EVERY = 5
"""Steps from one averaging to the next; one averaging decays as much as these steps."""
LARGEST_GRADIENT = 10.0
"""Norm that gradients are clipped to, chosen by hand."""
RISE = 0.15
"""Share of the steps in which the learning rates rise; after that they fall to nothing."""


def train(
    trainer: Trainer,
    episodes: Sequence[Pictures],
    checkpoint: Path,
    *,
    checkpoint_every: int = CHECKPOINT_EVERY,
    progress: Progress = silent,
    on_step: Callable[[int, float], None] = lambda step, loss: None,
) -> CentreNetwork:
    """Train to the end, from the checkpoint if there is one; return the averaged network.

    checkpoint_every: steps from one checkpoint to the next.
    on_step: is called after every step, with its number and its loss.
    """
    recipe = trainer.recipe
    trainer.resume(checkpoint)
    pictures = ShuffledPictures(episodes, recipe.seed)
    progress("training", trainer.step, recipe.steps)
    earlier_s, start_s = trainer.seconds, time.monotonic()
    for step in range(trainer.step, recipe.steps):
        # A thread that makes batches ahead would compete with those of the network, which wait for
        # each other at every layer: where all cores train, that costs more than it saves.
        loss = trainer.train_on(batch(pictures, recipe, step))
        trainer.seconds = earlier_s + time.monotonic() - start_s
        on_step(trainer.step, loss)
        progress("training", trainer.step, recipe.steps)
        if trainer.step % checkpoint_every == 0 or trainer.step == recipe.steps:
            trainer.save(checkpoint)
    return trainer.average


def best_device() -> torch.device:
    """Return CUDA if there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@dataclass(slots=True)
class Trainer:
    """All state that changes from step to step.

    key: hash of recipe and pictures; only a checkpoint with this key is resumed.
    seconds: spent on training, earlier runs included.
    network: the weights that are trained. average: their moving average, which is the result.
    """

    recipe: Recipe
    key: str
    device: torch.device = field(default_factory=best_device)
    step: int = 0
    seconds: float = 0.0
    network: CentreNetwork = field(init=False)
    average: CentreNetwork = field(init=False)
    optimiser: Optimiser = field(init=False)

    def __post_init__(self) -> None:
        recipe = self.recipe
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(recipe.seed)
            network = CentreNetwork()
        self.network = channels_last(network.to(self.device))
        self.average = CentreNetwork().to(self.device)
        self.average.load_state_dict(network.state_dict())
        self.average.requires_grad_(False).eval()
        self.optimiser = Optimiser(self.network, recipe)

    def train_on(self, crops: Batch) -> float:
        """Take one step; return the loss before it."""
        self.network.train()
        self.optimiser.zero_grad()
        crops = crops.to(self.device)
        kind = self.device.type
        with torch.autocast(kind, torch.bfloat16, enabled=kind == "cuda"):
            maps = self.network(crops.pixels)
        loss = losses(maps, crops.targets).total
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), LARGEST_GRADIENT)
        self.optimiser.step()
        self.step += 1
        if self.step % AVERAGE_EVERY == 0 or self.step == self.recipe.steps:
            self._update_average()
        return float(loss.detach())

    @torch.no_grad()
    def _update_average(self) -> None:
        decay = min(AVERAGE_DECAY, (1 + self.step) / (10 + self.step)) ** AVERAGE_EVERY
        new = self.network.state_dict()
        for name, value in self.average.state_dict().items():
            if value.is_floating_point():
                value.lerp_(new[name], 1 - decay)
            else:
                value.copy_(new[name])

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        state = {name: getattr(self, name).state_dict() for name in _SAVED_PARTS}
        data = {"key": self.key, "step": self.step, "seconds": self.seconds, **state}
        write_atomically(path, lambda part: torch.save(data, part))

    def resume(self, path: Path) -> bool:
        """Load a checkpoint of the same key; return whether there was one."""
        if not path.exists():
            return False
        try:
            # Only tensors and plain values are read: nothing in the file can run.
            data: dict[str, Any] = torch.load(path, self.device, weights_only=True)
        except Exception:
            return False
        if data.get("key") != self.key:
            return False
        for name in _SAVED_PARTS:
            getattr(self, name).load_state_dict(data[name])
        self.step = data["step"]
        self.seconds = data["seconds"]
        return True


_SAVED_PARTS = ("network", "average", "optimiser")


class Optimiser:
    """Muon for the kernels of convolutions, AdamW for all other weights, one cycle of rates.

    Muon (Jordan 2024) treats a kernel as a matrix of outputs by inputs and changes it equally in
    all its directions: it needs far fewer steps than AdamW. torch's Muon takes only matrices, so it
    gets views of the kernels' memory; a network that is moved to another device needs a new
    optimiser.
    """

    def __init__(self, network: nn.Module, recipe: Recipe) -> None:
        """Take a network whose kernels lie in memory channels last; others raise `RuntimeError`."""
        self._kernels = [p for p in network.parameters() if p.ndim == 4 and p.shape[-1] > 1]
        self._matrices = [nn.Parameter(_matrix(p.detach())) for p in self._kernels]
        kernel_ids = {id(p) for p in self._kernels}
        others = [p for p in network.parameters() if id(p) not in kernel_ids]
        decay = recipe.weight_decay
        self._parts: dict[str, torch.optim.Optimizer] = {
            "muon": torch.optim.Muon(self._matrices, recipe.kernel_rate, weight_decay=decay),
            "adamw": torch.optim.AdamW(_groups(others, decay), recipe.learning_rate),
        }
        highest = {"muon": recipe.kernel_rate, "adamw": recipe.learning_rate}
        self._cycles = {
            name: torch.optim.lr_scheduler.OneCycleLR(
                part,
                highest[name],
                total_steps=recipe.steps + 1,
                pct_start=RISE,
                cycle_momentum=name == "adamw",
            )
            for name, part in self._parts.items()
        }

    def zero_grad(self) -> None:
        """Drop all gradients."""
        for part in self._parts.values():
            part.zero_grad(set_to_none=True)
        for kernel in self._kernels:
            kernel.grad = None

    def step(self) -> None:
        """Change all weights, then the learning rates."""
        for kernel, matrix in zip(self._kernels, self._matrices, strict=True):
            assert kernel.grad is not None
            matrix.grad = kernel.grad.permute(0, 2, 3, 1).flatten(1)
        for name, part in self._parts.items():
            part.step()
            self._cycles[name].step()

    def state_dict(self) -> dict[str, Any]:
        """Return all state that `load_state_dict` needs to continue."""
        parts = {name: part.state_dict() for name, part in self._parts.items()}
        return parts | {f"{name}-cycle": c.state_dict() for name, c in self._cycles.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what `state_dict` returned."""
        for name, part in self._parts.items():
            part.load_state_dict(state[name])
            self._cycles[name].load_state_dict(state[f"{name}-cycle"])


def _matrix(kernel: torch.Tensor) -> torch.Tensor:
    """Return a view of (outs, ins, h, w), channels last, as (outs, h * w * ins)."""
    return kernel.permute(0, 2, 3, 1).view(len(kernel), -1)


def _groups(weights: list[nn.Parameter], weight_decay: float) -> list[dict[str, Any]]:
    """Return AdamW's groups of parameters: norms and biases have no weight decay."""
    wide = [p for p in weights if p.ndim > 1]
    flat = [p for p in weights if p.ndim <= 1]
    return [{"params": wide, "weight_decay": weight_decay}, {"params": flat, "weight_decay": 0.0}]
