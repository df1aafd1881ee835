"""Light that comes from the ground, some dozens of pixels of a row at once."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.face_kernels import Lens
from roadscope.envs.imaging.ground_kernels import CELLS_M, SIDE
from roadscope.envs.imaging.lamp_kernels import own_beam, pools_at
from roadscope.envs.imaging.noise_kernels import NOISE_SIDE, blend_of, cell_of
from roadscope.envs.imaging.sky_kernels import Air
from roadscope.envs.imaging.stage_kernels import Stage, share_passed

CHUNK = 64
"""Pixels of ground along a row that share a degree of detail."""
SPECKS = 170.0
"""Cells of noise to a metre of ground seen close by."""
DETAIL_M = 14.0
"""Nearer than this the grain of the ground is seen."""
LAMP_STEP = 8
"""Pixels along a row between which the light of lamps changes evenly."""
OUTER, MIDDLE, ALL = 0xFF00FF, 0x00FF00, 0xFF00FF00FF
"""Red and blue, green of a packed colour, and all three a byte apart."""


@compiled(forceinline=True, borrowing=True)
def _level(
    lens: Lens, stage: Stage, base: tuple[float, float], x: float, y: float, depth: float
) -> int:
    """Degree of detail that fits a pixel's footprint on the ground; 3 beyond all squares."""
    footprint = depth / lens.focal[0] * np.sqrt(max(1.0, 0.5 * depth / max(0.3, lens.origin[2])))
    level = 0
    while level < len(CELLS_M):
        half = (SIDE // 2 - 2) * CELLS_M[level]
        away_x = abs(base[0] + x - stage.middles[level, 0])
        inside = away_x < half and abs(base[1] + y - stage.middles[level, 1]) < half
        if inside and (footprint < 1.6 * CELLS_M[level] or level == len(CELLS_M) - 1):
            break
        level += 1
    return level


@compiled(forceinline=True, borrowing=True)
def ground_run(
    lens: Lens,
    q: np.ndarray,
    row: int,
    start: int,
    end: int,
    stage: Stage,
    air: Air,
    bench: np.ndarray,
    light: np.ndarray,
) -> None:
    """Shade up to `CHUNK` pixels of ground; bench (11, CHUNK) float32 is room to work in.

    Its rows hold x, y, depth, red, green, blue, the three colours of the ground itself, and the
    light of street lamps and of headlights.
    """
    dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
    base = _ground_places(lens, q, dv, start, end, bench)
    level = max(
        _level(lens, stage, base, bench[0, 0], bench[1, 0], bench[2, 0]),
        _level(
            lens, stage, base, bench[0, end - start - 1], bench[1, end - start - 1],
            bench[2, end - start - 1],
        ),
    )  # fmt: skip
    _ground_cells(stage, level, base, bench, end - start)
    _ground_light(stage, air, row, start, end - start, bench)
    if air.lamps:
        _ground_lamps(lens, stage, base, row, start, end - start, bench)
    if air.wet > 0.0:
        _ground_water(lens, stage, air, base, end - start, bench)
    if air.extinction * max(bench[2, 0], bench[2, end - start - 1]) > 0.004:
        _ground_air(lens, stage, air, dv, start, end, bench)
    for c in range(start, end):
        n = c - start
        light[c, 0], light[c, 1], light[c, 2] = bench[3, n], bench[4, n], bench[5, n]


@compiled(forceinline=True, borrowing=True)
def _ground_places(
    lens: Lens, q: np.ndarray, dv: float, start: int, end: int, bench: np.ndarray
) -> tuple[float, float]:
    """Write x, y, relative to the whole metres before the camera's place, and depth."""
    r = lens.rotation
    x0, y0 = r[1, 0] * dv + r[2, 0], r[1, 1] * dv + r[2, 1]
    ax, ay = r[0, 0] / lens.focal[0], r[0, 1] / lens.focal[0]
    base_x, base_y = np.floor(lens.origin[0]), np.floor(lens.origin[1])
    ox, oy = lens.origin[0] - base_x, lens.origin[1] - base_y
    u0 = start + 0.5 - lens.centre[0]
    for n in range(end - start):
        depth = 1.0 / q[start + n]
        bench[0, n] = ox + depth * (x0 + ax * (u0 + n))
        bench[1, n] = oy + depth * (y0 + ay * (u0 + n))
        bench[2, n] = depth
    return base_x, base_y


@compiled(forceinline=True, borrowing=True)
def _ground_cells(
    stage: Stage, level: int, base: tuple[float, float], bench: np.ndarray, count: int
) -> None:
    """Write the colours of the ground, linear between cells; near ones with their grain."""
    if level >= len(CELLS_M):
        for n in range(count):
            bench[3, n], bench[4, n], bench[5, n] = 0.048, 0.064, 0.025
        return
    scale = np.float32(1.0 / CELLS_M[level])
    cells = stage.cells[level]
    # Whole cells and what is left of them apart, so that 32 bits are enough.
    whole_x, whole_y = np.floor(base[0] / CELLS_M[level]), np.floor(base[1] / CELLS_M[level])
    bx = np.float32(base[0] / CELLS_M[level] - whole_x - 0.5)
    by = np.float32(base[1] / CELLS_M[level] - whole_y - 0.5)
    first_row, first_column = np.int64(whole_y), np.int64(whole_x)
    for n in range(count):
        fx, fy = bx + scale * bench[0, n], by + scale * bench[1, n]
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
        bench[3, n], bench[4, n] = mixed & 255, (mixed >> 32) & 255
        bench[5, n] = (mixed >> 16) & 255
    if bench[2, 0] < DETAIL_M:
        # A tile of noise is as wide as 256 specks; places far out lose no digits.
        fine_x = np.float32(SPECKS * (base[0] % 256.0) % NOISE_SIDE)
        fine_y = np.float32(SPECKS * (base[1] % 256.0) % NOISE_SIDE)
        specks = np.float32(SPECKS)
        for n in range(count):
            speck = cell_of(
                stage.noise, fine_x + specks * bench[0, n], fine_y + specks * bench[1, n]
            )
            near = np.float32(max(0.0, 1.0 - bench[2, n] / DETAIL_M))
            grain = (
                np.float32(1.0) + np.float32(0.45) * (np.float32(speck) - np.float32(0.5)) * near
            )
            bench[3, n], bench[4, n] = bench[3, n] * grain, bench[4, n] * grain
            bench[5, n] *= grain


@compiled(forceinline=True, borrowing=True)
def _ground_light(
    stage: Stage, air: Air, row: int, start: int, count: int, bench: np.ndarray
) -> None:
    """Square the roots and multiply them with the light of sun and sky."""
    for k in range(3):
        # Bytes of roots are squared, so 255 comes in twice, and once more with the shares.
        sun = np.float32(air.towards[2] * air.sun[k] / 255.0**3)
        sky = np.float32(air.sky[k] / 255.0**3)
        for n in range(count):
            shine = sun * np.float32(stage.lit[row, start + n])
            shine += sky * np.float32(stage.open_sky[row, start + n])
            bench[6 + k, n] = bench[3 + k, n] * bench[3 + k, n]
            bench[3 + k, n] = bench[6 + k, n] * shine


@compiled(borrowing=True)
def _ground_lamps(
    lens: Lens,
    stage: Stage,
    base: tuple[float, float],
    row: int,
    start: int,
    count: int,
    bench: np.ndarray,
) -> None:
    """Add the light of lamps: exact every `LAMP_STEP` pixels, linear between them."""
    ahead = _lamps_at(lens, stage, base, bench, 0)
    for first in range(0, count, LAMP_STEP):
        last = min(count - 1, first + LAMP_STEP)
        here, ahead = ahead, _lamps_at(lens, stage, base, bench, last)
        _evenly(bench[9], first, last, here[0], ahead[0])
        _evenly(bench[10], first, last, here[1], ahead[1])
    for n in range(count):
        warm = bench[9, n] * np.float32(stage.open_sky[row, start + n]) * np.float32(1.0 / 255.0)
        white = bench[10, n]
        bench[3, n] += bench[6, n] * (warm + white)
        bench[4, n] += bench[7, n] * (np.float32(0.72) * warm + np.float32(0.95) * white)
        bench[5, n] += bench[8, n] * (np.float32(0.42) * warm + np.float32(0.85) * white)


@compiled(forceinline=True, borrowing=True)
def _evenly(line: np.ndarray, first: int, last: int, here: np.float32, there: np.float32) -> None:
    """Write values from one pixel to another, both ends included."""
    step = np.float32(1.0 / max(1, last - first)) * (there - here)
    for n in range(first, last + 1):
        line[n] = here + np.float32(n - first) * step


@compiled(forceinline=True, borrowing=True)
def _lamps_at(
    lens: Lens, stage: Stage, base: tuple[float, float], bench: np.ndarray, n: int
) -> tuple[np.float32, np.float32]:
    """Light of street lamps and of headlights on one pixel of ground, over 255 squared."""
    x, y = base[0] + bench[0, n], base[1] + bench[1, n]
    warm, white = pools_at(stage.pools, stage.corner, x, y)
    white += own_beam(lens, x, y, 0.0, False)
    return np.float32(warm / 255.0**2), np.float32(white / 255.0**2)


@compiled(borrowing=True)
def _ground_water(
    lens: Lens, stage: Stage, air: Air, base: tuple[float, float], count: int, bench: np.ndarray
) -> None:
    """Let wet ground be darker, and mirror the sky."""
    for n in range(count):
        share = _mirrored(
            lens, stage, air, base[0] + bench[0, n], base[1] + bench[1, n], bench[2, n]
        )
        # Water does not stand on grass.
        share *= 0.15 if bench[7, n] > 1.15 * bench[6, n] else 1.0
        dark = 1.0 - 0.4 * air.wet - share
        for k in range(3):
            bench[3 + k, n] = dark * bench[3 + k, n] + share * air.horizon[k]


@compiled(forceinline=True, borrowing=True)
def _ground_air(
    lens: Lens,
    stage: Stage,
    air: Air,
    dv: float,
    start: int,
    end: int,
    bench: np.ndarray,
) -> None:
    """Let the air take light and give its own: exact at both ends, linear between them."""
    ends = (start, end - 1)
    shares = (1.0, 1.0)
    for i in range(2):
        du = (ends[i] + 0.5 - lens.centre[0]) / lens.focal[0]
        reach = bench[2, ends[i] - start] * np.sqrt(1.0 + du * du + dv * dv)
        share = share_passed(stage.fades, air.extinction * reach)
        shares = (share, share) if i == 0 else (shares[0], share)
    step = np.float32((shares[1] - shares[0]) / max(1, end - 1 - start))
    first = np.float32(shares[0])
    for k in range(3):
        veil = np.float32(air.veil[k])
        for n in range(end - start):
            passed = first + np.float32(n) * step
            bench[3 + k, n] = veil + passed * (bench[3 + k, n] - veil)


@compiled(forceinline=True, borrowing=True)
def _mirrored(lens: Lens, stage: Stage, air: Air, x: float, y: float, depth: float) -> float:
    """Share of light that wet ground mirrors: Schlick's law, more where water stands."""
    down = lens.origin[2] / np.sqrt(depth * depth + lens.origin[2] * lens.origin[2])
    graze = 1.0 - min(1.0, down)
    square = graze * graze
    puddle = min(1.0, max(0.0, 3.5 * (blend_of(stage.noise, 6.0 * x, 6.0 * y) - 0.42)))
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
    stage: Stage,
    pixels: np.ndarray,
) -> None:
    """Copy the bytes of the nearest cells into pixels (W, 3) uint8."""
    level = 0
    for c in (start, end - 1):
        du, depth = c + 0.5 - lens.centre[0], 1.0 / q[c]
        x, y = lens.origin[0] + depth * (x0 + ax * du), lens.origin[1] + depth * (y0 + ay * du)
        level = max(level, _level(lens, stage, (0.0, 0.0), x, y, depth))
    if level >= len(CELLS_M):
        for c in range(start, end):
            pixels[c, 0], pixels[c, 1], pixels[c, 2] = 57, 65, 44
        return
    scale = 1.0 / CELLS_M[level]
    for c in range(start, end):
        du, depth = c + 0.5 - lens.centre[0], scale / q[c]
        column = np.int64(np.floor(lens.origin[0] * scale + depth * (x0 + ax * du)))
        row = np.int64(np.floor(lens.origin[1] * scale + depth * (y0 + ay * du)))
        cell = np.int64(stage.cells[level, row & (SIDE - 1), column & (SIDE - 1)])
        pixels[c, 0], pixels[c, 1] = cell & 255, (cell >> 8) & 255
        pixels[c, 2] = cell >> 16
