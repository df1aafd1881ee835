"""Light on surfaces, the sky, the air between, and the exposure of the image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.ground_kernels import CELLS_M, SIDE, smooth_grain
from roadscope.envs.imaging.pattern_kernels import GLASS, Looks, paint, slanted
from roadscope.envs.imaging.raster_kernels import BOTTOM, FACES, GROUND_FACE, SKY_FACE, TOP, Lens

CURVE = 4096
"""Steps of the table from linear light to bytes."""
MOST = 1.0
"""Linear light that is white."""


class Air(NamedTuple):
    """Light and air, see `light.Light`.

    towards: (3,). sun, zenith, horizon, ground: (3,). clouds, lamps: as there.
    extinction: 1/m. veil: (3,) brightness of thick fog. gain: of the exposure.
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
    gain: float


@compiled()
def shade_all(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    lit: np.ndarray,
    open_sky: np.ndarray,
    normals: np.ndarray,
    looks: Looks,
    cells: np.ndarray,
    air: Air,
    curve: np.ndarray,
    pixels: np.ndarray,
) -> None:
    """Fill pixels (H, W, 3) uint8; normals (P, 14, 3) of the faces, curve (4096,) uint8."""
    height, width = q.shape
    out, light = np.empty(7), np.empty(3)
    r = lens.rotation
    for row in range(height):
        dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
        for column in range(width):
            du = (column + 0.5 - lens.centre[0]) / lens.focal[0]
            x = r[0, 0] * du + r[1, 0] * dv + r[2, 0]
            y = r[0, 1] * du + r[1, 1] * dv + r[2, 1]
            z = r[0, 2] * du + r[1, 2] * dv + r[2, 2]
            size = np.sqrt(1.0 + du * du + dv * dv)
            face = faces[row, column]
            if face == SKY_FACE:
                _sky(air, x / size, y / size, z / size, light)
                reach = 1e4
            else:
                depth = 1.0 / q[row, column]
                reach = depth * size
                px, py = lens.origin[0] + depth * x, lens.origin[1] + depth * y
                if face == GROUND_FACE:
                    sun = lit[row, column] / 255.0
                    sky = open_sky[row, column] / 255.0
                    _tarmac(lens, cells, px, py, depth, sun, sky, air, light)
                else:
                    pz = lens.origin[2] + depth * z
                    m, side = face // FACES, face % FACES
                    normal = (normals[m, side, 0], normals[m, side, 1], normals[m, side, 2])
                    if looks.patterns[m] == GLASS:
                        normal = slanted(looks.frames[m], normal, px, py)
                    paint(looks, m, normal, (px, py, pz), air.lamps, out)
                    view = (x / size, y / size, z / size)
                    _solid(air, normal, view, looks.lit[m], out, light)
            _expose(air, reach, light, curve, pixels[row, column])


@compiled(borrowing=True)
def _expose(
    air: Air, reach: float, light: np.ndarray, curve: np.ndarray, pixel: np.ndarray
) -> None:
    clear = np.exp(-air.extinction * reach) if air.extinction > 0.0 else 1.0
    for k in range(3):
        value = air.gain * (light[k] * clear + air.veil[k] * (1.0 - clear))
        step = int(value * (CURVE - 1) / MOST)
        pixel[k] = curve[min(CURVE - 1, max(0, step))]


@compiled(borrowing=True)
def _sky(air: Air, x: float, y: float, z: float, light: np.ndarray) -> None:
    """Brightness of the sky in a direction; below the horizon the far haze."""
    up = max(0.0, z)
    share = 1.0 - (1.0 - min(1.0, up)) ** 3
    toward = max(0.0, x * air.towards[0] + y * air.towards[1] + z * air.towards[2])
    glow = 0.35 * toward**24 + (4.0 if toward > 0.99996 else 0.0)
    cloud = 0.0
    if air.clouds > 0.0 and up > 0.01:
        u, v = x / (up + 0.12) * 1.6, y / (up + 0.12) * 1.6
        field = 0.55 * smooth_grain(u, v) + 0.28 * smooth_grain(2.3 * u, 2.3 * v)
        field += 0.17 * smooth_grain(5.1 * u, 5.1 * v)
        cloud = min(1.0, max(0.0, (field - 0.78 + 0.62 * air.clouds) * 4.0)) * min(1.0, 6.0 * up)
    white = 0.35 * (air.sun[0] + air.sun[1] + air.sun[2]) / 3.0 + 0.75 * air.horizon[1]
    for k in range(3):
        clear = air.horizon[k] + share * (air.zenith[k] - air.horizon[k]) + glow * air.sun[k]
        light[k] = clear + cloud * (white - clear)


