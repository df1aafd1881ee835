"""The painted ground around a camera, kept from frame to frame."""

from __future__ import annotations

import numpy as np

from roadscope.envs.imaging.ground_kernels import (
    CELLS_M,
    PADDING,
    SIDE,
    TILE,
    TILES,
    Paving,
    paint_tile,
)
from roadscope.envs.imaging.noise_kernels import noise_tile
from roadscope.envs.world.ground import PAVED, SHOULDERS_M, Surface

ASPHALT = (0.078, 0.079, 0.082)
CONCRETE = (0.24, 0.23, 0.215)
GRASS = (0.060, 0.082, 0.028)
PAINT = (0.62, 0.62, 0.60)
KERB = (0.36, 0.35, 0.33)
AHEAD = 0.3
"""The squares of cells lie this share of a side ahead of the camera, where it looks."""


class Ground:
    """Three squares of cells, from fine near the camera to coarse far away."""

    def __init__(self, surface: Surface, style: str) -> None:
        """Take what lies on the ground and the roadside style."""
        paved = style in PAVED
        self.paving = Paving(
            np.array(ASPHALT), np.array(CONCRETE if paved else ASPHALT), np.array(GRASS),
            np.array(PAINT), np.array(KERB), SHOULDERS_M.get(style, 0.5), paved,
        )  # fmt: skip
        self.surface = surface
        self.cells = np.zeros((len(CELLS_M), SIDE, SIDE + PADDING), np.uint32)
        self.middles = np.zeros((len(CELLS_M), 2))
        self._painted: list[dict[tuple[int, int], tuple[int, int]]] = [{} for _ in CELLS_M]

    def around(self, place: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """Return (3, SIDE, SIDE + PADDING) uint32 cells around a place, most of them ahead, (x, y).

        `middles` (3, 2) then holds the middles of the squares, metres.
        """
        ahead = np.asarray(ahead)[:2] / max(float(np.linalg.norm(ahead[:2])), 1e-9)
        for level, cell_m in enumerate(CELLS_M):
            aim = np.asarray(place)[:2] + AHEAD * SIDE * cell_m * ahead
            middle = np.rint(aim / (TILE * cell_m)).astype(int)
            self.middles[level] = middle * TILE * cell_m
            for dx in range(-TILES // 2, TILES // 2):
                for dy in range(-TILES // 2, TILES // 2):
                    self._paint(level, (int(middle[0]) + dx, int(middle[1]) + dy))
        return self.cells

    def _paint(self, level: int, tile: tuple[int, int]) -> None:
        slot = (tile[0] % TILES, tile[1] % TILES)
        if self._painted[level].get(slot) != tile:
            paint_tile(
                self.surface.strips, self.surface.lines, self.paving, noise_tile(),
                CELLS_M[level], tile, self.cells[level],
            )  # fmt: skip
            self._painted[level][slot] = tile
