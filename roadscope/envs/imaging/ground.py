"""The ground of an image: its surfaces and their colours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.lighting import Air, ShadingTables, own_beam, pools_at, transmitted
from roadscope.envs.imaging.noise import NOISE_SIDE, blend_of, cell_of, grain, noise_tile
from roadscope.envs.imaging.pinhole import Pinhole
from roadscope.envs.imaging.raster import Lens, Point
from roadscope.envs.world.ground import PAVED, SHOULDERS_M, Surface

# --------------------------------------------------------------------------------------------------
# The ground as a picture from above, in three levels of detail around the camera.

SIDE = 1024
"""Cells along a side of a square."""
PADDING = 16
"""Unused cells after each row, so that a column of cells does not share one cache set."""
TILE = 128
"""Cells along a side of a tile; tiles are painted one by one."""
TILES = SIDE // TILE
CELLS_M = (0.0625, 0.25, 1.0)
"""Edge of a cell by level of detail."""
MOST_CELLS = 1.6
"""A level is used where the footprint of a pixel is shorter than this many of its cells."""
LINE_M, DASH_M, GAP_M = 0.14, 4.0, 6.0
"""Width of lines, length of dashes and of the gaps between them."""
KERB_M = 0.16
SLAB_M = 0.48
"""Edge of the slabs of a pavement."""
_FAR = -1e9


class Paving(NamedTuple):
    """Colours of the ground, linear RGB (3,) each; `shoulder_m`: width of its edges."""

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
    tile_column: int,
    tile_row: int,
    cells: np.ndarray,
) -> None:
    """Paint one tile of cells (SIDE, SIDE + PADDING) uint32 in place.

    A cell holds red, green and blue from its lowest byte up: square roots of colours times 255.
    """
    x0, y0 = tile_column * TILE * cell_m, tile_row * TILE * cell_m
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
            row = (tile_row * TILE + i) % SIDE
            column = (tile_column * TILE + j) % SIDE
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
    """Raise the depths inside the road, metres, by one strip with round ends, in place."""
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
    """Add the share of every cell that one piece of a line covers, in place."""
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
                along_pattern = (line[4] + along + 0.5 * GAP_M) % (DASH_M + GAP_M)
                inside = 0.5 * DASH_M - abs(along_pattern - 0.5 * (DASH_M + GAP_M))
                share *= min(1.0, max(0.0, 0.5 + inside / cell_m))
            cover[i, j] = max(cover[i, j], share)


@compiled(borrowing=True)
def _cell(
    paving: Paving, noise: np.ndarray, cell_m: float, x: float, y: float, depth: float, line: float
) -> np.uint32:
    """Return the packed colour of one cell; details finer than the cell count with their mean."""
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
    # Only the parts that this cell shows are computed.
    if cell_m < 0.1 and wild < 1.0:
        fine = 0.86 + 0.28 * grain(x * 16.0, y * 16.0)
        slab = _slab(x, y) if beside > 0.0 else slab
    if cell_m < 0.1 and line > 0.0:
        worn = 0.72 + 0.36 * cell_of(noise, x * 31.0, y * 31.0)
    if on_road > 0.0:
        # Tyres darken the middle of both halves of a lane: a slow wave over the depth.
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
    """Return the brightness of a pavement slab; every other row is shifted by half a slab."""
    row = np.floor(y / SLAB_M)
    along = x / SLAB_M + 0.5 * (row % 2.0)
    tone = 0.88 + 0.16 * grain(along + 17.0, row)
    edge = min(along - np.floor(along), y / SLAB_M - row) * SLAB_M
    tone *= 0.86 if edge < 0.035 else 1.0
    return tone


# --------------------------------------------------------------------------------------------------
# Light from the ground, some dozens of pixels of a row at once.

CHUNK = 64
"""Pixels of ground along a row that share a level of detail."""
SPECKS = 170.0
"""Cells of noise for each metre of ground near the camera."""
DETAIL_M = 14.0
"""Nearer than this the grain of the ground is visible."""
LAMP_STEP = 8
"""Pixels along a row between which the light of lamps is interpolated."""
OUTER, MIDDLE, ALL = 0xFF00FF, 0x00FF00, 0xFF00FF00FF
"""Red and blue, green of a packed colour, and all three a byte apart."""


@compiled(forceinline=True, borrowing=True)
def _level(lens: Lens, tables: ShadingTables, base: Point, x: float, y: float, depth: float) -> int:
    """Return the level of detail for a pixel's footprint on the ground; 3 outside all squares."""
    footprint = depth / lens.focal[0] * np.sqrt(max(1.0, 0.5 * depth / max(0.3, lens.origin[2])))
    level = 0
    while level < len(CELLS_M):
        half = (SIDE // 2 - 2) * CELLS_M[level]
        away_x = abs(base.x + x - tables.middles[level, 0])
        inside = away_x < half and abs(base.y + y - tables.middles[level, 1]) < half
        fine = footprint < MOST_CELLS * CELLS_M[level] or level == len(CELLS_M) - 1
        if inside and fine:
            break
        level += 1
    return level


def _deepest_m(lens: Lens, level: int) -> float:
    """Return the greatest depth at which `_level` chooses a level."""
    if level == len(CELLS_M) - 1:
        return np.inf
    size, double_height = MOST_CELLS * CELLS_M[level] * lens.focal[0], 2 * max(0.3, lens.origin[2])
    return float(size if size <= double_height else np.cbrt(size * size * double_height))


@compiled(forceinline=True, borrowing=True)
def ground_run(
    lens: Lens,
    q: np.ndarray,
    row: int,
    start: int,
    end: int,
    tables: ShadingTables,
    air: Air,
    workspace: np.ndarray,
    light: np.ndarray,
) -> None:
    """Shade up to `CHUNK` pixels of ground; workspace (11, CHUNK) float32.

    Its rows hold x, y, depth, red, green, blue, the three colours of the ground itself, and the
    light of street lamps and of headlights.
    """
    dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
    base = _ground_points(lens, q, dv, start, end, workspace)
    level = max(
        _level(lens, tables, base, workspace[0, 0], workspace[1, 0], workspace[2, 0]),
        _level(
            lens,
            tables,
            base,
            workspace[0, end - start - 1],
            workspace[1, end - start - 1],
            workspace[2, end - start - 1],
        ),
    )
    _ground_cells(tables, level, base, workspace, end - start)
    _ground_light(tables, air, row, start, end - start, workspace)
    if air.lamps:
        _ground_lamps(lens, tables, base, row, start, end - start, workspace)
    if air.wet > 0.0:
        _ground_water(lens, tables, air, base, end - start, workspace)
    if air.extinction * max(workspace[2, 0], workspace[2, end - start - 1]) > 0.004:
        _ground_air(lens, tables, air, dv, start, end, workspace)
    for c in range(start, end):
        n = c - start
        light[c, 0], light[c, 1], light[c, 2] = workspace[3, n], workspace[4, n], workspace[5, n]


@compiled(forceinline=True, borrowing=True)
def _ground_points(
    lens: Lens, q: np.ndarray, dv: float, start: int, end: int, workspace: np.ndarray
) -> Point:
    """Write x and y, relative to the returned whole metres before the camera, and depth."""
    r = lens.rotation
    x0, y0 = r[1, 0] * dv + r[2, 0], r[1, 1] * dv + r[2, 1]
    ax, ay = r[0, 0] / lens.focal[0], r[0, 1] / lens.focal[0]
    base_x, base_y = np.floor(lens.origin[0]), np.floor(lens.origin[1])
    ox, oy = lens.origin[0] - base_x, lens.origin[1] - base_y
    u0 = start + 0.5 - lens.centre[0]
    for n in range(end - start):
        depth = 1.0 / q[start + n]
        workspace[0, n] = ox + depth * (x0 + ax * (u0 + n))
        workspace[1, n] = oy + depth * (y0 + ay * (u0 + n))
        workspace[2, n] = depth
    return Point(base_x, base_y)


@compiled(forceinline=True, borrowing=True)
def _ground_cells(
    tables: ShadingTables, level: int, base: Point, workspace: np.ndarray, count: int
) -> None:
    """Write the colours of the ground, interpolated between cells; near pixels with grain."""
    if level >= len(CELLS_M):
        for n in range(count):
            workspace[3, n], workspace[4, n], workspace[5, n] = 0.048, 0.064, 0.025
        return
    scale = np.float32(1.0 / CELLS_M[level])
    cells = tables.cells[level]
    # Whole cells and fractions are kept apart, so that 32 bits are enough.
    whole_x, whole_y = np.floor(base.x / CELLS_M[level]), np.floor(base.y / CELLS_M[level])
    bx = np.float32(base.x / CELLS_M[level] - whole_x - 0.5)
    by = np.float32(base.y / CELLS_M[level] - whole_y - 0.5)
    first_row, first_column = np.int64(whole_y), np.int64(whole_x)
    for n in range(count):
        fx, fy = bx + scale * workspace[0, n], by + scale * workspace[1, n]
        i, j = np.floor(fy), np.floor(fx)
        u, v = np.int64(np.float32(256.0) * (fx - j)), np.int64(np.float32(256.0) * (fy - i))
        row = (np.int64(i) + first_row) & (SIDE - 1)
        column = (np.int64(j) + first_column) & (SIDE - 1)
        below, right = (row + 1) & (SIDE - 1), (column + 1) & (SIDE - 1)
        a, b = np.int64(cells[row, column]), np.int64(cells[row, right])
        c, d = np.int64(cells[below, column]), np.int64(cells[below, right])
        # Red and blue at once, two bytes apart, and green beyond them: 64 bits hold all three.
        a = (a & OUTER) | ((a & MIDDLE) << 24)
        b = (b & OUTER) | ((b & MIDDLE) << 24)
        c = (c & OUTER) | ((c & MIDDLE) << 24)
        d = (d & OUTER) | ((d & MIDDLE) << 24)
        high = ((a * (256 - u) + b * u) >> 8) & ALL
        low = ((c * (256 - u) + d * u) >> 8) & ALL
        mixed = (high * (256 - v) + low * v) >> 8
        workspace[3, n], workspace[4, n] = mixed & 255, (mixed >> 32) & 255
        workspace[5, n] = (mixed >> 16) & 255
    if workspace[2, 0] < DETAIL_M:
        # A tile of noise is 256 specks wide; so far from the origin no digits are lost.
        fine_x = np.float32(SPECKS * (base.x % 256.0) % NOISE_SIDE)
        fine_y = np.float32(SPECKS * (base.y % 256.0) % NOISE_SIDE)
        specks = np.float32(SPECKS)
        for n in range(count):
            speck = cell_of(
                tables.noise, fine_x + specks * workspace[0, n], fine_y + specks * workspace[1, n]
            )
            near = np.float32(max(0.0, 1.0 - workspace[2, n] / DETAIL_M))
            grain = (
                np.float32(1.0) + np.float32(0.45) * (np.float32(speck) - np.float32(0.5)) * near
            )
            workspace[3, n], workspace[4, n] = workspace[3, n] * grain, workspace[4, n] * grain
            workspace[5, n] *= grain


@compiled(forceinline=True, borrowing=True)
def _ground_light(
    tables: ShadingTables, air: Air, row: int, start: int, count: int, workspace: np.ndarray
) -> None:
    """Square the roots and multiply them with the light of sun and sky."""
    for k in range(3):
        # Bytes of roots are squared, so 255 appears twice, and once more with the shares.
        sun = np.float32(air.towards[2] * air.sun[k] / 255.0**3)
        sky = np.float32(air.sky[k] / 255.0**3)
        for n in range(count):
            shine = sun * np.float32(tables.lit[row, start + n])
            shine += sky * np.float32(tables.open_sky[row, start + n])
            workspace[6 + k, n] = workspace[3 + k, n] * workspace[3 + k, n]
            workspace[3 + k, n] = workspace[6 + k, n] * shine


@compiled(borrowing=True)
def _ground_lamps(
    lens: Lens,
    tables: ShadingTables,
    base: Point,
    row: int,
    start: int,
    count: int,
    workspace: np.ndarray,
) -> None:
    """Add the light of lamps: exact every `LAMP_STEP` pixels, linear between them."""
    ahead = _lamps_at(lens, tables, base, workspace, 0)
    for first in range(0, count, LAMP_STEP):
        last = min(count - 1, first + LAMP_STEP)
        here, ahead = ahead, _lamps_at(lens, tables, base, workspace, last)
        _evenly(workspace[9], first, last, here[0], ahead[0])
        _evenly(workspace[10], first, last, here[1], ahead[1])
    for n in range(count):
        warm = (
            workspace[9, n] * np.float32(tables.open_sky[row, start + n]) * np.float32(1.0 / 255.0)
        )
        white = workspace[10, n]
        workspace[3, n] += workspace[6, n] * (warm + white)
        workspace[4, n] += workspace[7, n] * (np.float32(0.72) * warm + np.float32(0.95) * white)
        workspace[5, n] += workspace[8, n] * (np.float32(0.42) * warm + np.float32(0.85) * white)


@compiled(forceinline=True, borrowing=True)
def _evenly(line: np.ndarray, first: int, last: int, here: np.float32, there: np.float32) -> None:
    """Write linear values from one pixel to another, both ends included."""
    step = np.float32(1.0 / max(1, last - first)) * (there - here)
    for n in range(first, last + 1):
        line[n] = here + np.float32(n - first) * step


@compiled(forceinline=True, borrowing=True)
def _lamps_at(
    lens: Lens, tables: ShadingTables, base: Point, workspace: np.ndarray, n: int
) -> tuple[np.float32, np.float32]:
    """Return the light of street lamps and of headlights on one pixel of ground, over 255^2."""
    x, y = base.x + workspace[0, n], base.y + workspace[1, n]
    warm, white = pools_at(tables.pools, tables.origin, x, y)
    white += own_beam(lens, x, y, 0.0, False)
    return np.float32(warm / 255.0**2), np.float32(white / 255.0**2)


@compiled(borrowing=True)
def _ground_water(
    lens: Lens, tables: ShadingTables, air: Air, base: Point, count: int, workspace: np.ndarray
) -> None:
    """Darken wet ground, and let it mirror the sky."""
    for n in range(count):
        share = _mirrored(
            lens, tables, air, base.x + workspace[0, n], base.y + workspace[1, n], workspace[2, n]
        )
        # Water does not stand on grass.
        share *= 0.15 if workspace[7, n] > 1.15 * workspace[6, n] else 1.0
        dark = 1.0 - 0.4 * air.wet - share
        for k in range(3):
            workspace[3 + k, n] = dark * workspace[3 + k, n] + share * air.horizon[k]


@compiled(forceinline=True, borrowing=True)
def _ground_air(
    lens: Lens,
    tables: ShadingTables,
    air: Air,
    dv: float,
    start: int,
    end: int,
    workspace: np.ndarray,
) -> None:
    """Apply extinction and airlight: exact at both ends, linear between them."""
    ends = (start, end - 1)
    shares = (1.0, 1.0)
    for i in range(2):
        du = (ends[i] + 0.5 - lens.centre[0]) / lens.focal[0]
        reach = workspace[2, ends[i] - start] * np.sqrt(1.0 + du * du + dv * dv)
        share = transmitted(tables.transmittances, air.extinction * reach)
        shares = (share, share) if i == 0 else (shares[0], share)
    step = np.float32((shares[1] - shares[0]) / max(1, end - 1 - start))
    first = np.float32(shares[0])
    for k in range(3):
        veil = np.float32(air.veil[k])
        for n in range(end - start):
            passed = first + np.float32(n) * step
            workspace[3 + k, n] = veil + passed * (workspace[3 + k, n] - veil)


@compiled(forceinline=True, borrowing=True)
def _mirrored(
    lens: Lens, tables: ShadingTables, air: Air, x: float, y: float, depth: float
) -> float:
    """Return the share of light that wet ground mirrors: Schlick's law, more in puddles."""
    down = lens.origin[2] / np.sqrt(depth * depth + lens.origin[2] * lens.origin[2])
    graze = 1.0 - min(1.0, down)
    square = graze * graze
    puddle = min(1.0, max(0.0, 3.5 * (blend_of(tables.noise, 6.0 * x, 6.0 * y) - 0.42)))
    share: float = air.wet * (0.5 + 0.5 * puddle) * (0.02 + 0.6 * square * square * graze)
    return share


@compiled(forceinline=True, borrowing=True)
def plain_ground(
    lens: Lens,
    q: np.ndarray,
    x0: float,
    y0: float,
    ax: float,
    ay: float,
    start: int,
    end: int,
    tables: ShadingTables,
    pixels: np.ndarray,
) -> None:
    """Copy the bytes of the nearest cells into pixels (W, 3) uint8."""
    level = 0
    for c in (start, end - 1):
        du, depth = c + 0.5 - lens.centre[0], 1.0 / q[c]
        x, y = lens.origin[0] + depth * (x0 + ax * du), lens.origin[1] + depth * (y0 + ay * du)
        level = max(level, _level(lens, tables, Point(0.0, 0.0), x, y, depth))
    if level >= len(CELLS_M):
        for c in range(start, end):
            pixels[c, 0], pixels[c, 1], pixels[c, 2] = 57, 65, 44
        return
    scale = 1.0 / CELLS_M[level]
    for c in range(start, end):
        du, depth = c + 0.5 - lens.centre[0], scale / q[c]
        column = np.int64(np.floor(lens.origin[0] * scale + depth * (x0 + ax * du)))
        row = np.int64(np.floor(lens.origin[1] * scale + depth * (y0 + ay * du)))
        cell = np.int64(tables.cells[level, row & (SIDE - 1), column & (SIDE - 1)])
        pixels[c, 0], pixels[c, 1] = cell & 255, (cell >> 8) & 255
        pixels[c, 2] = cell >> 16


# --------------------------------------------------------------------------------------------------
# The painted ground around a camera; tiles are kept from frame to frame.

ASPHALT = (0.078, 0.079, 0.082)
CONCRETE = (0.24, 0.23, 0.215)
GRASS = (0.060, 0.082, 0.028)
PAINT = (0.62, 0.62, 0.60)
KERB = (0.36, 0.35, 0.33)
TILE_MARGIN = 2
"""A pixel reads cells up to this many beyond its own: a tile counts as that much larger."""
_STEPS = np.arange(-TILES // 2, TILES // 2)
_TILES = np.stack(np.meshgrid(_STEPS, _STEPS, indexing="ij"), axis=-1).reshape(-1, 2)
"""Columns and rows of all tiles of a square from its middle on."""
AHEAD = 0.3
"""The middles of the squares lie this share of a side ahead of the camera."""


def _half_angle(lens: Lens, ahead: np.ndarray, pinhole: Pinhole) -> float:
    """Return the largest horizontal angle between a ray and the view's direction, radians.

    It is pi if a corner of the image looks to the side or back.
    """
    u, v = np.meshgrid((0.0, pinhole.width), (0.0, pinhole.height))
    x, y = (u - lens.centre[0]) / lens.focal[0], (v - lens.centre[1]) / lens.focal[1]
    rays = np.stack([x.ravel(), y.ravel(), np.ones(4)], axis=-1) @ lens.rotation
    along, across = rays[:, :2] @ ahead, np.abs(rays[:, :2] @ (-ahead[1], ahead[0]))
    return np.pi if along.min() <= 1e-3 else float(np.arctan2(across, along).max())


class Ground:
    """Three squares of cells, from fine near the camera to coarse far away."""

    def __init__(self, surface: Surface, style: str) -> None:
        """Prepare the colours of a roadside style; no tile is painted yet."""
        paved = style in PAVED
        self.paving = Paving(
            np.array(ASPHALT),
            np.array(CONCRETE if paved else ASPHALT),
            np.array(GRASS),
            np.array(PAINT),
            np.array(KERB),
            SHOULDERS_M.get(style, 0.5),
            paved,
        )
        self.surface = surface
        self.cells = np.zeros((len(CELLS_M), SIDE, SIDE + PADDING), np.uint32)
        self.middles = np.zeros((len(CELLS_M), 2))
        self._painted: list[dict[tuple[int, int], tuple[int, int]]] = [{} for _ in CELLS_M]

    def seen_by(self, lens: Lens, pinhole: Pinhole) -> np.ndarray:
        """Return (3, SIDE, SIDE + PADDING) uint32 cells around a camera, most of them ahead.

        Only tiles that the image may show are painted. pinhole: of the lens. `middles` (3, 2) then
        holds the middles of the squares, metres.
        """
        forward = lens.rotation[2, :2]
        horizontal_length = max(float(np.linalg.norm(forward)), 1e-9)
        ahead = forward / horizontal_length
        half_angle = _half_angle(lens, ahead, pinhole)
        for level, cell_m in enumerate(CELLS_M):
            aim = lens.origin[:2] + AHEAD * SIDE * cell_m * ahead
            middle = np.rint(aim / (TILE * cell_m)).astype(int)
            self.middles[level] = middle * TILE * cell_m
            tiles = middle + _TILES
            reach = (TILE / np.sqrt(2.0) + TILE_MARGIN) * cell_m
            arms = (tiles + 0.5) * TILE * cell_m - lens.origin[:2]
            along = arms @ ahead
            across = np.abs(arms @ (-ahead[1], ahead[0]))
            visible = across * np.cos(half_angle) - along * np.sin(half_angle) <= reach
            visible |= half_angle >= np.pi / 2
            depths = (along - reach) * horizontal_length - lens.origin[2] * lens.rotation[2, 2]
            visible &= depths <= 1.001 * _deepest_m(lens, level)  # kernels round to 32 bits
            for column, row in tiles[visible].tolist():
                self._paint(level, column, row)
        return self.cells

    def _paint(self, level: int, column: int, row: int) -> None:
        """Paint a tile of cells unless it is there already."""
        slot = (column % TILES, row % TILES)
        if self._painted[level].get(slot) != (column, row):
            paint_tile(
                self.surface.strips,
                self.surface.lines,
                self.paving,
                noise_tile(),
                CELLS_M[level],
                column,
                row,
                self.cells[level],
            )
            self._painted[level][slot] = (column, row)
