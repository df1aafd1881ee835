"""What lens and sensor make of the light: soft edges, motion blur, glare, vignetting, noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.sky_kernels import BLOCK

BELL = 4096
"""Entries of the table of normal draws."""
SPREADS = 1024
"""Steps of the table of standard deviations, by light from 0 to 1."""
MOST_TAPS = 9
"""Most samples along the way of a pixel during the exposure."""
FOCAL_BLUR = 0.2
"""Share of the light of an edge that the lens throws on each neighbour, against the pixel's 1."""
LEAST_PX = 0.8
"""Shorter ways than this are not blurred."""


class Shutter(NamedTuple):
    """How the view moves while the shutter is open.

    active: whether it does. ways: (A + 1, 3), metres, camera frame: way of each actor, and at the
    end of all that stands still, relative to the camera. turn: (3,) radians, camera frame.
    focal, centre: (2,) pixels. rows: (P,) row of `ways` of each prism.
    """

    active: bool
    ways: np.ndarray
    turn: np.ndarray
    focal: np.ndarray
    centre: np.ndarray
    rows: np.ndarray


class Sensor(NamedTuple):
    """How light becomes bytes.

    curve: (4096,) uint8. bell: (4096,) normal draws. spreads: (1025,) standard deviation of the
    noise by light. vignetting: share lost in the corners. centre: (2,) pixels. key: of the noise.
    """

    curve: np.ndarray
    bell: np.ndarray
    spreads: np.ndarray
    vignetting: float
    centre: np.ndarray
    key: np.uint64


@compiled()
def develop(
    light: np.ndarray,
    q: np.ndarray,
    faces: np.ndarray,
    shutter: Shutter,
    glare: np.ndarray,
    sensor: Sensor,
    pixels: np.ndarray,
) -> None:
    """Turn light (H, W, 3) into pixels (H, W, 3) uint8.

    q, faces: of the raster. glare: (H / 8 + 2, W / 8 + 2, 3) light added at the corners of
    blocks, or (0, 0, 3). The noise of a pixel depends on key and place alone.
    """
    height, width = q.shape
    u, v = sensor.centre[0], sensor.centre[1]
    corner = max(u, width - u) ** 2 + max(v, height - v) ** 2
    got = np.empty(3)
    for r in range(height):
        dy = (r + 0.5 - v) ** 2
        above, below = max(0, r - 1), min(height - 1, r + 1)
        for c in range(width):
            face = faces[r, c]
            left, right = max(0, c - 1), min(width - 1, c + 1)
            got[0], got[1], got[2] = light[r, c, 0], light[r, c, 1], light[r, c, 2]
            taps = 0
            if shutter.active:
                taps = _smear(light, q[r, c], face, r, c, shutter, got)
            if taps == 0 and (
                face != faces[r, left] or face != faces[r, right]
                or face != faces[above, c] or face != faces[below, c]
            ):  # fmt: skip
                _soften(light, r, c, (above, below, left, right), got)
            if len(glare) > 0:
                _dazzle(glare, r, c, got)
            dx = c + 0.5 - u
            passed = 1.0 - sensor.vignetting * (dx * dx + dy) / corner
            _expose(sensor, np.uint64(r * width + c), passed, got, pixels[r, c])


@compiled(forceinline=True, borrowing=True)
def _expose(
    sensor: Sensor, number: np.uint64, passed: float, got: np.ndarray, pixel: np.ndarray
) -> None:
    state = sensor.key + number * np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    state ^= state >> np.uint64(31)
    steps = len(sensor.curve) - 1
    for k in range(3):
        value = min(1.0, max(0.0, got[k] * passed))
        draw = np.int64((state >> np.uint64(20 * k)) & np.uint64(BELL - 1))
        value += sensor.spreads[int(value * SPREADS)] * sensor.bell[draw]
        pixel[k] = sensor.curve[int(min(1.0, max(0.0, value)) * steps + 0.5)]


