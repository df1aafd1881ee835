"""Light that goes astray in lens and air: halos of lamps, the sun's veil, streaks of rain."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.lighting import BLOCK
from roadscope.envs.imaging.raster import SKY_FACE

HALO = 0.10
"""Share of the light above white that a halo throws around."""
REACH = 9
"""Blocks that a halo reaches in each direction."""
DROPS = 60.0
"""Drops in the view within reach of a streak, for 1 mm/h."""
FALL_M_S = 6.5
DROP_M = 0.0016


@compiled()
def halo_weights() -> np.ndarray:
    """Return (19, 19) float64: what share of a block's light above white each one around takes."""
    weights = np.empty((2 * REACH + 1, 2 * REACH + 1))
    for di in range(-REACH, REACH + 1):
        for dj in range(-REACH, REACH + 1):
            square = di * di + dj * dj
            weight = HALO * (np.exp(-square / 2.5) + 1.2 / (square + 8.0))
            weights[di + REACH, dj + REACH] = weight * max(0.0, 1.0 - square / 90.0)
    return weights


@compiled(borrowing=True)
def bloom(light: np.ndarray, weights: np.ndarray, bright: np.ndarray, glare: np.ndarray) -> None:
    """Add to glare the light above white, gathered by blocks and smeared over their neighbours.

    weights: of `halo_weights`.
    """
    height, width = light.shape[:2]
    bright[:] = 0.0
    for r in range(height):
        for c in range(width):
            if max(light[r, c, 0], max(light[r, c, 1], light[r, c, 2])) > 0.9:
                for k in range(3):
                    bright[r // BLOCK, c // BLOCK, k] += light[r, c, k] / (BLOCK * BLOCK)
    rows, columns = bright.shape[:2]
    for i in range(rows):
        for j in range(columns):
            if bright[i, j, 0] + bright[i, j, 1] + bright[i, j, 2] > 0.0:
                for y in range(max(0, i - REACH), min(rows, i + REACH + 1)):
                    for x in range(max(0, j - REACH), min(columns, j + REACH + 1)):
                        weight = weights[y - i + REACH, x - j + REACH]
                        for k in range(3):
                            glare[y, x, k] += weight * bright[i, j, k]


@compiled(borrowing=True)
def spread_sun(
    light: np.ndarray,
    faces: np.ndarray,
    sun: np.ndarray,
    strength: np.ndarray,
    focal: np.ndarray,
    centre: np.ndarray,
    glare: np.ndarray,
) -> None:
    """Add the veil that the sun throws over the image: falls with the square of the angle.

    sun: (3,) direction in the camera's frame. Draws the disc of the sun into light, and dims the
    veil by the share of the disc that something hides; beyond the image it counts as seen.
    """
    height, width = faces.shape
    u, v = focal[0] * sun[0] / sun[2] + centre[0], focal[1] * sun[1] / sun[2] + centre[1]
    radius = 0.0075 * focal[0]
    seen, total = 0, 0
    for r in range(int(max(0.0, v - radius)), int(min(1.0 * height, v + radius + 1.0))):
        for c in range(int(max(0.0, u - radius)), int(min(1.0 * width, u + radius + 1.0))):
            away = np.sqrt((r + 0.5 - v) ** 2 + (c + 0.5 - u) ** 2)
            if away > radius:
                continue
            total += 1
            if faces[r, c] == SKY_FACE:
                seen += 1
                edge = min(1.0, 0.5 * (radius - away))
                for k in range(3):
                    light[r, c, k] += 12.0 * edge * strength[k]
    share = 1.0 if total == 0 else seen / total
    for i in range(glare.shape[0]):
        for j in range(glare.shape[1]):
            x = (j * BLOCK - centre[0]) / focal[0]
            y = (i * BLOCK - centre[1]) / focal[1]
            cosine = (x * sun[0] + y * sun[1] + sun[2]) / np.sqrt(1.0 + x * x + y * y)
            square = 2.0 * (1.0 - min(1.0, cosine))
            veil = share * (0.0035 / (square + 0.0012) + 0.06 * max(0.0, cosine) ** 4)
            for k in range(3):
                glare[i, j, k] += veil * strength[k]


@compiled(borrowing=True)
def rain_streaks(
    light: np.ndarray,
    q: np.ndarray,
    above: np.ndarray,
    focal: float,
    exposure_s: float,
    rate_mm_h: float,
    key: np.uint64,
) -> None:
    """Draw drops as streaks: as long as they fall while the shutter is open, as bright as the sky.

    They lie between camera and scene, 0.6 to 12 m away; the number grows as rate ** 0.63, as the
    extinction does. above: (3,) light of the sky.
    """
    height, width = q.shape
    count = int(DROPS * rate_mm_h**0.63 * (width / focal) * (height / focal) * 3.0)
    state = key | np.uint64(1)
    for _ in range(count):
        state = _next(state)
        x = width * _share(state)
        state = _next(state)
        y = height * (1.2 * _share(state) - 0.1)
        state = _next(state)
        depth = 0.6 + 11.4 * np.sqrt(_share(state))
        length = max(2.0, focal * FALL_M_S * exposure_s / depth)
        wide = focal * DROP_M / depth
        cover = min(0.5, 0.3 * wide)
        for n in range(int(length) + 1):
            r, c = int(y + n), int(x - 0.06 * n)
            if 0 <= r < height and 0 <= c < width and q[r, c] * depth < 1.0:
                fade = cover * min(1.0, 2.5 * min(n + 1.0, length - n) / length)
                for k in range(3):
                    light[r, c, k] += max(0.0, fade) * (1.15 * above[k] - light[r, c, k])


@compiled(forceinline=True, borrowing=True)
def _next(state: np.uint64) -> np.uint64:
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    state ^= state << np.uint64(17)
    return state


@compiled(forceinline=True, borrowing=True)
def _share(state: np.uint64) -> float:
    value: float = np.float64(state >> np.uint64(11)) * 2.0**-53
    return value
