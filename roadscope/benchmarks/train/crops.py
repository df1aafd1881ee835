"""Batches of crops: cut from pictures at other places and scales, and given other light.

Each batch follows from its number alone, so that a stopped run can go on anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from roadscope.benchmarks.metrics.image_labels import Labels
from roadscope.benchmarks.train.loss_functions import CropObjects, TargetMaps, targets_of
from roadscope.benchmarks.train.pictures import Pictures, PixelSize
from roadscope.benchmarks.train.recipe import Recipe
from roadscope.core.bounds import Bounds
from roadscope.core.jit import compiled

# --------------------------------------------------------------------------------------------------
# Batches

CROP_SIZES = (
    PixelSize(64, 192),
    PixelSize(96, 160),
    PixelSize(96, 320),
    PixelSize(128, 256),
    PixelSize(192, 256),
    PixelSize(256, 320),
    PixelSize(128, 448),
    PixelSize(384, 512),
)
"""All crops of a batch have one size; each is equally likely. Sides are multiples of 32. Low crops
hold twice the objects for their area, as most objects are near the horizon."""


class Batch(NamedTuple):
    """Crops and their targets.

    pixels: (B, H, W, 3) float32 in -1 to 1. targets: the maps that the network should answer with.
    """

    pixels: Tensor
    targets: TargetMaps

    def to(self, device: torch.device) -> Batch:
        """Move all to a device."""
        return Batch(self.pixels.to(device), TargetMaps(*(t.to(device) for t in self.targets)))


class ShuffledPictures:
    """All pictures of some episodes, shuffled anew in each epoch."""

    def __init__(self, episodes: Sequence[Pictures], seed: int) -> None:
        self._indices = [(e, k) for e, episode in enumerate(episodes) for k in range(len(episode))]
        self._episodes = episodes
        self._seed = seed
        self._epoch = -1
        self._order = np.empty(0, int)

    def crop(
        self, number: int, size: PixelSize, rng: np.random.Generator
    ) -> tuple[Tensor, TargetMaps]:
        """Return the number-th crop of the training, (3, h, w) in 0 to 1, and its targets."""
        epoch, position = divmod(number, len(self._indices))
        e, k = self._indices[self._order_of(epoch)[position]]
        pixels, labels = self._episodes[e].pixels[k], self._episodes[e].labels[k]
        window = draw_window(labels, PixelSize(*pixels.shape[:2]), size, rng)
        image = relit(cut_out(pixels, window, size), rng)
        return image, targets_of(objects_in(labels, window, size), size)

    def _order_of(self, epoch: int) -> np.ndarray:
        """Return the order of an epoch; the last one is remembered."""
        if self._epoch != epoch:
            rng = np.random.default_rng([self._seed, 1, epoch])
            self._epoch, self._order = epoch, rng.permutation(len(self._indices))
        return self._order


def batch(pictures: ShuffledPictures, recipe: Recipe, step: int) -> Batch:
    """Return the batch of a step, the same whenever it is made."""
    rng = np.random.default_rng([recipe.seed, 2, step])
    size = CROP_SIZES[int(rng.integers(len(CROP_SIZES)))]
    count = max(1, round(recipe.pixels / (size.height * size.width)))
    # Steps are numbered as if all had the largest batch, so that no two share a crop.
    smallest = min(s.height * s.width for s in CROP_SIZES)
    first = step * (round(recipe.pixels / smallest) + 1)
    crops = [pictures.crop(first + i, size, rng) for i in range(count)]
    pixels = torch.stack([image.permute(1, 2, 0) for image, _ in crops])
    targets = TargetMaps.stacked([each for _, each in crops])
    return Batch(pixels.mul_(2).sub_(1), targets)


# --------------------------------------------------------------------------------------------------
# Where a crop is cut out, and which objects it holds

LEAST_INSIDE = 0.25
"""Share of a box that must be inside a crop for its object to be eligible; chosen by hand."""
LEAST_SIDE_PX = 2.0
"""Boxes with a shorter side are dropped from a crop; chosen by hand."""
LEAST_HEIGHT_PX = 7.0
"""Objects less high in the crop are not eligible; chosen by hand."""
AT_OBJECT_SHARE = 0.75
"""Share of the crops that hold a chosen object, of each family equally often."""
ZOOM = Bounds(0.75, 1.6)
"""Pixels of the picture for one of the crop, evenly on a logarithmic scale."""


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of a picture: its left top corner and its size, pixels.

    mirrored: whether left and right are exchanged when it is cut out.
    """

    left: int
    top: int
    width: int
    height: int
    mirrored: bool = False


