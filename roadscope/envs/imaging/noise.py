"""Noise as a function of position: hashes of cells, and a tile of smooth noise."""

from __future__ import annotations

from functools import cache

import numpy as np

from roadscope.core.jit import compiled

NOISE_SIDE = 256
"""Cells along a side of the tile of noise; a power of two."""


@cache
def noise_tile() -> np.ndarray:
    """Return (256, 256) float32 noise of mean 0.5 in 0 to 1 that is periodic.

    Four octaves, the coarsest of 16 cells, each half as strong as the one before.
    """
    rng = np.random.default_rng(7)
    total = np.zeros((NOISE_SIDE, NOISE_SIDE))
    for octave, weight in enumerate((0.53, 0.27, 0.13, 0.07)):
        coarse = rng.random((16 << octave, 16 << octave))
        step = NOISE_SIDE // len(coarse)
        total += weight * _widened(_widened(coarse, step).T, step).T
    tile: np.ndarray = np.clip(0.5 + 1.25 * (total - 0.5), 0.0, 1.0).astype(np.float32)
    return tile


def _widened(rows: np.ndarray, step: int) -> np.ndarray:
    """Return rows with smooth steps between them, also from the last to the first."""
    share = ((np.arange(step) + 0.5) / step)[:, None]
    share = share * share * (3 - 2 * share)
    after = np.roll(rows, -1, axis=0)
    blended = rows[:, None] + share * (after - rows)[:, None]
    table: np.ndarray = blended.reshape(-1, rows.shape[1])
    return table


@compiled(forceinline=True, borrowing=True)
def grain(x: float, y: float) -> float:
    """Return a pseudo-random number in 0 to 1 for a unit cell of the plane."""
    state = np.uint64(np.int64(np.floor(x))) * np.uint64(0x9E3779B97F4A7C15)
    state ^= np.uint64(np.int64(np.floor(y))) * np.uint64(0xC2B2AE3D27D4EB4F)
    state ^= state >> np.uint64(29)
    state *= np.uint64(0xBF58476D1CE4E5B9)
    state ^= state >> np.uint64(32)
    uniform: float = np.float64(state >> np.uint64(11)) * 2.0**-53
    return uniform


@compiled(forceinline=True, borrowing=True)
def cell_of(tile: np.ndarray, x: float, y: float) -> float:
    """Return the noise of the cell of the tile that holds a point; the tile repeats."""
    row = np.int64(np.floor(y)) & (NOISE_SIDE - 1)
    column = np.int64(np.floor(x)) & (NOISE_SIDE - 1)
    value: float = tile[row, column]
    return value


@compiled(forceinline=True, borrowing=True)
def blend_of(tile: np.ndarray, x: float, y: float) -> float:
    """Return the noise at a point, linear between the cells of the tile."""
    i, j = np.floor(y), np.floor(x)
    u, v = x - j, y - i
    row, column = np.int64(i) & (NOISE_SIDE - 1), np.int64(j) & (NOISE_SIDE - 1)
    below, right = (row + 1) & (NOISE_SIDE - 1), (column + 1) & (NOISE_SIDE - 1)
    high = tile[row, column] + u * (tile[row, right] - tile[row, column])
    low = tile[below, column] + u * (tile[below, right] - tile[below, column])
    value: float = high + v * (low - high)
    return value
