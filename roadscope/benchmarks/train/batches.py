"""Batches of crops, each made from its number alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from roadscope.benchmarks.train.augment import cut_out, drawn_window, objects_in, relit
from roadscope.benchmarks.train.losses import TargetMaps
from roadscope.benchmarks.train.recipe import Recipe
from roadscope.benchmarks.train.targets import Targets, targets_of
from roadscope.benchmarks.train.views import Pictures

CROPS = (
    (64, 192), (96, 160), (96, 320), (128, 256), (192, 256), (256, 320), (128, 448), (384, 512),
)  # fmt: skip
"""Height and width, drawn from evenly: multiples of 32. Low ones hold twice the objects: most are
near the horizon."""


class Batch(NamedTuple):
    """pixels: (B, H, W, 3) in -1 to 1, and what is to be said of them."""

    pixels: Tensor
    targets: TargetMaps

    def to(self, device: torch.device) -> Batch:
        """Move all to a device."""
        return Batch(self.pixels.to(device), TargetMaps(*(t.to(device) for t in self.targets)))


class Deck:
    """All pictures, dealt anew in every round so that each comes up equally often."""

    def __init__(self, episodes: Sequence[Pictures], seed: int) -> None:
        self._places = [(e, k) for e, episode in enumerate(episodes) for k in range(len(episode))]
        self._episodes = episodes
        self._seed = seed
        self._dealt = -1, np.empty(0, int)

    def crop(
        self, number: int, crop: tuple[int, int], rng: np.random.Generator
    ) -> tuple[Tensor, Targets]:
        """Return the number-th crop of all, (3, h, w) in 0 to 1, and its targets."""
        turn, place = divmod(number, len(self._places))
        e, k = self._places[self._order(turn)[place]]
        pixels, labels = self._episodes[e].pixels[k], self._episodes[e].labels[k]
        window = drawn_window(labels, pixels.shape[:2], crop, rng)
        image = relit(cut_out(pixels, window, crop), rng)
        return image, targets_of(objects_in(labels, window, crop), *crop)

    def _order(self, turn: int) -> np.ndarray:
        """Return the order of a round; the last one is remembered."""
        if self._dealt[0] != turn:
            rng = np.random.default_rng([self._seed, 1, turn])
            self._dealt = turn, rng.permutation(len(self._places))
        return self._dealt[1]


def batch(deck: Deck, recipe: Recipe, step: int) -> Batch:
    """Return the batch of a step, the same whenever it is made."""
    rng = np.random.default_rng([recipe.seed, 2, step])
    crop = CROPS[int(rng.integers(len(CROPS)))]
    count = max(1, round(recipe.pixels / (crop[0] * crop[1])))
    # Numbers leave room for the largest batch, so that steps share no crop.
    most = round(recipe.pixels / min(h * w for h, w in CROPS)) + 1
    made = [deck.crop(step * most + i, crop, rng) for i in range(count)]
    pixels = torch.stack([image.permute(1, 2, 0) for image, _ in made])
    columns = zip(*([*_arrays(t)] for _, t in made), strict=True)
    maps = TargetMaps(*(torch.from_numpy(np.stack(column)) for column in columns))
    return Batch(pixels.mul_(2).sub_(1), maps)


def _arrays(targets: Targets) -> tuple[np.ndarray, ...]:
    return targets.heat, targets.judged, targets.boxes, targets.weights, targets.vehicles


def batches(deck: Deck, recipe: Recipe, first: int) -> Iterator[Batch]:
    """Yield the batches from a step on.

    They are made when asked for: a thread that makes them ahead takes turns with those that learn,
    which wait for each other at every layer, and where all cores learn that costs more than it
    saves.
    """
    for step in range(first, recipe.steps):
        yield batch(deck, recipe, step)
