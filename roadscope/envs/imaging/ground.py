"""The painted ground around a camera, kept from frame to frame."""

from __future__ import annotations

import numpy as np

from roadscope.envs.imaging.ground_kernels import CELLS_M, SIDE, TILE, TILES, Paving, paint_tile
from roadscope.envs.world.ground import PAVED, SHOULDERS_M, Surface

ASPHALT = (0.075, 0.076, 0.08)
CONCRETE = (0.26, 0.25, 0.235)
GRASS = (0.055, 0.085, 0.025)
PAINT = (0.62, 0.62, 0.60)
KERB = (0.38, 0.37, 0.35)


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
        self.cells = np.zeros((len(CELLS_M), SIDE, SIDE, 3), np.uint8)
        self._painted: list[dict[tuple[int, int], tuple[int, int]]] = [{} for _ in CELLS_M]

    def around(self, place: np.ndarray) -> np.ndarray:
        """Return (3, SIDE, SIDE, 3) uint8 cells, painted around an (x, y) place."""
        for level, cell_m in enumerate(CELLS_M):
            middle = np.floor(np.asarray(place)[:2] / (TILE * cell_m)).astype(int)
            for dx in range(-TILES // 2, TILES // 2):
                for dy in range(-TILES // 2, TILES // 2):
                    self._paint(level, (int(middle[0]) + dx, int(middle[1]) + dy))
        return self.cells

    def _paint(self, level: int, tile: tuple[int, int]) -> None:
        slot = (tile[0] % TILES, tile[1] % TILES)
        if self._painted[level].get(slot) != tile:
            paint_tile(
                self.surface.strips, self.surface.lines, self.paving, CELLS_M[level], tile,
                self.cells[level],
            )  # fmt: skip
            self._painted[level][slot] = tile
