"""What the prisms of a scene look like."""

from __future__ import annotations

import numpy as np

from roadscope.envs.imaging.pattern_kernels import LANTERN, METAL, Looks
from roadscope.envs.imaging.raster import Solids
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.world.materials import MATERIALS

_COLOURS = np.array([m.colour for m in MATERIALS])
_PATTERNS = np.array([int(m.pattern) for m in MATERIALS])
_GLOSS = np.array([m.gloss for m in MATERIALS])
LANTERN_M = 5.0
"""Metal that begins this high is the lantern of a lamp post."""


def looks_of(scene: Scene, solids: Solids, stamp_s: float, categories: np.ndarray) -> Looks:
    """Find colour, pattern and frame of every prism."""
    static, moving = scene.static, scene.moving
    rows = np.concatenate([static.materials, moving.materials]).astype(np.int64)
    yaws = scene.poses_at(np.array([stamp_s]))[0][moving.owners, 2]
    headings = np.concatenate([static.headings, moving.headings + yaws])
    kinds = np.concatenate([np.full(len(static), -1.0), categories[moving.owners]])
    owners, firsts, things = np.unique(solids.owners, return_index=True, return_inverse=True)
    frames = _frames(solids, headings, kinds, things, len(owners))
    seeds = (owners.astype(np.int64) * 2654435761 % 2**32 / 2**32)[things]
    colours, patterns = _COLOURS[rows], _PATTERNS[rows]
    patterns[(patterns == METAL) & (solids.bottoms > LANTERN_M)] = LANTERN
    return Looks(
        colours, patterns, _GLOSS[rows], frames, np.ones(len(rows)), seeds,
        colours[firsts][things], np.column_stack([solids.bottoms, solids.tops]),
    )  # fmt: skip


def _frames(
    solids: Solids, headings: np.ndarray, kinds: np.ndarray, things: np.ndarray, count: int
) -> np.ndarray:
    """(P, 8) frames of the things that prisms belong to."""
    cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x, y = solids.footprints[..., 0], solids.footprints[..., 1]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    lows, highs = np.full((2, count), np.inf), np.full((3, count), -np.inf)
    for i, values in enumerate((along, across)):
        np.minimum.at(lows[i], things, values.min(axis=1, initial=np.inf))
        np.maximum.at(highs[i], things, values.max(axis=1, initial=-np.inf))
    np.maximum.at(highs[2], things, solids.tops)
    u, v = ((lows + highs[:2]) / 2)[:, things]
    half = ((highs[:2] - lows) / 2)[:, things]
    c, s = cosine[:, 0], sine[:, 0]
    return np.column_stack([u * c - v * s, u * s + v * c, c, s, *half, highs[2][things], kinds])