def draw_window(
    labels: Labels, picture: PixelSize, crop: PixelSize, rng: np.random.Generator
) -> Window:
    """Draw a window for a crop of a picture."""
    zoom = np.exp(rng.uniform(*np.log(ZOOM)))
    scale = min(zoom, picture.height / crop.height, picture.width / crop.width)
    height, width = (round(scale * side) for side in crop)
    top, left = rng.random(2) * (picture.height - height, picture.width - width)
    eligible = np.flatnonzero(labels.eligible)
    if len(eligible) and rng.random() < AT_OBJECT_SHARE:
        # The family is drawn first: there are few cyclists, and they would be learned from rarely.
        families = labels.families[eligible]
        box = labels.boxes[rng.choice(eligible[families == rng.choice(np.unique(families))])]
        x, y = (box[:2] + box[2:]) / 2 - rng.uniform(0.15, 0.85, 2) * (width, height)
        left, top = np.clip([x, y], 0, [picture.width - width, picture.height - height])
    return Window(int(left), int(top), width, height, bool(rng.random() < 0.5))


def objects_in(labels: Labels, window: Window, size: PixelSize) -> CropObjects:
    """Return the objects in a crop; those cut off too far, or too small there, are not eligible."""
    extent = np.array([window.width, window.height], float)
    corners = labels.boxes.reshape(-1, 2, 2) - (window.left, window.top)
    cut = np.clip(corners, 0, extent)
    whole_areas, cut_areas = ((c[:, 1] - c[:, 0]).prod(axis=1) for c in (corners, cut))
    boxes = (cut * (np.array([size.width, size.height]) / extent)).reshape(-1, 4)
    if window.mirrored:
        boxes[:, [0, 2]] = size.width - boxes[:, [2, 0]]
    sides = boxes[:, 2:] - boxes[:, :2]
    rows = np.flatnonzero((sides >= LEAST_SIDE_PX).all(axis=1))
    eligible = labels.eligible & (cut_areas >= LEAST_INSIDE * whole_areas)
    eligible &= sides[:, 1] >= LEAST_HEIGHT_PX
    return CropObjects(boxes[rows], labels.families[rows], labels.categories[rows], eligible[rows])


def cut_out(pixels: np.ndarray, window: Window, size: PixelSize) -> np.ndarray:
    """Return the window of (H, W, 3) uint8 pixels, resized to (h, w, 3) uint8."""
    rows = slice(window.top, window.top + window.height)
    columns = slice(window.left, window.left + window.width)
    part = np.array(pixels[rows, columns])
    if part.shape[:2] != size:
        image = torch.from_numpy(part).permute(2, 0, 1)[None]
        resized = functional.interpolate(
            image, size, mode="bilinear", align_corners=False, antialias=True
        )
        part = resized[0].permute(1, 2, 0).numpy()
    return np.ascontiguousarray(part[:, ::-1] if window.mirrored else part)


# --------------------------------------------------------------------------------------------------
# Other light; all shares and strengths here are chosen by hand

NOISE_SHARE = 0.3
"""Share of the crops with noise."""
BLUR_SHARE = 0.2
DUSK_SHARE = 0.12
HAZE_SHARE = 0.1
NOISE_TABLE = 1 << 18
"""Pixels that the table of standard normal draws has noise for."""


