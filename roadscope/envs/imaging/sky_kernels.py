"""The sky, computed at the corners of blocks of pixels, and the skyline at the horizon."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.face_kernels import Lens
from roadscope.envs.imaging.noise_kernels import blend_of

BLOCK = 8
"""Edge of the blocks in pixels; between their corners the sky is linear."""


class Air(NamedTuple):
    """Light and air, see `light.Light`; all light is multiplied by the exposure's gain.

    towards: (3,). sun, zenith, horizon, ground: (3,). clouds, lamps: as there.
    extinction: 1/m. veil: (3,) brightness of thick fog. wet: 0 to 1, how wet the ground is.
    sky: (3,) light of the open sky on level ground.
    """

    towards: np.ndarray
    sun: np.ndarray
    zenith: np.ndarray
    horizon: np.ndarray
    ground: np.ndarray
    clouds: float
    lamps: bool
    extinction: float
    veil: np.ndarray
    wet: float
    sky: np.ndarray


@compiled(borrowing=True)
def sky_blocks(lens: Lens, air: Air, noise: np.ndarray, blocks: np.ndarray) -> None:
    """Fill blocks (H / 8 + 2, W / 8 + 2, 3) float32 with the sky's light."""
    r = lens.rotation
    for i in range(blocks.shape[0]):
        dv = (i * BLOCK - lens.centre[1]) / lens.focal[1]
        for j in range(blocks.shape[1]):
            du = (j * BLOCK - lens.centre[0]) / lens.focal[0]
            x = r[0, 0] * du + r[1, 0] * dv + r[2, 0]
            y = r[0, 1] * du + r[1, 1] * dv + r[2, 1]
            z = r[0, 2] * du + r[1, 2] * dv + r[2, 2]
            scale = 1.0 / np.sqrt(1.0 + du * du + dv * dv)
            if z * scale > -0.06:
                _sky(air, noise, x * scale, y * scale, z * scale, blocks[i, j])


@compiled(borrowing=True)
def _sky(air: Air, noise: np.ndarray, x: float, y: float, z: float, light: np.ndarray) -> None:
    up = max(0.0, z)
    fall = 1.0 - min(1.0, up)
    share = 1.0 - fall * fall * fall
    toward = max(0.0, x * air.towards[0] + y * air.towards[1] + z * air.towards[2])
    open_share = 1.0 - 0.85 * max(0.0, 2.0 * air.clouds - 1.0)
    glow = open_share * (0.30 * toward**24 + 0.7 * toward**400)
    cloud, shade = 0.0, 1.0
    if air.clouds > 0.0 and up > 0.012:
        cloud, shade = _cloud(air, noise, x, y, up)
    sun = (air.sun[0] + air.sun[1] + air.sun[2]) / 3.0
    white = 0.30 * sun + 0.72 * air.horizon[1]
    haze = 1.0 / (1.0 + 10.0 * up)
    thick = 1.0 - np.exp(-air.extinction * min(9000.0, 250.0 / (up + 0.004)))
    for k in range(3):
        clear = air.horizon[k] + share * (air.zenith[k] - air.horizon[k]) + glow * air.sun[k]
        lit = white * (0.92 * shade + 0.08 * air.sun[k] / max(sun, 1e-9))
        lit += 0.35 * haze * (air.horizon[k] - lit)
        value = clear + cloud * (lit - clear)
        light[k] = value + thick * (air.veil[k] - value)


@compiled(borrowing=True)
def _cloud(air: Air, noise: np.ndarray, x: float, y: float, up: float) -> tuple[float, float]:
    """How much cloud hides the sky, and how bright its underside is."""
    scale = 18.0 / (up + 0.10)
    u, v = x * scale, y * scale
    field = 0.62 * blend_of(noise, u, v) + 0.26 * blend_of(noise, 2.7 * u + 40.0, 2.7 * v)
    field += 0.12 * blend_of(noise, 6.3 * u, 6.3 * v + 90.0) * min(1.0, 8.0 * up) + 0.02
    level = field - 0.78 + 0.62 * air.clouds
    cover = min(1.0, max(0.0, level * 5.0)) * min(1.0, 7.0 * up)
    return cover, 1.0 - 0.75 * min(0.4, max(0.0, level)) * (0.5 + 0.5 * air.clouds)


@compiled(borrowing=True)
def skyline(lens: Lens, noise: np.ndarray, heights: np.ndarray) -> None:
    """Fill heights (W,) with the sine of the elevation up to which far trees stand, by column."""
    r = lens.rotation
    for c in range(len(heights)):
        du = (c + 0.5 - lens.centre[0]) / lens.focal[0]
        x, y = r[0, 0] * du + r[2, 0], r[0, 1] * du + r[2, 1]
        bearing = np.arctan2(y, x)
        hill = blend_of(noise, 60.0 * bearing, 3.5)
        trees = blend_of(noise, 900.0 * bearing, 77.5)
        heights[c] = 0.003 + 0.016 * max(0.0, hill - 0.25) + 0.004 * trees
