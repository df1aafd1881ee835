"""Crops of pictures under other light, through other lenses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from roadscope.benchmarks.metrics.image_labels import Labels
from roadscope.benchmarks.train.relight_kernels import relight
from roadscope.benchmarks.train.targets import Objects

LEAST_SHARE = 0.25
"""Of a box that must be inside a crop for its object to be asked for."""
LEAST_SIDE_PX = 2.0
LEAST_HEIGHT_PX = 7.0
AT_AN_OBJECT = 0.75
"""Share of crops that are laid around an object, of each family that is there as often."""
ZOOM = (0.75, 1.6)
NOISY = 0.3
"""Share of the crops that are given noise."""
DRAWS = 1 << 18


@dataclass(frozen=True, slots=True)
class Window:
    """A piece of a picture: its corner, its extent, pixels; and whether it is mirrored."""

    left: float
    top: float
    width: float
    height: float
    mirrored: bool = False


def drawn_window(
    labels: Labels, size: tuple[int, int], crop: tuple[int, int], rng: np.random.Generator
) -> Window:
    """Draw a window for a crop (height, width) of a picture (height, width)."""
    zoom = np.exp(rng.uniform(*np.log(ZOOM)))
    scale = min(zoom, size[0] / crop[0], size[1] / crop[1])
    height, width = (round(scale * n) for n in crop)
    top, left = rng.random(2) * (size[0] - height, size[1] - width)
    asked = np.flatnonzero(labels.eligible)
    if len(asked) and rng.random() < AT_AN_OBJECT:
        # A family first: cyclists are few, and would be learned from as seldom as they are met.
        families = labels.families[asked]
        box = labels.boxes[rng.choice(asked[families == rng.choice(np.unique(families))])]
        x, y = (box[:2] + box[2:]) / 2 - rng.uniform(0.15, 0.85, 2) * (width, height)
        left, top = np.clip([x, y], 0, [size[1] - width, size[0] - height])
    return Window(int(left), int(top), width, height, bool(rng.random() < 0.5))


def objects_in(labels: Labels, window: Window, crop: tuple[int, int]) -> Objects:
    """Return the objects of a crop; those cut off too much, or too small now, are not asked."""
    extent = np.array([window.width, window.height], float)
    corners = labels.boxes.reshape(-1, 2, 2) - (window.left, window.top)
    cut = np.clip(corners, 0, extent)
    before, after = ((c[:, 1] - c[:, 0]).prod(axis=1) for c in (corners, cut))
    boxes = (cut * (np.array(crop[::-1]) / extent)).reshape(-1, 4)
    if window.mirrored:
        boxes[:, [0, 2]] = crop[1] - boxes[:, [2, 0]]
    sides = boxes[:, 2:] - boxes[:, :2]
    there = np.flatnonzero((sides >= LEAST_SIDE_PX).all(axis=1))
    asked = labels.eligible & (after >= LEAST_SHARE * before) & (sides[:, 1] >= LEAST_HEIGHT_PX)
    return Objects(boxes[there], labels.families[there], labels.categories[there], asked[there])


def cut_out(pixels: np.ndarray, window: Window, crop: tuple[int, int]) -> np.ndarray:
    """Return the window of (H, W, 3) uint8 pixels as (h, w, 3) uint8."""
    left, top = int(window.left), int(window.top)
    part = np.array(pixels[top : top + int(window.height), left : left + int(window.width)])
    if part.shape[:2] != crop:
        image = torch.from_numpy(part).permute(2, 0, 1)[None]
        resized = functional.interpolate(
            image, crop, mode="bilinear", align_corners=False, antialias=True
        )
        part = resized[0].permute(1, 2, 0).numpy()
    return np.ascontiguousarray(part[:, ::-1] if window.mirrored else part)


def relit(pixels: np.ndarray, rng: np.random.Generator) -> Tensor:
    """Change brightness, contrast, colours, sharpness and noise of (h, w, 3) uint8 pixels.

    Returns (3, h, w) float32 in 0 to 1, in memory as (h, w, 3).
    """
    colour = np.float32(np.exp(rng.normal(0, 0.25)))
    blur, noise, spread = rng.random(3)
    tables = _tables(pixels[::8, ::8].mean() / 255, rng)
    strength = np.float32(0.005 + 0.04 * spread if noise < NOISY else 0.0)
    lit = np.empty(pixels.shape, np.float32)
    relight(pixels, tables, colour, strength, _normals(), 3 * int(rng.integers(DRAWS)), lit)
    image = torch.from_numpy(lit).permute(2, 0, 1)
    return _blurred(image, rng) if blur < 0.2 else image


@cache
def _normals() -> np.ndarray:
    """Return (3 * DRAWS,) float32 draws: noise begins anywhere among them."""
    return np.random.default_rng(0).standard_normal(3 * DRAWS, np.float32)


def _tables(mean: float, rng: np.random.Generator) -> np.ndarray:
    """Draw what becomes of the 256 bytes of each colour, (3, 256) float32 around 0 to 1."""
    gain, gamma, contrast = np.exp(rng.normal(0, 0.2, 3))
    tint = np.exp(rng.normal(0, 0.06, 3))[:, None]
    dusk, darkness, haze, thick, white = rng.random(5)
    if dusk < 0.12:
        gain *= 0.1 + 0.5 * darkness
    bytes_ = np.append(np.arange(256) / 255, mean)
    tables = gain * tint * bytes_**gamma
    tables = tables[:, -1:] + contrast * (tables[:, :-1] - tables[:, -1:])
    if haze < 0.1:
        share = 0.1 + 0.4 * thick
        tables = (1 - share) * tables + share * (0.4 + 0.5 * white)
    return np.asarray(tables, np.float32)


def _blurred(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Blur along rows, as motion does, or in both directions, as a lens out of focus."""
    width = 2 * int(rng.integers(1, 3)) + 1
    rows = width if rng.random() < 0.5 else 1
    sides = (width // 2, width // 2, rows // 2, rows // 2)
    padded = functional.pad(image[None], sides, mode="replicate")
    return functional.avg_pool2d(padded, (rows, width), stride=1)[0]