@compiled(borrowing=True)
def _tarmac(
    lens: Lens,
    cells: np.ndarray,
    x: float,
    y: float,
    depth: float,
    lit: float,
    open_sky: float,
    air: Air,
    light: np.ndarray,
) -> None:
    """Ground: the cell at the degree of detail that one pixel covers."""
    footprint = depth / lens.focal[0] * np.sqrt(depth / max(0.3, lens.origin[2]))
    level = 0
    while level < len(CELLS_M) - 1 and (
        footprint > 1.4 * CELLS_M[level] or _beyond(lens, x, y, CELLS_M[level])
    ):
        level += 1
    cell_m = CELLS_M[level]
    fx, fy = x / cell_m - 0.5, y / cell_m - 0.5
    i, j = np.floor(fy), np.floor(fx)
    u, v = fx - j, fy - i
    row, column = int(i) % SIDE, int(j) % SIDE
    below, right = (row + 1) % SIDE, (column + 1) % SIDE
    far = _beyond(lens, x, y, cell_m)
    for k in range(3):
        a = cells[level, row, column, k] * (1.0 - u) + cells[level, row, right, k] * u
        b = cells[level, below, column, k] * (1.0 - u) + cells[level, below, right, k] * u
        root = (a + v * (b - a)) / 255.0
        albedo = root * root if not far else 0.05
        sky = 0.55 * air.zenith[k] + 0.45 * air.horizon[k]
        light[k] = albedo * (lit * air.sun[k] * air.towards[2] + open_sky * sky)


@compiled(forceinline=True, borrowing=True)
def _beyond(lens: Lens, x: float, y: float, cell_m: float) -> bool:
    half = (SIDE // 2 - 129) * cell_m
    outside: bool = abs(x - lens.origin[0]) > half or abs(y - lens.origin[1]) > half
    return outside


@compiled(borrowing=True)
def _solid(
    air: Air,
    normal: tuple[float, float, float],
    view: tuple[float, float, float],
    lit: float,
    out: np.ndarray,
    light: np.ndarray,
) -> None:
    """Diffuse light of sun, sky and ground, and what a glossy surface mirrors."""
    facing = normal[0] * air.towards[0] + normal[1] * air.towards[1] + normal[2] * air.towards[2]
    sun = max(0.0, facing) * lit
    up = 0.5 + 0.5 * normal[2]
    mirrored = 0.0
    rz = 0.0
    if out[3] > 0.0:
        into = -(view[0] * normal[0] + view[1] * normal[1] + view[2] * normal[2])
        into = min(1.0, max(0.0, into))
        mirrored = out[3] + (1.0 - out[3]) * (1.0 - into) ** 5
        rz = view[2] + 2.0 * into * normal[2]
    for k in range(3):
        sky = 0.5 * air.zenith[k] + 0.5 * air.horizon[k]
        diffuse = out[k] * (sun * air.sun[k] + up * sky + (1.0 - up) * air.ground[k])
        if mirrored > 0.0:
            share = min(1.0, max(0.0, 0.5 + 4.0 * rz))
            world = air.ground[k] + share * (
                air.horizon[k] + max(0.0, rz) * (air.zenith[k] - air.horizon[k]) - air.ground[k]
            )
            diffuse += mirrored * (world - diffuse)
        light[k] = diffuse + out[4 + k]


@compiled()
def face_normals(footprints: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> None:
    """Fill normals (P, 14, 3), outward unit vectors of the sides, top and bottom."""
    for m in range(len(corners)):
        count = corners[m]
        for k in range(count):
            after = k + 1 if k + 1 < count else 0
            dx = footprints[m, after, 0] - footprints[m, k, 0]
            dy = footprints[m, after, 1] - footprints[m, k, 1]
            length = max(1e-12, np.sqrt(dx * dx + dy * dy))
            normals[m, k, 0], normals[m, k, 1], normals[m, k, 2] = dy / length, -dx / length, 0.0
        normals[m, TOP, 0] = normals[m, TOP, 1] = normals[m, BOTTOM, 0] = normals[m, BOTTOM, 1] = (
            0.0
        )
        normals[m, TOP, 2], normals[m, BOTTOM, 2] = 1.0, -1.0
