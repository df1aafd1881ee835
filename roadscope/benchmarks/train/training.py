"""The training loop; weights are averaged over steps."""

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
from roadscope.benchmarks.train.batches import Batch, Deck, batches
from roadscope.benchmarks.train.losses import losses
from roadscope.benchmarks.train.optimiser import Optimiser
from roadscope.benchmarks.train.recipe import Recipe
from roadscope.benchmarks.train.views import Pictures
from roadscope.detectors.camera.network import CentreNetwork, channels_last
from roadscope.detectors.camera.precision import has_bfloat16

SAVED_EVERY = 100
AVERAGED = 0.998
"""How much of the averaged weights stays in a step."""
AVERAGED_EVERY = 5
"""Steps from one averaging to the next, which does for all of them."""
LONGEST_STEP = 10.0
"""Norm of the gradient."""


@dataclass(slots=True)
class Trainer:
    """All that changes from step to step.

    key: of recipe and pictures; a checkpoint of another key is not gone on with.
    seconds: spent on learning, earlier runs included.
    """

    recipe: Recipe
    key: str
    device: torch.device = field(default_factory=lambda: best_device())
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

    def learn(self, batch: Batch) -> float:
        """Take one step; return the loss before it."""
        self.network.train()
        self.optimiser.zero_grad()
        batch = batch.to(self.device)
        kind = self.device.type
        with torch.autocast(kind, torch.bfloat16, enabled=has_bfloat16(kind)):
            maps = self.network(batch.pixels)
        loss = losses(maps, batch.targets).total
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), LONGEST_STEP)
        self.optimiser.step()
        self.step += 1
        if self.step % AVERAGED_EVERY == 0 or self.step == self.recipe.steps:
            self._average()
        return float(loss.detach())

    @torch.no_grad()
    def _average(self) -> None:
        kept = min(AVERAGED, (1 + self.step) / (10 + self.step)) ** AVERAGED_EVERY
        new = self.network.state_dict()
        for name, value in self.average.state_dict().items():
            if value.is_floating_point():
                value.lerp_(new[name], 1 - kept)
            else:
                value.copy_(new[name])

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        state = {name: getattr(self, name).state_dict() for name in _PARTS}
        data = {"key": self.key, "step": self.step, "seconds": self.seconds, **state}
        write_atomically(path, lambda part: torch.save(data, part))

    def resume(self, path: Path) -> bool:
        """Go on from a checkpoint of the same key; return whether there was one."""
        if not path.exists():
            return False
        try:
            # Only tensors and plain values are read: nothing in the file can run.
            data: dict[str, Any] = torch.load(path, self.device, weights_only=True)
        except Exception:
            return False
        if data.get("key") != self.key:
            return False
        for name in _PARTS:
            getattr(self, name).load_state_dict(data[name])
        self.step = data["step"]
        self.seconds = data["seconds"]
        return True


_PARTS = ("network", "average", "optimiser")


def best_device() -> torch.device:
    """Return CUDA if there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def train(
    trainer: Trainer,
    episodes: Sequence[Pictures],
    checkpoint: Path,
    *,
    progress: Progress = silent,
    told: Callable[[int, float], None] = lambda step, loss: None,
) -> CentreNetwork:
    """Train to the end, from the checkpoint if there is one; return the averaged network.

    told: is given every step and its loss.
    """
    recipe = trainer.recipe
    trainer.resume(checkpoint)
    deck = Deck(episodes, recipe.seed)
    progress("training", trainer.step, recipe.steps)
    before, since = trainer.seconds, time.monotonic()
    for batch in batches(deck, recipe, trainer.step):
        loss = trainer.learn(batch)
        trainer.seconds = before + time.monotonic() - since
        told(trainer.step, loss)
        progress("training", trainer.step, recipe.steps)
        if trainer.step % SAVED_EVERY == 0 or trainer.step == recipe.steps:
            trainer.save(checkpoint)
    return trainer.average