@compiled(borrowing=True)
def _soften(
    light: np.ndarray, r: int, c: int, around: tuple[int, int, int, int], got: np.ndarray
) -> None:
    above, below, left, right = around
    scale = 1.0 / (1.0 + 4.0 * FOCAL_BLUR)
    for k in range(3):
        sides = light[above, c, k] + light[below, c, k] + light[r, left, k] + light[r, right, k]
        got[k] = scale * (got[k] + FOCAL_BLUR * sides)


@compiled(forceinline=True, borrowing=True)
def flow_at(
    shutter: Shutter, q: float, row: int, u: float, v: float
) -> tuple[float, float]:
    """Way of a pixel over the image while the shutter is open; u, v: its ray, z = 1."""
    wx, wy, wz = shutter.turn[0], shutter.turn[1], shutter.turn[2]
    x, y, z = shutter.ways[row, 0] * q, shutter.ways[row, 1] * q, shutter.ways[row, 2] * q
    x, y, z = x - (wy - wz * v), y - (wz * u - wx), z - (wx * v - wy * u)
    return shutter.focal[0] * (x - u * z), shutter.focal[1] * (y - v * z)


@compiled(borrowing=True)
def _smear(
    light: np.ndarray,
    q: float,
    face: int,
    r: int,
    c: int,
    shutter: Shutter,
    got: np.ndarray,
) -> int:
    """Average the light along the pixel's way; return the number of samples, 0 for none."""
    height, width = light.shape[:2]
    u = (c + 0.5 - shutter.centre[0]) / shutter.focal[0]
    v = (r + 0.5 - shutter.centre[1]) / shutter.focal[1]
    row = shutter.rows[face >> 4] if face >= 0 else len(shutter.ways) - 1
    dx, dy = flow_at(shutter, q, row, u, v)
    most = max(abs(dx), abs(dy))
    if most < LEAST_PX:
        return 0
    taps = min(MOST_TAPS, int(most) + 2)
    got[0] = got[1] = got[2] = 0.0
    for n in range(taps):
        share = (n + 0.5) / taps - 0.5
        i = min(height - 1, max(0, int(r + 0.5 + share * dy)))
        j = min(width - 1, max(0, int(c + 0.5 + share * dx)))
        for k in range(3):
            got[k] += light[i, j, k] / taps
    return taps


@compiled(borrowing=True)
def _dazzle(glare: np.ndarray, r: int, c: int, got: np.ndarray) -> None:
    i, j = r // BLOCK, c // BLOCK
    v, u = (r + 0.5 - i * BLOCK) / BLOCK, (c + 0.5 - j * BLOCK) / BLOCK
    for k in range(3):
        high = glare[i, j, k] + u * (glare[i, j + 1, k] - glare[i, j, k])
        low = glare[i + 1, j, k] + u * (glare[i + 1, j + 1, k] - glare[i + 1, j, k])
        got[k] += high + v * (low - high)


@compiled()
def describe(
    q: np.ndarray, faces: np.ndarray, table: np.ndarray, depth: np.ndarray, owners: np.ndarray
) -> None:
    """Fill depth (H, W) float32 and owners (H, W) int32 from the raster.

    table: (P * 16 + 2,) owners of faces; its last two entries are the sky's and the ground's.
    """
    height, width = q.shape
    count = len(table)
    for r in range(height):
        for c in range(width):
            depth[r, c] = np.float32(1.0) / q[r, c] if q[r, c] > 0.0 else np.float32(0.0)
        for c in range(width):
            face = faces[r, c]
            owners[r, c] = table[face if face >= 0 else count + face]


@compiled()
def count_visible(owners: np.ndarray, visible: np.ndarray) -> None:
    """Add up the pixels of each actor."""
    height, width = owners.shape
    for r in range(height):
        for c in range(width):
            if owners[r, c] >= 0:
                visible[owners[r, c]] += 1
