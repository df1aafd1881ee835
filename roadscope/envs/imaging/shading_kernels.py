"""From what every pixel shows to the light that comes from there, run by run of one face."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.ground_kernels import CELLS_M, SIDE
from roadscope.envs.imaging.lamp_kernels import own_beam, pool_at
from roadscope.envs.imaging.noise_kernels import blend_of, cell_of
from roadscope.envs.imaging.pattern_kernels import GLASS, METAL, PLAIN, SIGN, Looks, paint
from roadscope.envs.imaging.raster_kernels import BOTTOM, FACES, GROUND_FACE, SKY_FACE, TOP, Lens
from roadscope.envs.imaging.sky_kernels import BLOCK, Air
from roadscope.envs.imaging.vehicle_kernels import slanted

CHUNK = 64
"""Pixels of ground along a row that share a degree of detail."""
DETAIL_M = 14.0
"""Nearer than this the grain of the ground is seen."""
OUTER, MIDDLE, ALL = 0xFF00FF, 0x00FF00, 0xFF00FF00FF
"""Red and blue, green of a packed colour, and all three a byte apart."""
FADES = 1024
"""Steps of the table of what the air lets through, up to an optical depth of `THICKEST`."""
THICKEST = 12.0


class Stage(NamedTuple):
    """What is lit, beside lens and air.

    footprints: (P, 12, 2), corners: (P,) of the prisms. normals, glow: (P, 14, 3) of the faces:
    outward unit vector, and light that falls on it. lit, open_sky: (H, W) uint8, see
    `cast_shadows`. cells: (3, SIDE, SIDE + PADDING) uint32, middles: (3, 2) of the ground. noise: see
    `noise_tile`. pools: (256, 256, 2), corner: x y, see `light_pools`. blocks: see `sky_blocks`.
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


@compiled()
def shade_all(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    looks: Looks,
    stage: Stage,
    air: Air,
    light: np.ndarray,
) -> None:
    """Fill light (H, W, 3) float32, linear; 1 is white."""
    height, width = q.shape
    out, bench = np.empty(7), np.empty((9, CHUNK), np.float32)
    line = np.empty((stage.blocks.shape[1], 3), np.float32)
    for row in range(height):
        shade_row(
            lens, q[row], faces[row], row, looks, stage, air, (out, line, bench), light[row]
        )


@compiled(forceinline=True, borrowing=True)
def shade_row(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    row: int,
    looks: Looks,
    stage: Stage,
    air: Air,
    places: tuple[np.ndarray, np.ndarray, np.ndarray],
    light: np.ndarray,
) -> None:
    """Shade one row of pixels; places (7,), (W / 8 + 2, 3) and (9, CHUNK) to work in."""
    out, line, bench = places
    width, start, ready = len(faces), 0, False
    while start < width:
        face, end = faces[start], start + 1
        while end < width and faces[end] == face:
            end += 1
        if face == SKY_FACE:
            if not ready:
                _sky_line(stage.blocks, row, line)
                ready = True
            _sky_run(lens, row, start, end, line, stage.heights, air, light)
        elif face == GROUND_FACE:
            for first in range(start, end, CHUNK):
                last = min(end, first + CHUNK)
                _ground_run(lens, q, row, first, last, stage, air, bench, light)
        else:
            _solid_run(lens, q, row, start, end, face, looks, stage, air, out, light)
        start = end


@compiled(forceinline=True, borrowing=True)
def _sky_line(blocks: np.ndarray, row: int, line: np.ndarray) -> None:
    i = row // BLOCK
    share = np.float32((row + 0.5 - i * BLOCK) / BLOCK)
    for j in range(len(line)):
        for k in range(3):
            line[j, k] = blocks[i, j, k] + share * (blocks[i + 1, j, k] - blocks[i, j, k])


