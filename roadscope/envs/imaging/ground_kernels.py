"""The ground as a picture seen from above, in three degrees of detail around the camera.

Each degree is a square of cells that slides with the camera: a cell's place in the array is its
number in the world modulo the side, so that only what comes into the square is painted anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

SIDE = 1024
"""Cells along a side of a square."""
TILE = 128
"""Cells along a side of what is painted at once."""
TILES = SIDE // TILE
CELLS_M = (0.0625, 0.25, 1.0)
"""Edge of a cell by degree of detail."""
LINE_M, DASH_M, GAP_M = 0.14, 4.0, 6.0
"""Width of lines, length of dashes and of the gaps between them."""
KERB_M = 0.16
_FAR = -1e9


class Paving(NamedTuple):
    """How the ground looks, linear RGB (3,) each; `shoulder_m` wide strips beside the lanes."""

    asphalt: np.ndarray
    shoulder: np.ndarray
    soil: np.ndarray
    paint: np.ndarray
    kerb: np.ndarray
    shoulder_m: float
    paved: bool


@compiled()
def paint_tile(
    strips: np.ndarray,
    lines: np.ndarray,
    paving: Paving,
    cell_m: float,
    tile: tuple[int, int],
    cells: np.ndarray,
) -> None:
    """Paint one tile, in place: square roots of colours times 255 in the array (SIDE, SIDE, 3)."""
    x0, y0 = tile[0] * TILE * cell_m, tile[1] * TILE * cell_m
    reach = TILE * cell_m
    depth = np.full((TILE, TILE), _FAR)
    cover = np.zeros((TILE, TILE))
    margin = paving.shoulder_m + 1.0
    for n in range(len(strips)):
        _deepen(strips[n], x0, y0, reach, margin, cell_m, depth)
    for n in range(len(lines)):
        _draw_line(lines[n], x0, y0, reach, cell_m, cover)
    for i in range(TILE):
        for j in range(TILE):
            row = (tile[1] * TILE + i) % SIDE
            column = (tile[0] * TILE + j) % SIDE
            x, y = x0 + (j + 0.5) * cell_m, y0 + (i + 0.5) * cell_m
            _paint_cell(paving, cell_m, x, y, depth[i, j], cover[i, j], cells[row, column])


@compiled()
def _deepen(
    strip: np.ndarray,
    x0: float,
    y0: float,
    reach: float,
    margin: float,
    cell_m: float,
    depth: np.ndarray,
) -> None:
    """Raise the map of depths, metres inside the road, to that of one strip with round ends."""
    dx, dy = strip[2] - strip[0], strip[3] - strip[1]
    length = np.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return
    dx, dy, wide = dx / length, dy / length, strip[4] + margin
    left, right = min(strip[0], strip[2]) - wide - x0, max(strip[0], strip[2]) + wide - x0
    low, high = min(strip[1], strip[3]) - wide - y0, max(strip[1], strip[3]) + wide - y0
    if left > reach or right < 0.0 or low > reach or high < 0.0:
        return
    first_j, last_j = max(0, int(left / cell_m)), min(TILE, int(right / cell_m) + 1)
    first_i, last_i = max(0, int(low / cell_m)), min(TILE, int(high / cell_m) + 1)
    for i in range(first_i, last_i):
        y = y0 + (i + 0.5) * cell_m - strip[1]
        for j in range(first_j, last_j):
            x = x0 + (j + 0.5) * cell_m - strip[0]
            along, across = x * dx + y * dy, y * dx - x * dy
            beyond = max(0.0, max(-along, along - length))
            away = abs(across) if beyond == 0.0 else np.sqrt(across * across + beyond * beyond)
            depth[i, j] = max(depth[i, j], strip[4] - away)


@compiled()
def _draw_line(
    line: np.ndarray, x0: float, y0: float, reach: float, cell_m: float, cover: np.ndarray
) -> None:
    """Add the share of every cell that one piece of a line covers."""
    dx, dy = line[2] - line[0], line[3] - line[1]
    length = np.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return
    dx, dy, wide = dx / length, dy / length, LINE_M + cell_m
    left, right = min(line[0], line[2]) - wide - x0, max(line[0], line[2]) + wide - x0
    low, high = min(line[1], line[3]) - wide - y0, max(line[1], line[3]) + wide - y0
    if left > reach or right < 0.0 or low > reach or high < 0.0:
        return
    for i in range(max(0, int(low / cell_m)), min(TILE, int(high / cell_m) + 1)):
        y = y0 + (i + 0.5) * cell_m - line[1]
        for j in range(max(0, int(left / cell_m)), min(TILE, int(right / cell_m) + 1)):
            x = x0 + (j + 0.5) * cell_m - line[0]
            along, across = x * dx + y * dy, y * dx - x * dy
            if along < 0.0 or along > length:
                continue
            if line[5] > 0.0 and (line[4] + along) % (DASH_M + GAP_M) > DASH_M:
                continue
            share = (0.5 * (LINE_M + cell_m) - abs(across)) / cell_m
            cover[i, j] = max(cover[i, j], min(min(1.0, LINE_M / cell_m), max(0.0, share)))


@compiled()
def _paint_cell(
    paving: Paving, cell_m: float, x: float, y: float, depth: float, line: float, cell: np.ndarray
) -> None:
    on_road = min(1.0, max(0.0, 0.5 + depth / cell_m))
    beside = min(1.0, max(0.0, 0.5 + (depth + paving.shoulder_m) / cell_m)) - on_road
    kerb = 0.0
    if paving.paved and depth < 0.0:
        kerb = min(1.0, max(0.0, 0.5 + (depth + KERB_M) / cell_m)) - on_road
    fine = 0.75 + 0.5 * grain(x / 0.07, y / 0.07)
    patch = 0.85 + 0.3 * smooth_grain(x / 2.7, y / 2.7)
    clumps = 0.55 + 0.9 * smooth_grain(x / 0.35, y / 0.35)
    worn = 0.75 + 0.25 * smooth_grain(x / 0.5, y / 0.5)
    joint = 1.0
    if paving.paved and cell_m < 0.1:
        joint = 0.75 if min((x / 0.5) % 1.0, (y / 0.5) % 1.0) < 0.09 else 1.0
    for k in range(3):
        road = paving.asphalt[k] * fine * patch
        road += line * worn * (paving.paint[k] - road)
        strip = paving.shoulder[k] * (0.5 + 0.5 * fine) * patch * joint
        strip += max(0.0, kerb) * (paving.kerb[k] - strip)
        strip += (line * worn * (paving.paint[k] - strip)) if not paving.paved else 0.0
        soil = paving.soil[k] * patch * clumps * (0.6 + 0.4 * fine)
        value = on_road * road + beside * strip + (1.0 - on_road - beside) * soil
        cell[k] = np.uint8(min(255.0, 255.0 * np.sqrt(max(0.0, value)) + 0.5))


@compiled(forceinline=True, borrowing=True)
def grain(x: float, y: float) -> float:
    """Draw a number in 0 to 1 that belongs to a unit cell of the plane."""
    state = np.uint64(np.int64(np.floor(x))) * np.uint64(0x9E3779B97F4A7C15)
    state ^= np.uint64(np.int64(np.floor(y))) * np.uint64(0xC2B2AE3D27D4EB4F)
    state ^= state >> np.uint64(29)
    state *= np.uint64(0xBF58476D1CE4E5B9)
    state ^= state >> np.uint64(32)
    uniform: float = np.float64(state >> np.uint64(11)) * 2.0**-53
    return uniform


@compiled(forceinline=True, borrowing=True)
def smooth_grain(x: float, y: float) -> float:
    """Blend the draws of neighbouring cells into a continuous field in 0 to 1."""
    i, j = np.floor(x), np.floor(y)
    u, v = x - i, y - j
    u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
    low = grain(i, j) + u * (grain(i + 1.0, j) - grain(i, j))
    high = grain(i, j + 1.0) + u * (grain(i + 1.0, j + 1.0) - grain(i, j + 1.0))
    blended: float = low + v * (high - low)
    return blended
