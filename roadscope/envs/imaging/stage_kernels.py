"""What is lit, and the air that light passes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

FADES = 1024
"""Steps of the table of what the air lets through, up to an optical depth of `THICKEST`."""
THICKEST = 12.0


class Stage(NamedTuple):
    """What is lit, beside lens and air.

    footprints: (P, 12, 2), corners: (P,) of the prisms. normals, glow: (P, 14, 3) of the faces:
    outward unit vector, and light that falls on it. lit, open_sky: (H, W) uint8, see
    `cast_shadows`. cells: (3, SIDE, SIDE + PADDING) uint32, middles: (3, 2) of the ground.
    noise: see `noise_tile`. pools: (256, 256, 2), corner: x y, see `light_pools`. blocks: see
    `sky_blocks`.
    heights: (W,), see `skyline`. fades: (1025,) share of light that passes, by optical depth.
    """

    footprints: np.ndarray
    corners: np.ndarray
    normals: np.ndarray
    glow: np.ndarray
    lit: np.ndarray
    open_sky: np.ndarray
    cells: np.ndarray
    middles: np.ndarray
    noise: np.ndarray
    pools: np.ndarray
    corner: tuple[float, float]
    blocks: np.ndarray
    heights: np.ndarray
    fades: np.ndarray


@compiled(forceinline=True, borrowing=True)
def share_passed(fades: np.ndarray, thickness: float) -> float:
    """Share of light that passes an optical depth, exp(-thickness), from the table."""
    at = min(thickness, 0.999 * THICKEST) * (FADES / THICKEST)
    step = int(at)
    low: float = fades[step]
    share: float = low + (at - step) * (fades[step + 1] - low)
    return share