@compiled(forceinline=True, borrowing=True)
def _sky_run(
    lens: Lens,
    row: int,
    start: int,
    end: int,
    line: np.ndarray,
    heights: np.ndarray,
    air: Air,
    light: np.ndarray,
) -> None:
    """Sky, and near the horizon the trees of the skyline in the haze."""
    r = lens.rotation
    dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
    high = r[1, 2] * dv + r[2, 2]
    slope = r[0, 2] / lens.focal[0]
    edge = high + slope * (start + 0.5 - lens.centre[0])
    other = high + slope * (end - 0.5 - lens.centre[0])
    near = min(edge, other) < 0.06
    haze = np.exp(-900.0 * air.extinction)
    for j in range(start // BLOCK, (end + BLOCK - 1) // BLOCK):
        first, last = max(start, j * BLOCK), min(end, (j + 1) * BLOCK)
        for k in range(3):
            step = (line[j + 1, k] - line[j, k]) * np.float32(1.0 / BLOCK)
            value = line[j, k] + np.float32(first + 0.5 - j * BLOCK) * step
            for c in range(first, last):
                light[c, k] = value
                value += step
    if near:
        for c in range(start, end):
            du = (c + 0.5 - lens.centre[0]) / lens.focal[0]
            z = high + slope * (c + 0.5 - lens.centre[0])
            if z < heights[c] * np.sqrt(1.0 + du * du + dv * dv):
                for k in range(3):
                    leaf = 0.05 * (air.zenith[k] + air.horizon[k]) + 0.02 * air.sun[k]
                    light[c, k] = leaf * haze + air.veil[k] * (1.0 - haze)


@compiled(forceinline=True, borrowing=True)
def _passed(fades: np.ndarray, thickness: float) -> float:
    """Share of light that passes an optical depth, exp(-thickness), from the table."""
    at = min(thickness, 0.999 * THICKEST) * (FADES / THICKEST)
    step = int(at)
    low: float = fades[step]
    return low + (at - step) * (fades[step + 1] - low)


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
def _ground_run(
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
    """Shade up to `CHUNK` pixels of ground; bench (9, CHUNK) float32 is room to work in.

    Its rows hold x, y, depth, red, green, blue, then light of sun, of sky, and the air's share.
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
    if air.lamps or air.wet > 0.0:
        _ground_lamps(lens, stage, air, base, row, start, end - start, bench)
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
        row, column = (np.int64(i) + first_row) & (SIDE - 1), (np.int64(j) + first_column) & (SIDE - 1)
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
        bx, by = 170.0 * (base[0] % 256.0), 170.0 * (base[1] % 256.0)
        for n in range(count):
            grain = cell_of(stage.noise, bx + 170.0 * bench[0, n], by + 170.0 * bench[1, n])
            share = np.float32(max(0.0, 1.0 - bench[2, n] / DETAIL_M))
            grain = np.float32(1.0) + np.float32(0.45) * (grain - np.float32(0.5)) * share
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
        sky = np.float32((0.4 * air.zenith[k] + 0.6 * air.horizon[k]) / 255.0**3)
        for n in range(count):
            shine = sun * np.float32(stage.lit[row, start + n])
            shine += sky * np.float32(stage.open_sky[row, start + n])
            bench[6 + k, n] = bench[3 + k, n] * bench[3 + k, n]
            bench[3 + k, n] = bench[6 + k, n] * shine


@compiled(borrowing=True)
def _ground_lamps(
    lens: Lens,
    stage: Stage,
    air: Air,
    base: tuple[float, float],
    row: int,
    start: int,
    count: int,
    bench: np.ndarray,
) -> None:
    """Add the light of lamps, and what wet ground mirrors."""
    for n in range(count):
        x, y = base[0] + bench[0, n], base[1] + bench[1, n]
        if air.lamps:
            warm = pool_at(stage.pools, stage.corner, x, y, 0)
            warm *= stage.open_sky[row, start + n] / 255.0
            white = pool_at(stage.pools, stage.corner, x, y, 1) + own_beam(lens, x, y, 0.0, False)
            bench[3, n] += bench[6, n] * (warm + white) / 255.0**2
            bench[4, n] += bench[7, n] * (0.72 * warm + 0.95 * white) / 255.0**2
            bench[5, n] += bench[8, n] * (0.42 * warm + 0.85 * white) / 255.0**2
        if air.wet > 0.0:
            share = _mirrored(lens, stage, air, x, y, bench[2, n])
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
        share = _passed(stage.fades, air.extinction * reach)
        shares = (share, share) if i == 0 else (shares[0], share)
    step = np.float32((shares[1] - shares[0]) / max(1, end - 1 - start))
    first = np.float32(shares[0])
    for k in range(3):
        veil = np.float32(air.veil[k])
        for n in range(end - start):
            passed = first + np.float32(n) * step
            bench[3 + k, n] = veil + passed * (bench[3 + k, n] - veil)


@compiled(forceinline=True, borrowing=True)
def _mirrored(
    lens: Lens, stage: Stage, air: Air, x: float, y: float, depth: float
) -> float:
    """Share of light that wet ground mirrors: Schlick's law, more where water stands."""
    down = lens.origin[2] / np.sqrt(depth * depth + lens.origin[2] * lens.origin[2])
    graze = 1.0 - min(1.0, down)
    square = graze * graze
    puddle = min(1.0, max(0.0, 3.5 * (blend_of(stage.noise, 6.0 * x, 6.0 * y) - 0.42)))
    return air.wet * (0.5 + 0.5 * puddle) * (0.02 + 0.6 * square * square * graze)


@compiled(forceinline=True, borrowing=True)
def _solid_run(
    lens: Lens,
    q: np.ndarray,
    row: int,
    start: int,
    end: int,
    face: int,
    looks: Looks,
    stage: Stage,
    air: Air,
    out: np.ndarray,
    light: np.ndarray,
) -> None:
    r = lens.rotation
    m, side = face // FACES, face % FACES
    normal = (stage.normals[m, side, 0], stage.normals[m, side, 1], stage.normals[m, side, 2])
    edge = _edge(stage, m, side)
    pattern = looks.patterns[m]
    dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
    x0, y0 = r[1, 0] * dv + r[2, 0], r[1, 1] * dv + r[2, 1]
    z0 = r[1, 2] * dv + r[2, 2]
    for c in range(start, end):
        du, depth = (c + 0.5 - lens.centre[0]) / lens.focal[0], 1.0 / q[c]
        vx, vy, vz = x0 + r[0, 0] * du, y0 + r[0, 1] * du, z0 + r[0, 2] * du
        place = (
            lens.origin[0] + depth * vx, lens.origin[1] + depth * vy, lens.origin[2] + depth * vz,
        )  # fmt: skip
        if pattern == PLAIN:
            out[0], out[1], out[2] = looks.colours[m, 0], looks.colours[m, 1], looks.colours[m, 2]
            out[3], out[4], out[5], out[6] = looks.gloss[m], 0.0, 0.0, 0.0
        else:
            paint(looks, stage.noise, m, edge, normal, place, air.lamps, out)
        if out[3] > 0.0:
            turned = normal
            if pattern == GLASS and out[3] > 0.05:
                turned = slanted(looks.frames[m], normal, place[0], place[1])
            short = 1.0 / np.sqrt(1.0 + du * du + dv * dv)
            _glossy(stage, air, m, side, turned, (vx * short, vy * short, vz * short), out)
        else:
            out[4] += out[0] * stage.glow[m, side, 0]
            out[5] += out[1] * stage.glow[m, side, 1]
            out[6] += out[2] * stage.glow[m, side, 2]
        if air.lamps:
            _lamplight(lens, looks, stage, m, normal, place, out)
        if air.extinction * depth > 0.004:
            size = np.sqrt(1.0 + du * du + dv * dv)
            passed = _passed(stage.fades, air.extinction * depth * size)
            for k in range(3):
                out[4 + k] = air.veil[k] + passed * (out[4 + k] - air.veil[k])
        light[c, 0], light[c, 1], light[c, 2] = out[4], out[5], out[6]


@compiled(forceinline=True, borrowing=True)
def _edge(stage: Stage, m: int, side: int) -> tuple[float, float, float]:
    """Where an upright face begins, and its length."""
    if side >= TOP:
        return 0.0, 0.0, 1.0
    after = side + 1 if side + 1 < stage.corners[m] else 0
    x, y = stage.footprints[m, side, 0], stage.footprints[m, side, 1]
    dx, dy = stage.footprints[m, after, 0] - x, stage.footprints[m, after, 1] - y
    return x, y, np.sqrt(dx * dx + dy * dy)


@compiled(forceinline=True, borrowing=True)
def _glossy(
    stage: Stage,
    air: Air,
    m: int,
    side: int,
    normal: tuple[float, float, float],
    view: tuple[float, float, float],
    out: np.ndarray,
) -> None:
    """Add to the own light in out[4:] what a surface throws back and what it mirrors."""
    into = -(view[0] * normal[0] + view[1] * normal[1] + view[2] * normal[2])
    into = min(1.0, max(0.0, into))
    miss = 1.0 - into
    square = miss * miss
    mirrored = out[3] + (1.0 - out[3]) * square * square * miss
    rz = view[2] + 2.0 * into * normal[2]
    share = min(1.0, max(0.0, 0.5 + 4.0 * rz))
    for k in range(3):
        value = out[k] * stage.glow[m, side, k]
        sky = air.horizon[k] + max(0.0, rz) * (air.zenith[k] - air.horizon[k])
        world = air.ground[k] + share * (sky - air.ground[k])
        out[4 + k] += value + mirrored * (world - value)


@compiled(borrowing=True)
def _lamplight(
    lens: Lens,
    looks: Looks,
    stage: Stage,
    m: int,
    normal: tuple[float, float, float],
    place: tuple[float, float, float],
    out: np.ndarray,
) -> None:
    """Add what lamps throw on a surface; sheeting of signs throws headlights back to them."""
    upright = normal[2] == 0.0
    white = own_beam(lens, place[0], place[1], place[2], True)
    if upright:
        dx, dy = place[0] - lens.origin[0], place[1] - lens.origin[1]
        away = np.sqrt(dx * dx + dy * dy) + 1e-9
        white *= max(0.0, -(normal[0] * dx + normal[1] * dy) / away)
    else:
        white *= 0.2
    if looks.patterns[m] == SIGN:
        white *= 6.0
    white += 0.4 * pool_at(stage.pools, stage.corner, place[0], place[1], 1) * max(
        0.0, 1.0 - 0.6 * place[2]
    )
    warm = 0.55 * pool_at(stage.pools, stage.corner, place[0], place[1], 0)
    warm *= max(0.1, 1.0 - place[2] / 8.0) if looks.patterns[m] != METAL else 0.5
    out[4] += out[0] * (warm + white)
    out[5] += out[1] * (0.72 * warm + 0.95 * white)
    out[6] += out[2] * (0.42 * warm + 0.85 * white)


@compiled()
def light_faces(
    footprints: np.ndarray,
    corners: np.ndarray,
    lit: np.ndarray,
    air: Air,
    normals: np.ndarray,
    glow: np.ndarray,
) -> None:
    """Fill outward normals (P, 14, 3) of sides, top and bottom, and the light on them.

    glow: light of sun, sky and ground that falls on a face, by colour; lit: (P,) share of sun.
    """
    for m in range(len(corners)):
        count = corners[m]
        for side in range(BOTTOM + 1):
            x = y = z = 0.0
            if side >= TOP:
                z = 1.0 if side == TOP else -1.0
            elif side < count:
                after = side + 1 if side + 1 < count else 0
                dx = footprints[m, after, 0] - footprints[m, side, 0]
                dy = footprints[m, after, 1] - footprints[m, side, 1]
                length = max(1e-12, np.sqrt(dx * dx + dy * dy))
                x, y = dy / length, -dx / length
            else:
                continue
            normals[m, side, 0], normals[m, side, 1], normals[m, side, 2] = x, y, z
            facing = x * air.towards[0] + y * air.towards[1] + z * air.towards[2]
            sun, up = max(0.0, facing) * lit[m], 0.5 + 0.5 * z
            for k in range(3):
                sky = 0.5 * air.zenith[k] + 0.5 * air.horizon[k]
                glow[m, side, k] = sun * air.sun[k] + up * sky + (1.0 - up) * air.ground[k]


@compiled()
def shade_plainly(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    flat: np.ndarray,
    stage: Stage,
    sky: np.ndarray,
    pixels: np.ndarray,
) -> None:
    """Fill pixels (H, W, 3) uint8 with one colour a face, flat (P * 16, 3) uint8.

    sky: (3,) uint8. The ground shows the painted cell that holds the point.
    """
    height, width = q.shape
    r = lens.rotation
    for row in range(height):
        dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
        x0, y0 = r[1, 0] * dv + r[2, 0], r[1, 1] * dv + r[2, 1]
        ax, ay = r[0, 0] / lens.focal[0], r[0, 1] / lens.focal[0]
        start = 0
        while start < width:
            face, end = faces[row, start], start + 1
            while end < width and faces[row, end] == face:
                end += 1
            if face == GROUND_FACE:
                for first in range(start, end, CHUNK):
                    last = min(end, first + CHUNK)
                    _plain_ground(
                        lens, q[row], x0, y0, ax, ay, first, last, stage, pixels[row]
                    )
            else:
                colour = sky if face == SKY_FACE else flat[face]
                red, green, blue = colour[0], colour[1], colour[2]
                for c in range(start, end):
                    pixels[row, c, 0], pixels[row, c, 1], pixels[row, c, 2] = red, green, blue
            start = end


@compiled(forceinline=True, borrowing=True)
def _plain_ground(
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