def relit(pixels: np.ndarray, rng: np.random.Generator) -> Tensor:
    """Change brightness, contrast, colours, sharpness and noise of (h, w, 3) uint8 pixels.

    Returns (3, h, w) float32 in 0 to 1, in memory as (h, w, 3).
    """
    saturation = np.float32(np.exp(rng.normal(0, 0.25)))
    blur, noise, strength = rng.random(3)
    tables = _tone_tables(pixels[::8, ::8].mean() / 255, rng)
    sigma = np.float32(0.005 + 0.04 * strength if noise < NOISE_SHARE else 0.0)
    first = 3 * int(rng.integers(NOISE_TABLE))
    output = np.empty(pixels.shape, np.float32)
    relight(pixels, tables, saturation, sigma, _normals(), first, output)
    image = torch.from_numpy(output).permute(2, 0, 1)
    return _blurred(image, rng) if blur < BLUR_SHARE else image


@cache
def _normals() -> np.ndarray:
    """Return (3 * NOISE_TABLE,) float32 standard normal draws; noise is read from any place on."""
    return np.random.default_rng(0).standard_normal(3 * NOISE_TABLE, np.float32)


def _tone_tables(mean: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the values, about 0 to 1, that the 256 bytes of each colour become, (3, 256) float32.

    mean: of the crop, 0 to 1; contrast is changed around what it becomes.
    """
    gain, gamma, contrast = np.exp(rng.normal(0, 0.2, 3))
    tint = np.exp(rng.normal(0, 0.06, 3))[:, None]
    dusk, darkness, haze, density, white = rng.random(5)
    if dusk < DUSK_SHARE:
        gain *= 0.1 + 0.5 * darkness
    bytes_and_mean = np.append(np.arange(256) / 255, mean)
    tables = gain * tint * bytes_and_mean**gamma
    tables = tables[:, -1:] + contrast * (tables[:, :-1] - tables[:, -1:])
    if haze < HAZE_SHARE:
        share = 0.1 + 0.4 * density
        tables = (1 - share) * tables + share * (0.4 + 0.5 * white)
    return np.asarray(tables, np.float32)


def _blurred(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Blur along rows, as motion does, or in both directions, as a lens out of focus."""
    width = 2 * int(rng.integers(1, 3)) + 1
    height = width if rng.random() < 0.5 else 1
    sides = (width // 2, width // 2, height // 2, height // 2)
    padded = functional.pad(image[None], sides, mode="replicate")
    return functional.avg_pool2d(padded, (height, width), stride=1)[0]


@compiled()
def relight(
    pixels: np.ndarray,
    tables: np.ndarray,
    saturation: np.float32,
    sigma: np.float32,
    normals: np.ndarray,
    first: int,
    output: np.ndarray,
) -> None:
    """Write (h, w, 3) uint8 pixels in another light into output, (h, w, 3) float32 in 0 to 1.

    tables: (3, 256) float32, the value that each byte of each colour becomes.
    saturation: factor of a pixel's distance from grey. sigma: standard deviation of the noise.
    normals: (N,) float32 standard normal draws, N a multiple of 3, read from place `first` on, and
        from the start again after the last.
    """
    zero, one, third = np.float32(0), np.float32(1), np.float32(1 / 3)
    place = first
    for i in range(pixels.shape[0]):
        for j in range(pixels.shape[1]):
            red = tables[0, pixels[i, j, 0]]
            green = tables[1, pixels[i, j, 1]]
            blue = tables[2, pixels[i, j, 2]]
            grey = (red + green + blue) * third
            output[i, j, 0] = grey + (red - grey) * saturation
            output[i, j, 1] = grey + (green - grey) * saturation
            output[i, j, 2] = grey + (blue - grey) * saturation
            for c in range(3):
                value = output[i, j, c]
                if sigma > zero:
                    value += sigma * normals[place + c]
                output[i, j, c] = min(max(value, zero), one)
            place += 3
            if place >= len(normals):
                place = 0
