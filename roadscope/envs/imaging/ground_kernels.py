"""The ground as a picture seen from above, in three degrees of detail around the camera.

Each degree is a square of cells that slides with the camera: a cell's place in the array is its
number in the world modulo the side, so that only what comes into the square is painted anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.noise_kernels import blend_of, cell_of, grain

SIDE = 1024
"""Cells along a side of a square."""
PADDING = 16
"""Cells after each row, so that a column of cells does not fall on one set of the cache."""
TILE = 128
"""Cells along a side of what is painted at once."""
TILES = SIDE // TILE
CELLS_M = (0.0625, 0.25, 1.0)
"""Edge of a cell by degree of detail."""
LINE_M, DASH_M, GAP_M = 0.14, 4.0, 6.0
"""Width of lines, length of dashes and of the gaps between them."""
KERB_M = 0.16
SLAB_M = 0.48
"""Edge of the slabs of a pavement."""
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
    noise: np.ndarray,
    cell_m: float,
    tile: tuple[int, int],
    cells: np.ndarray,
) -> None:
    """Paint one tile of cells (SIDE, SIDE + PADDING) uint32 in place.

    A cell holds red, green and blue from its lowest byte up: square roots of colours times 255.
    """
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
            cells[row, column] = _cell(paving, noise, cell_m, x, y, depth[i, j], cover[i, j])


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
            if along < -0.25 * cell_m or along > length + 0.25 * cell_m:
                continue
            share = (0.5 * (LINE_M + cell_m) - abs(across)) / cell_m
            share = min(min(1.0, LINE_M / cell_m), max(0.0, share))
            if line[5] > 0.0:
                # The share of the cell along the line that lies on a dash, from its middle.
                way = (line[4] + along + 0.5 * GAP_M) % (DASH_M + GAP_M)
                inside = 0.5 * DASH_M - abs(way - 0.5 * (DASH_M + GAP_M))
                share *= min(1.0, max(0.0, 0.5 + inside / cell_m))
            cover[i, j] = max(cover[i, j], share)


@compiled(borrowing=True)
def _cell(
    paving: Paving,
    noise: np.ndarray,
    cell_m: float,
    x: float,
    y: float,
    depth: float,
    line: float,
) -> np.uint32:
    """Mix what lies in one cell; what is finer than the cell counts with its mean."""
    on_road = min(1.0, max(0.0, 0.5 + depth / cell_m))
    beside = min(1.0, max(0.0, 0.5 + (depth + paving.shoulder_m) / cell_m)) - on_road
    wild = 1.0 - on_road - beside
    kerb = 0.0
    if paving.paved and depth < 0.0:
        kerb = max(0.0, min(1.0, max(0.0, 0.5 + (depth + KERB_M) / cell_m)) - on_road)
    patch = 0.88 + 0.24 * blend_of(noise, x * 4.1, y * 4.1)
    broad = 0.8 + 0.4 * blend_of(noise, x * 0.9 + 31.0, y * 0.9)
    fine, clumps, slab, worn, tracks = 1.0, 1.0, 0.94, 0.9, 1.0
    if cell_m < 0.5:
        clumps = 0.6 + 0.8 * cell_of(noise, x * 23.0, y * 23.0)
    # What does not show, as most of a road on most cells, is not looked up.
    if cell_m < 0.1 and wild < 1.0:
        fine = 0.86 + 0.28 * grain(x * 16.0, y * 16.0)
        slab = _slab(x, y) if beside > 0.0 else slab
    if cell_m < 0.1 and line > 0.0:
        worn = 0.72 + 0.36 * cell_of(noise, x * 31.0, y * 31.0)
    if on_road > 0.0:
        # Tyres darken the middle of the lane's halves: a slow wave of the depth into the road.
        tracks = 0.94 + 0.06 * np.cos(3.6 * depth)
    packed = np.int64(0)
    for k in range(3):
        road = paving.asphalt[k] * fine * patch * tracks
        strip = paving.shoulder[k] * (0.7 + 0.3 * fine) * (0.5 + 0.5 * patch)
        strip *= slab if paving.paved else 0.93
        strip += kerb * (paving.kerb[k] - strip)
        soil = paving.soil[k] * broad * clumps * (0.8 + 0.2 * patch)
        value = on_road * road + beside * strip + wild * soil
        value += line * worn * (paving.paint[k] - value)
        root = np.int64(min(255.0, 255.0 * np.sqrt(max(0.0, value)) + 0.5))
        packed |= root << (8 * k)
    return np.uint32(packed)


@compiled(forceinline=True, borrowing=True)
def _slab(x: float, y: float) -> float:
    """Brightness of the slabs of a pavement, each its own, every other row half a slab along."""
    row = np.floor(y / SLAB_M)
    along = x / SLAB_M + 0.5 * (row % 2.0)
    tone = 0.88 + 0.16 * grain(along + 17.0, row)
    edge = min(along - np.floor(along), y / SLAB_M - row) * SLAB_M
    tone *= 0.86 if edge < 0.035 else 1.0
    return tone
