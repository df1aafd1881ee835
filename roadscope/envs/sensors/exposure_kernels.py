"""What lens and sensor make of the light: soft edges, motion blur, glare, vignetting, noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.lighting import BLOCK

MOST_TAPS = 9
"""Most samples along the way of a pixel during the exposure."""
FOCAL_BLUR = 0.2
"""Share of the light of an edge that the lens throws on each neighbour, against the pixel's 1."""
LEAST_PX = 0.8
"""Shorter ways than this are not blurred."""
STRETCH = 32
"""Most pixels along a row that share one way."""
CODE = (
    np.float32(-0.0422323),
    np.float32(1.5752777),
    np.float32(-1.8995242),
    np.float32(3.8985967),
    np.float32(-5.0034247),
    np.float32(3.4188949),
    np.float32(-0.9477371),
)
"""sRGB's curve as a polynomial in the root of the light, 0.04 of a byte from it."""
DRAWS = 1 << 18
"""Normal draws that the noise is read from, row by row at random places."""


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

    shot: variance of the noise per light. read: variance of the noise in the dark. vignetting:
    share lost in the corners. centre: (2,) pixels. key: of the noise. draws: float32, normal.
    """

    shot: float
    read: float
    vignetting: float
    centre: np.ndarray
    key: np.uint64
    draws: np.ndarray


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
    line = np.empty((width, 3), np.float32)
    passed = np.empty((width, 3), np.float32)
    squares = np.empty((width, 3), np.float32)
    for c in range(width):
        squares[c, :] = (c + 0.5 - u) ** 2
    lost = np.float32(sensor.vignetting / corner)
    for r in range(height):
        base = np.float32(1.0 - lost * (r + 0.5 - v) ** 2)
        _pass(squares.reshape(-1), base, lost, passed.reshape(-1))
        line[:] = light[r]
        _soften_edges(light, faces, r, line)
        if shutter.active:
            _smear_row(light, q[r], faces[r], r, shutter, line)
        if len(glare) > 0:
            _dazzle(glare, r, line)
        start = _place(sensor.key, r, len(sensor.draws) - 3 * width)
        _noise(
            line.reshape(-1), passed.reshape(-1), sensor.draws[start : start + 3 * width],
            np.float32(sensor.shot), np.float32(sensor.read), pixels[r].reshape(-1),
        )  # fmt: skip


@compiled(borrowing=True)
def _place(key: np.uint64, row: int, places: int) -> int:
    """Draw where the noise of a row begins."""
    state = key + np.uint64(row + 1) * np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return int((state ^ (state >> np.uint64(31))) >> np.uint64(2)) % places


@compiled(borrowing=True)
def _pass(squares: np.ndarray, base: np.float32, lost: np.float32, passed: np.ndarray) -> None:
    for n in range(len(squares)):
        passed[n] = base - lost * squares[n]


@compiled(borrowing=True)
def _noise(
    line: np.ndarray,
    passed: np.ndarray,
    draws: np.ndarray,
    shot: np.float32,
    read: np.float32,
    pixels: np.ndarray,
) -> None:
    """Add noise to one row of numbers and encode them as sRGB."""
    zero, one = np.float32(0.0), np.float32(1.0)
    c0, c1, c2, c3, c4, c5, c6 = CODE
    for n in range(len(line)):
        value = line[n] * passed[n]
        value = value if value > zero else zero
        value = value if value < one else one
        value += np.sqrt(shot * value + read) * draws[n]
        value = value if value > zero else zero
        value = value if value < one else one
        root = np.sqrt(value)
        code = c4 + root * (c5 + root * c6)
        code = c0 + root * (c1 + root * (c2 + root * (c3 + root * code)))
        code = np.float32(12.92) * value if value < np.float32(0.0031308) else code
        code = code if code < one else one
        pixels[n] = np.uint8(code * np.float32(255.0) + np.float32(0.5))


@compiled(borrowing=True)
def _soften_edges(light: np.ndarray, faces: np.ndarray, r: int, line: np.ndarray) -> None:
    """Let each pixel at the edge of a face take light from its four neighbours."""
    height, width = faces.shape
    above, below = max(0, r - 1), min(height - 1, r + 1)
    scale = np.float32(1.0 / (1.0 + 4.0 * FOCAL_BLUR))
    share = np.float32(FOCAL_BLUR / (1.0 + 4.0 * FOCAL_BLUR))
    for c in range(1, width - 1):
        face = faces[r, c]
        same = (face == faces[r, c - 1]) & (face == faces[r, c + 1])
        if same & (face == faces[above, c]) & (face == faces[below, c]):
            continue
        for k in range(3):
            sides = light[above, c, k] + light[below, c, k]
            sides += light[r, c - 1, k] + light[r, c + 1, k]
            line[c, k] = scale * light[r, c, k] + share * sides


@compiled(forceinline=True, borrowing=True)
def flow_at(shutter: Shutter, q: float, row: int, u: float, v: float) -> tuple[float, float]:
    """Way of a pixel over the image while the shutter is open; u, v: its ray, z = 1."""
    wx, wy, wz = shutter.turn[0], shutter.turn[1], shutter.turn[2]
    x, y, z = shutter.ways[row, 0] * q, shutter.ways[row, 1] * q, shutter.ways[row, 2] * q
    x, y, z = x - (wy - wz * v), y - (wz * u - wx), z - (wx * v - wy * u)
    return shutter.focal[0] * (x - u * z), shutter.focal[1] * (y - v * z)


@compiled(borrowing=True)
def _smear_row(
    light: np.ndarray,
    q: np.ndarray,
    faces: np.ndarray,
    r: int,
    shutter: Shutter,
    line: np.ndarray,
) -> None:
    """Blur one row, by stretches of one face that share one way over the image."""
    width, start = len(q), 0
    v = (r + 0.5 - shutter.centre[1]) / shutter.focal[1]
    while start < width:
        face, end = faces[start], start + 1
        while end < width and end < start + STRETCH and faces[end] == face:
            end += 1
        middle = (start + end) // 2
        u = (middle + 0.5 - shutter.centre[0]) / shutter.focal[0]
        row = shutter.rows[face >> 4] if face >= 0 else len(shutter.ways) - 1
        dx, dy = flow_at(shutter, q[middle], row, u, v)
        most = max(abs(dx), abs(dy))
        if most >= LEAST_PX:
            _smear(light, r, start, end, (dx, dy), min(MOST_TAPS, int(most) + 2), line)
        start = end


@compiled(borrowing=True)
def _smear(
    light: np.ndarray,
    r: int,
    start: int,
    end: int,
    way: tuple[float, float],
    taps: int,
    line: np.ndarray,
) -> None:
    """Average the light of a stretch of pixels along their way."""
    height, width = light.shape[:2]
    weight = np.float32(1.0 / taps)
    for c in range(start, end):
        line[c, 0] = line[c, 1] = line[c, 2] = np.float32(0.0)
    for n in range(taps):
        share = (n + 0.5) / taps - 0.5
        i = min(height - 1, max(0, int(np.floor(r + 0.5 + share * way[1]))))
        shift = int(np.floor(0.5 + share * way[0]))
        shift = min(width - end, max(-start, shift))
        for c in range(start, end):
            line[c, 0] += weight * light[i, c + shift, 0]
            line[c, 1] += weight * light[i, c + shift, 1]
            line[c, 2] += weight * light[i, c + shift, 2]


@compiled(borrowing=True)
def _dazzle(glare: np.ndarray, r: int, line: np.ndarray) -> None:
    """Add the glare to one row, linear between the corners of blocks."""
    i = r // BLOCK
    v = np.float32((r + 0.5 - i * BLOCK) / BLOCK)
    width = len(line)
    half, share = np.float32(0.5), np.float32(1.0 / BLOCK)
    for j in range((width + BLOCK - 1) // BLOCK):
        a, b, c, d = glare[i, j], glare[i, j + 1], glare[i + 1, j], glare[i + 1, j + 1]
        red, green, blue = (
            a[0] + v * (c[0] - a[0]),
            a[1] + v * (c[1] - a[1]),
            a[2] + v * (c[2] - a[2]),
        )
        red_step = (b[0] + v * (d[0] - b[0]) - red) * share
        green_step = (b[1] + v * (d[1] - b[1]) - green) * share
        blue_step = (b[2] + v * (d[2] - b[2]) - blue) * share
        red, green, blue = red + half * red_step, green + half * green_step, blue + half * blue_step
        # The three colours in one loop: none waits for another's sum.
        for n in range(j * BLOCK, min(width, (j + 1) * BLOCK)):
            line[n, 0] += red
            line[n, 1] += green
            line[n, 2] += blue
            red, green, blue = red + red_step, green + green_step, blue + blue_step


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
