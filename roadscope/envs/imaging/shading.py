"""The colours of the pixels of an image."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.core import Pose
from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.envs.imaging.ground import CHUNK, LAMP_STEP, Ground, ground_run, plain_ground
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.lighting import (
    BLOCK,
    GREATEST_DEPTH,
    POOL_M,
    POOL_SIDE,
    TRANSMITTANCE_STEPS,
    Air,
    ShadingTables,
    cast_shadows,
    light_pools,
    own_beam,
    pools_at,
    sky_blocks,
    skyline,
    sunlit,
    transmitted,
)
from roadscope.envs.imaging.noise import noise_tile
from roadscope.envs.imaging.patterns import (
    GLASS,
    LANTERN,
    METAL,
    PLAIN,
    SIGN,
    Appearance,
    Edge,
    appearance_of,
    paint,
)
from roadscope.envs.imaging.pinhole import Pinhole
from roadscope.envs.imaging.raster import (
    BOTTOM,
    FACES,
    GROUND_FACE,
    SKY_FACE,
    TOP,
    Lens,
    Point,
    Raster,
    Solids,
    Vector,
    lens_of,
)
from roadscope.envs.imaging.vehicle_patterns import slanted
from roadscope.envs.raycast.scene import Scene

# --------------------------------------------------------------------------------------------------
# The light of every pixel, computed for runs of pixels with the same face.


@compiled()
def shade_all(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    appearance: Appearance,
    tables: ShadingTables,
    air: Air,
    light: np.ndarray,
) -> None:
    """Fill light (H, W, 3) float32, linear; 1 is white."""
    out, workspace = np.empty(7), np.empty((11, CHUNK), np.float32)
    line = np.empty((tables.blocks.shape[1], 3), np.float32)
    for row in range(len(q)):
        shade_row(
            lens, q[row], faces[row], row, appearance, tables, air, out, line, workspace, light[row]
        )


@compiled(forceinline=True, borrowing=True)
def shade_row(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    row: int,
    appearance: Appearance,
    tables: ShadingTables,
    air: Air,
    out: np.ndarray,
    line: np.ndarray,
    workspace: np.ndarray,
    light: np.ndarray,
) -> None:
    """Shade one row of pixels.

    out (7,), line (W / 8 + 2, 3) and workspace (11, CHUNK) are scratch arrays. out has a pixel's
    colour (red, green, blue), its gloss, and the light that it sends out (red, green, blue).
    """
    width, start, ready = len(faces), 0, False
    while start < width:
        face, end = faces[start], start + 1
        while end < width and faces[end] == face:
            end += 1
        if face == SKY_FACE:
            if not ready:
                _sky_line(tables.blocks, row, line)
                ready = True
            _sky_run(lens, row, start, end, line, tables.heights, air, light)
        elif face == GROUND_FACE:
            for first in range(start, end, CHUNK):
                last = min(end, first + CHUNK)
                ground_run(lens, q, row, first, last, tables, air, workspace, light)
        else:
            _solid_run(lens, q, row, start, end, face, appearance, tables, air, out, light)
        start = end


@compiled(forceinline=True, borrowing=True)
def _sky_line(blocks: np.ndarray, row: int, line: np.ndarray) -> None:
    """Write the light of the sky in one row, at the corners of blocks."""
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
    """Draw the sky, and near the horizon the trees of the skyline in the haze."""
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
        # The three colours in one loop: none waits for another's sum.
        share = np.float32(1.0 / BLOCK)
        red_step, green_step = (
            (line[j + 1, 0] - line[j, 0]) * share,
            (line[j + 1, 1] - line[j, 1]) * share,
        )
        blue_step = (line[j + 1, 2] - line[j, 2]) * share
        offset = np.float32(first + 0.5 - j * BLOCK)
        red, green, blue = (
            line[j, 0] + offset * red_step,
            line[j, 1] + offset * green_step,
            line[j, 2] + offset * blue_step,
        )
        for c in range(first, last):
            light[c, 0], light[c, 1], light[c, 2] = red, green, blue
            red, green, blue = red + red_step, green + green_step, blue + blue_step
    if near:
        for c in range(start, end):
            du = (c + 0.5 - lens.centre[0]) / lens.focal[0]
            z = high + slope * (c + 0.5 - lens.centre[0])
            if z < heights[c] * np.sqrt(1.0 + du * du + dv * dv):
                for k in range(3):
                    leaf = 0.05 * (air.zenith[k] + air.horizon[k]) + 0.02 * air.sun[k]
                    light[c, k] = leaf * haze + air.veil[k] * (1.0 - haze)


@compiled(forceinline=True, borrowing=True)
def _solid_run(
    lens: Lens,
    q: np.ndarray,
    row: int,
    start: int,
    end: int,
    face: int,
    appearance: Appearance,
    tables: ShadingTables,
    air: Air,
    out: np.ndarray,
    light: np.ndarray,
) -> None:
    r = lens.rotation
    m, side = face // FACES, face % FACES
    normals = tables.normals
    normal = Vector(normals[m, side, 0], normals[m, side, 1], normals[m, side, 2])
    edge = _edge(tables, m, side)
    dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
    x0, y0 = r[1, 0] * dv + r[2, 0], r[1, 1] * dv + r[2, 1]
    z0 = r[1, 2] * dv + r[2, 2]
    here = ahead = step = (0.0, 0.0)
    slope = 1.0 / lens.focal[0]
    if air.lamps:
        there = _point_at(lens, q, start, Vector(x0, y0, z0))
        ahead = _lamps_on(lens, appearance, tables, m, normal, there)
    for c in range(start, end):
        du, depth = (c + 0.5 - lens.centre[0]) * slope, 1.0 / q[c]
        vx, vy, vz = x0 + r[0, 0] * du, y0 + r[0, 1] * du, z0 + r[0, 2] * du
        point = Vector(
            lens.origin[0] + depth * vx, lens.origin[1] + depth * vy, lens.origin[2] + depth * vz
        )
        if appearance.patterns[m] == PLAIN:
            _plain(appearance, m, out)
        else:
            paint(appearance, tables.noise, m, edge, normal, point, air.lamps, out)
        size = np.sqrt(1.0 + du * du + dv * dv)
        if out[3] > 0.0:
            turned = _shading_normal(appearance, m, normal, point, out[3])
            short = 1.0 / size
            _glossy(tables, air, m, side, turned, Vector(vx * short, vy * short, vz * short), out)
        else:
            _matt(tables, m, side, out)
        if air.lamps:
            along = (c - start) % LAMP_STEP
            if along == 0:
                last = min(end - 1, c + LAMP_STEP)
                there = _point_at(lens, q, last, Vector(x0, y0, z0))
                here, ahead = ahead, _lamps_on(lens, appearance, tables, m, normal, there)
                share = 1.0 / max(1, last - c)
                step = (share * (ahead[0] - here[0]), share * (ahead[1] - here[1]))
            _lamplit(here[0] + along * step[0], here[1] + along * step[1], out)
        if air.extinction * depth > 0.004:
            _haze(tables, air, air.extinction * depth * size, out)
        light[c, 0], light[c, 1], light[c, 2] = out[4], out[5], out[6]


@compiled(forceinline=True, borrowing=True)
def _plain(appearance: Appearance, m: int, out: np.ndarray) -> None:
    out[0], out[1], out[2] = (
        appearance.colours[m, 0],
        appearance.colours[m, 1],
        appearance.colours[m, 2],
    )
    out[3], out[4], out[5], out[6] = appearance.gloss[m], 0.0, 0.0, 0.0


@compiled(forceinline=True, borrowing=True)
def _shading_normal(
    appearance: Appearance, m: int, normal: Vector, point: Vector, gloss: float
) -> Vector:
    """Return the normal of a surface; window panes are slanted."""
    if appearance.patterns[m] == GLASS and gloss > 0.05:
        return slanted(appearance.frames[m], normal, point.x, point.y)
    return normal


@compiled(forceinline=True, borrowing=True)
def _matt(tables: ShadingTables, m: int, side: int, out: np.ndarray) -> None:
    """Add the light that a surface without gloss reflects to the emitted light in out[4:]."""
    out[4] += out[0] * tables.glow[m, side, 0]
    out[5] += out[1] * tables.glow[m, side, 1]
    out[6] += out[2] * tables.glow[m, side, 2]


@compiled(forceinline=True, borrowing=True)
def _lamplit(warm: float, white: float, out: np.ndarray) -> None:
    """Add the reflected light of street lamps (warm) and of headlights (white)."""
    out[4] += out[0] * (warm + white)
    out[5] += out[1] * (0.72 * warm + 0.95 * white)
    out[6] += out[2] * (0.42 * warm + 0.85 * white)


@compiled(forceinline=True, borrowing=True)
def _haze(tables: ShadingTables, air: Air, thickness: float, out: np.ndarray) -> None:
    """Apply extinction and airlight; thickness: optical depth."""
    clear = transmitted(tables.transmittances, thickness)
    for k in range(3):
        out[4 + k] = air.veil[k] + clear * (out[4 + k] - air.veil[k])


@compiled(forceinline=True, borrowing=True)
def _edge(tables: ShadingTables, m: int, side: int) -> Edge:
    """Return the lower edge of an upright face; a stand-in for top and bottom."""
    if side >= TOP:
        return Edge(0.0, 0.0, 1.0)
    after = side + 1 if side + 1 < tables.corners[m] else 0
    x, y = tables.footprints[m, side, 0], tables.footprints[m, side, 1]
    dx, dy = tables.footprints[m, after, 0] - x, tables.footprints[m, after, 1] - y
    return Edge(x, y, np.sqrt(dx * dx + dy * dy))


@compiled(forceinline=True, borrowing=True)
def _glossy(
    tables: ShadingTables, air: Air, m: int, side: int, normal: Vector, ray: Vector, out: np.ndarray
) -> None:
    """Add the light that a surface reflects and mirrors to the emitted light in out[4:].

    The mirrored share follows Schlick 1994.
    """
    cosine = -(ray.x * normal.x + ray.y * normal.y + ray.z * normal.z)
    cosine = min(1.0, max(0.0, cosine))
    grazing = 1.0 - cosine
    square = grazing * grazing
    mirrored = out[3] + (1.0 - out[3]) * square * square * grazing
    rz = ray.z + 2.0 * cosine * normal.z
    share = min(1.0, max(0.0, 0.5 + 4.0 * rz))
    for k in range(3):
        value = out[k] * tables.glow[m, side, k]
        sky = air.horizon[k] + max(0.0, rz) * (air.zenith[k] - air.horizon[k])
        world = air.ground[k] + share * (sky - air.ground[k])
        out[4 + k] += value + mirrored * (world - value)


@compiled(borrowing=True)
def _lamps_on(
    lens: Lens, appearance: Appearance, tables: ShadingTables, m: int, normal: Vector, point: Vector
) -> tuple[float, float]:
    """Return the light of street lamps and of headlights on a surface.

    Signs are retroreflective: they return headlights to their source.
    """
    upright = normal.z == 0.0
    white = own_beam(lens, point.x, point.y, point.z, True)
    if upright:
        dx, dy = point.x - lens.origin[0], point.y - lens.origin[1]
        away = np.sqrt(dx * dx + dy * dy) + 1e-9
        white *= max(0.0, -(normal.x * dx + normal.y * dy) / away)
    else:
        white *= 0.2
    if appearance.patterns[m] == SIGN:
        white *= 6.0
    lanterns, headlights = pools_at(tables.pools, tables.origin, point.x, point.y)
    white += 0.4 * headlights * max(0.0, 1.0 - 0.6 * point.z)
    warm = 0.55 * lanterns
    warm *= max(0.1, 1.0 - point.z / 8.0) if appearance.patterns[m] != METAL else 0.5
    return warm, white


@compiled(forceinline=True, borrowing=True)
def _point_at(lens: Lens, q: np.ndarray, c: int, ray: Vector) -> Vector:
    """Return the surface point behind pixel c of a row.

    ray: world frame, through the row at the column of the optical centre.
    """
    r = lens.rotation
    du, depth = (c + 0.5 - lens.centre[0]) / lens.focal[0], 1.0 / q[c]
    return Vector(
        lens.origin[0] + depth * (ray.x + r[0, 0] * du),
        lens.origin[1] + depth * (ray.y + r[0, 1] * du),
        lens.origin[2] + depth * (ray.z + r[0, 2] * du),
    )


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

    glow: (P, 14, 3) light of sun, sky and ground that falls on a face, by colour.
    lit: (P,) share of the sun that reaches a prism.
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
                diffuse = up * air.sky[k] + (1.0 - up) * air.ground[k]
                glow[m, side, k] = sun * air.sun[k] + diffuse


@compiled()
def fill_plain(
    lens: Lens,
    q: np.ndarray,
    faces: np.ndarray,
    flat: np.ndarray,
    tables: ShadingTables,
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
                    plain_ground(lens, q[row], x0, y0, ax, ay, first, last, tables, pixels[row])
            else:
                colour = sky if face == SKY_FACE else flat[face]
                red, green, blue = colour[0], colour[1], colour[2]
                for c in range(start, end):
                    pixels[row, c, 0], pixels[row, c, 1], pixels[row, c, 2] = red, green, blue
            start = end


# --------------------------------------------------------------------------------------------------
# The light of a whole image.

CLEAR_PER_M = 1.2e-4
"""Extinction of clear air: a visibility of 33 km."""
BALANCE = 0.5
"""Share of the sky's tint that the camera's white balance removes."""
BRIGHTEST_FOG = 0.75
"""Greatest brightness of fog; the exposure keeps it below white."""
SRGB_STEPS = 4096
"""Entries of the table from linear light to bytes."""
_BUFFERS = threading.local()


@dataclass(frozen=True, slots=True, eq=False)
class CameraView(Record):
    """The view of a camera at one instant.

    raster: the nearest surfaces, seen from `world_from_camera` through the pinhole.
    solids: prisms of the scene at the stamp.
    stamp_s: seconds since reset.
    categories: (A,) of the actors.
    """

    raster: Raster
    scene: Scene
    solids: Solids
    pinhole: Pinhole
    world_from_camera: Pose
    stamp_s: float
    categories: np.ndarray

    @property
    def lens(self) -> Lens:
        """Pose and intrinsics of the camera."""
        return lens_of(self.pinhole, self.world_from_camera)

    @property
    def appearance(self) -> Appearance:
        """Appearance of the solids."""
        return appearance_of(self.scene, self.solids, self.stamp_s, self.categories)


def shade(
    view: CameraView,
    ground: Ground,
    light: Light,
    *,
    extinction_per_m: float = 0.0,
    wet: float = 0.0,
) -> np.ndarray:
    """Return (H, W, 3) float32 linear light of the view; 1 is white.

    The next call of the same thread with the same size writes into the same array.
    wet: 0 to 1, how wet the ground is.
    """
    lens, air = view.lens, air_of(light, extinction_per_m, wet)
    raster, solids, appearance = view.raster, view.solids, view.appearance
    lit, open_sky = thread_buffer("shadows", (2, *raster.faces.shape), np.uint8)
    cast_shadows(lens, solids, raster.faces, air.towards, lit, open_sky)
    sunlit(solids, air.towards, lens, appearance.lit)
    tables = _tables(lens, solids, appearance, air, ground, lit, open_sky, view.pinhole)
    linear = thread_buffer("light", (*raster.faces.shape, 3), np.float32)
    shade_all(lens, raster.q, raster.faces, appearance, tables, air, linear)
    return linear


def shade_plain(view: CameraView, ground: Ground, light: Light) -> np.ndarray:
    """Return (H, W, 3) uint8 pixels: one colour a face, no shadows, textures or weather."""
    lens, air = view.lens, air_of(light, 0.0, 0.0)
    raster, solids, appearance = view.raster, view.solids, view.appearance
    none = np.empty((0, 0), np.uint8)
    tables = _tables(lens, solids, appearance, air, ground, none, none, view.pinhole)
    faces = np.zeros((len(solids.corners), FACES, 3), np.float32)
    faces[:, : tables.glow.shape[1]] = tables.glow * appearance.colours[:, None]
    steps = (np.clip(faces, 0.0, 1.0) * (SRGB_STEPS - 1)).astype(np.int64)
    sky = (np.clip(air.horizon, 0.0, 1.0) * (SRGB_STEPS - 1)).astype(np.int64)
    pixels = np.empty((*raster.faces.shape, 3), np.uint8)
    fill_plain(
        lens,
        raster.q,
        raster.faces,
        srgb_table()[steps].reshape(-1, 3),
        tables,
        srgb_table()[sky],
        pixels,
    )
    return pixels


def air_of(light: Light, extinction_per_m: float, wet: float) -> Air:
    """Return light and air; fog is as bright as the horizon."""
    sun, zenith, horizon, ground = (
        light.gain * np.array(c) for c in (light.sun, light.zenith, light.horizon, light.ground)
    )
    # Fog and rain hide the sun from the ground as from the camera.
    hidden = float(np.exp(-150.0 * extinction_per_m))
    zenith = zenith + 0.5 * (1.0 - hidden) * (horizon - zenith)
    open_sky = 0.45 * zenith + 0.55 * horizon
    # The camera's white balance removes part of the blue of the sky.
    balanced = open_sky + BALANCE * (open_sky.mean() - open_sky)
    veil = horizon * min(1.0, BRIGHTEST_FOG / horizon.max())
    return Air(
        light.towards_sun,
        sun * hidden,
        zenith,
        horizon,
        ground,
        light.clouds,
        light.lamps,
        CLEAR_PER_M + extinction_per_m,
        veil,
        wet,
        balanced,
    )


def _tables(
    lens: Lens,
    solids: Solids,
    appearance: Appearance,
    air: Air,
    ground: Ground,
    lit: np.ndarray,
    open_sky: np.ndarray,
    pinhole: Pinhole,
) -> ShadingTables:
    """Return the tables that the kernels read, with the light on all faces."""
    shape = (len(solids.corners), 14, 3)
    normals, glow = np.zeros(shape), np.zeros(shape, np.float32)
    light_faces(solids.footprints, solids.corners, appearance.lit, air, normals, glow)
    cells = ground.seen_by(lens, pinhole)
    height, width = lit.shape
    blocks = thread_buffer("sky", (height // BLOCK + 2, width // BLOCK + 2, 3), np.float32)
    heights = np.empty(width)
    if width:
        sky_blocks(lens, air, noise_tile(), blocks)
        skyline(lens, noise_tile(), heights)
    pools, origin = _pools(lens, solids, appearance, air)
    return ShadingTables(
        solids.footprints,
        solids.corners,
        normals,
        glow,
        lit,
        open_sky,
        cells,
        ground.middles,
        noise_tile(),
        pools,
        origin,
        blocks,
        heights,
        _transmittances(),
    )


def _pools(
    lens: Lens, solids: Solids, appearance: Appearance, air: Air
) -> tuple[np.ndarray, Point]:
    """Return the map of the light of lamps ahead of the camera and its corner; empty by day."""
    if not air.lamps:
        return np.empty((0, 0, 2), np.float32), Point(0.0, 0.0)
    ahead = lens.rotation[2, :2] / max(float(np.linalg.norm(lens.rotation[2, :2])), 1e-9)
    x, y = lens.origin[:2] + 0.35 * POOL_SIDE * POOL_M * ahead - 0.5 * POOL_SIDE * POOL_M
    pools = thread_buffer("pools", (POOL_SIDE, POOL_SIDE, 2), np.float32)
    origin = Point(float(x), float(y))
    light_pools(solids, appearance.patterns == LANTERN, appearance.frames, origin, pools)
    return pools, origin


def thread_buffer(name: str, shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """Return this thread's array of that name and shape, with its previous contents."""
    buffers: dict[tuple[object, ...], np.ndarray] = _BUFFERS.__dict__.setdefault("buffers", {})
    key = (name, shape, dtype)
    if key not in buffers:
        buffers[key] = np.zeros(shape, dtype)
    return buffers[key]


@cache
def srgb_table() -> np.ndarray:
    """Return (4096,) uint8 sRGB bytes of linear light in 0 to 1 (IEC 61966-2-1)."""
    linear = np.linspace(0.0, 1.0, SRGB_STEPS)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    table: np.ndarray = np.rint(255 * encoded).astype(np.uint8)
    return table


@cache
def _transmittances() -> np.ndarray:
    return np.exp(-np.linspace(0.0, GREATEST_DEPTH, TRANSMITTANCE_STEPS + 1))
