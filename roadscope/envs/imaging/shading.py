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
    FADES,
    POOL_M,
    POOL_SIDE,
    THICKEST,
    Air,
    Stage,
    cast_shadows,
    light_pools,
    own_beam,
    pools_at,
    share_passed,
    sky_blocks,
    skyline,
    sunlit,
)
from roadscope.envs.imaging.noise import noise_tile
from roadscope.envs.imaging.patterns import (
    GLASS,
    LANTERN,
    METAL,
    PLAIN,
    SIGN,
    Looks,
    looks_of,
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
    Raster,
    Solids,
    lens_of,
)
from roadscope.envs.imaging.vehicle_patterns import slanted
from roadscope.envs.raycast.scene import Scene

# --------------------------------------------------------------------------------------------------
# From what every pixel shows to the light that comes from there, run by run of one face.

Vector = tuple[float, float, float]


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
    out, bench = np.empty(7), np.empty((11, CHUNK), np.float32)
    line = np.empty((stage.blocks.shape[1], 3), np.float32)
    for row in range(len(q)):
        shade_row(lens, q[row], faces[row], row, looks, stage, air, (out, line, bench), light[row])


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
    """Shade one row of pixels; places (7,), (W / 8 + 2, 3) and (11, CHUNK) to work in."""
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
                ground_run(lens, q, row, first, last, stage, air, bench, light)
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
        # The three colours in one loop: none waits for another's sum.
        share = np.float32(1.0 / BLOCK)
        red_step, green_step = (
            (line[j + 1, 0] - line[j, 0]) * share,
            (line[j + 1, 1] - line[j, 1]) * share,
        )
        blue_step = (line[j + 1, 2] - line[j, 2]) * share
        way = np.float32(first + 0.5 - j * BLOCK)
        red, green, blue = (
            line[j, 0] + way * red_step,
            line[j, 1] + way * green_step,
            line[j, 2] + way * blue_step,
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
    dv = (row + 0.5 - lens.centre[1]) / lens.focal[1]
    x0, y0 = r[1, 0] * dv + r[2, 0], r[1, 1] * dv + r[2, 1]
    z0 = r[1, 2] * dv + r[2, 2]
    here = ahead = step = (0.0, 0.0)
    slope = 1.0 / lens.focal[0]
    if air.lamps:
        ahead = _lamps_on(lens, looks, stage, m, normal, _place_of(lens, q, start, (x0, y0, z0)))
    for c in range(start, end):
        du, depth = (c + 0.5 - lens.centre[0]) * slope, 1.0 / q[c]
        vx, vy, vz = x0 + r[0, 0] * du, y0 + r[0, 1] * du, z0 + r[0, 2] * du
        place = (
            lens.origin[0] + depth * vx,
            lens.origin[1] + depth * vy,
            lens.origin[2] + depth * vz,
        )
        if looks.patterns[m] == PLAIN:
            _plain(looks, m, out)
        else:
            paint(looks, stage.noise, m, edge, normal, place, air.lamps, out)
        size = np.sqrt(1.0 + du * du + dv * dv)
        if out[3] > 0.0:
            turned = _leaning(looks, m, normal, place, out[3])
            short = 1.0 / size
            _glossy(stage, air, m, side, turned, (vx * short, vy * short, vz * short), out)
        else:
            _matt(stage, m, side, out)
        if air.lamps:
            along = (c - start) % LAMP_STEP
            if along == 0:
                last = min(end - 1, c + LAMP_STEP)
                there = _place_of(lens, q, last, (x0, y0, z0))
                here, ahead = ahead, _lamps_on(lens, looks, stage, m, normal, there)
                share = 1.0 / max(1, last - c)
                step = (share * (ahead[0] - here[0]), share * (ahead[1] - here[1]))
            _lamplit(here[0] + along * step[0], here[1] + along * step[1], out)
        if air.extinction * depth > 0.004:
            _haze(stage, air, air.extinction * depth * size, out)
        light[c, 0], light[c, 1], light[c, 2] = out[4], out[5], out[6]


@compiled(forceinline=True, borrowing=True)
def _plain(looks: Looks, m: int, out: np.ndarray) -> None:
    out[0], out[1], out[2] = looks.colours[m, 0], looks.colours[m, 1], looks.colours[m, 2]
    out[3], out[4], out[5], out[6] = looks.gloss[m], 0.0, 0.0, 0.0


@compiled(forceinline=True, borrowing=True)
def _leaning(looks: Looks, m: int, normal: Vector, place: Vector, gloss: float) -> Vector:
    """Return the normal of a surface; panes lean."""
    if looks.patterns[m] == GLASS and gloss > 0.05:
        return slanted(looks.frames[m], normal, place[0], place[1])
    return normal


@compiled(forceinline=True, borrowing=True)
def _matt(stage: Stage, m: int, side: int, out: np.ndarray) -> None:
    """Add to the own light in out[4:] what a surface without gloss throws back."""
    out[4] += out[0] * stage.glow[m, side, 0]
    out[5] += out[1] * stage.glow[m, side, 1]
    out[6] += out[2] * stage.glow[m, side, 2]


@compiled(forceinline=True, borrowing=True)
def _lamplit(warm: float, white: float, out: np.ndarray) -> None:
    """Add what a surface throws back of street lamps and of headlights."""
    out[4] += out[0] * (warm + white)
    out[5] += out[1] * (0.72 * warm + 0.95 * white)
    out[6] += out[2] * (0.42 * warm + 0.85 * white)


@compiled(forceinline=True, borrowing=True)
def _haze(stage: Stage, air: Air, thickness: float, out: np.ndarray) -> None:
    """Let the air take light and give its own; thickness: optical depth."""
    clear = share_passed(stage.fades, thickness)
    for k in range(3):
        out[4 + k] = air.veil[k] + clear * (out[4 + k] - air.veil[k])


@compiled(forceinline=True, borrowing=True)
def _edge(stage: Stage, m: int, side: int) -> Vector:
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
    normal: Vector,
    view: Vector,
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
def _lamps_on(
    lens: Lens,
    looks: Looks,
    stage: Stage,
    m: int,
    normal: Vector,
    place: Vector,
) -> tuple[float, float]:
    """Light of street lamps and of headlights on a surface.

    Sheeting of signs throws headlights back to them.
    """
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
    lanterns, headlights = pools_at(stage.pools, stage.corner, place[0], place[1])
    white += 0.4 * headlights * max(0.0, 1.0 - 0.6 * place[2])
    warm = 0.55 * lanterns
    warm *= max(0.1, 1.0 - place[2] / 8.0) if looks.patterns[m] != METAL else 0.5
    return warm, white


@compiled(forceinline=True, borrowing=True)
def _place_of(lens: Lens, q: np.ndarray, c: int, ray: Vector) -> Vector:
    """Place of the surface behind a pixel of a row; ray: of the row, at the optical centre."""
    r = lens.rotation
    du, depth = (c + 0.5 - lens.centre[0]) / lens.focal[0], 1.0 / q[c]
    return (
        lens.origin[0] + depth * (ray[0] + r[0, 0] * du),
        lens.origin[1] + depth * (ray[1] + r[0, 1] * du),
        lens.origin[2] + depth * (ray[2] + r[0, 2] * du),
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
                fallen = up * air.sky[k] + (1.0 - up) * air.ground[k]
                glow[m, side, k] = sun * air.sun[k] + fallen


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
                    plain_ground(lens, q[row], x0, y0, ax, ay, first, last, stage, pixels[row])
            else:
                colour = sky if face == SKY_FACE else flat[face]
                red, green, blue = colour[0], colour[1], colour[2]
                for c in range(start, end):
                    pixels[row, c, 0], pixels[row, c, 1], pixels[row, c, 2] = red, green, blue
            start = end


# --------------------------------------------------------------------------------------------------
# From the nearest surfaces to light.

CLEAR_PER_M = 1.2e-4
"""Extinction of clear air: a visibility of 33 km."""
BALANCE = 0.5
BRIGHTEST_FOG = 0.75
"""The exposure keeps fog below white."""
CURVE = 4096
"""Steps of the table from linear light to bytes."""
_ROOM = threading.local()


@dataclass(frozen=True, slots=True, eq=False)
class Sight(Record):
    """What a camera looks at, and from where, at one instant.

    raster: of the solids, seen from world_from_camera through the pinhole. solids: of the scene
    at the stamp. categories: (A,) of the actors.
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
        """The camera in the world."""
        return lens_of(self.pinhole, self.world_from_camera)

    @property
    def looks(self) -> Looks:
        """How the solids look."""
        return looks_of(self.scene, self.solids, self.stamp_s, self.categories)


def shade(
    sight: Sight, ground: Ground, light: Light, *, extinction_per_m: float = 0.0, wet: float = 0.0
) -> np.ndarray:
    """Return (H, W, 3) float32 linear light of what is in sight; 1 is white.

    The next call of the same thread with the same size writes into the same array.
    wet: 0 to 1, how wet the ground is.
    """
    lens, air = sight.lens, air_of(light, extinction_per_m, wet)
    raster, solids, looks = sight.raster, sight.solids, sight.looks
    lit, open_sky = room("shadows", (2, *raster.faces.shape), np.uint8)
    cast_shadows(lens, solids, raster.faces, air.towards, lit, open_sky)
    sunlit(solids, air.towards, lens, looks.lit)
    stage = _stage(lens, solids, looks, air, ground, (lit, open_sky))
    shone = room("light", (*raster.faces.shape, 3), np.float32)
    shade_all(lens, raster.q, raster.faces, looks, stage, air, shone)
    return shone


def shade_plain(sight: Sight, ground: Ground, light: Light) -> np.ndarray:
    """Return (H, W, 3) uint8 pixels: one colour a face, no shadows, textures or weather."""
    lens, air = sight.lens, air_of(light, 0.0, 0.0)
    raster, solids, looks = sight.raster, sight.solids, sight.looks
    none = np.empty((0, 0), np.uint8)
    stage = _stage(lens, solids, looks, air, ground, (none, none))
    faces = np.zeros((len(solids.corners), FACES, 3), np.float32)
    faces[:, : stage.glow.shape[1]] = stage.glow * looks.colours[:, None]
    steps = (np.clip(faces, 0.0, 1.0) * (CURVE - 1)).astype(np.int64)
    sky = (np.clip(air.horizon, 0.0, 1.0) * (CURVE - 1)).astype(np.int64)
    pixels = np.empty((*raster.faces.shape, 3), np.uint8)
    shade_plainly(
        lens, raster.q, raster.faces, curve()[steps].reshape(-1, 3), stage, curve()[sky], pixels
    )
    return pixels


def air_of(light: Light, extinction_per_m: float, wet: float) -> Air:
    """Join light and air; fog is as bright as the horizon."""
    sun, zenith, horizon, ground = (
        light.gain * np.array(c) for c in (light.sun, light.zenith, light.horizon, light.ground)
    )
    # Fog and rain hide the sun from the ground as from the camera.
    hidden = float(np.exp(-150.0 * extinction_per_m))
    zenith = zenith + 0.5 * (1.0 - hidden) * (horizon - zenith)
    open_sky = 0.45 * zenith + 0.55 * horizon
    # The camera's white balance takes out part of the blue of the sky.
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


def _stage(
    lens: Lens,
    solids: Solids,
    looks: Looks,
    air: Air,
    ground: Ground,
    shadows: tuple[np.ndarray, np.ndarray],
) -> Stage:
    """Light the faces and make the tables that the kernels read."""
    shape = (len(solids.corners), 14, 3)
    normals, glow = np.zeros(shape), np.zeros(shape, np.float32)
    light_faces(solids.footprints, solids.corners, looks.lit, air, normals, glow)
    ahead = lens.rotation[2, :2]
    cells = ground.around(lens.origin[:2], ahead)
    height, width = shadows[0].shape
    blocks = room("sky", (height // BLOCK + 2, width // BLOCK + 2, 3), np.float32)
    heights = np.empty(width)
    if width:
        sky_blocks(lens, air, noise_tile(), blocks)
        skyline(lens, noise_tile(), heights)
    pools, corner = _pools(lens, solids, looks, air)
    return Stage(
        solids.footprints,
        solids.corners,
        normals,
        glow,
        *shadows,
        cells,
        ground.middles,
        noise_tile(),
        pools,
        corner,
        blocks,
        heights,
        _fades(),
    )


def _pools(
    lens: Lens, solids: Solids, looks: Looks, air: Air
) -> tuple[np.ndarray, tuple[float, float]]:
    """Map the light of lamps around a place ahead of the camera; nothing by day."""
    if not air.lamps:
        return np.empty((0, 0, 2), np.float32), (0.0, 0.0)
    ahead = lens.rotation[2, :2] / max(float(np.linalg.norm(lens.rotation[2, :2])), 1e-9)
    x, y = lens.origin[:2] + 0.35 * POOL_SIDE * POOL_M * ahead - 0.5 * POOL_SIDE * POOL_M
    pools = room("pools", (POOL_SIDE, POOL_SIDE, 2), np.float32)
    corner = (float(x), float(y))
    light_pools(solids, looks.patterns == LANTERN, looks.frames, corner, pools)
    return pools, corner


def room(name: str, shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """Return this thread's array of that name and shape, with whatever it held before."""
    held: dict[tuple[object, ...], np.ndarray] = _ROOM.__dict__.setdefault("held", {})
    key = (name, shape, dtype)
    if key not in held:
        held[key] = np.zeros(shape, dtype)
    return held[key]


@cache
def curve() -> np.ndarray:
    """(4096,) uint8, sRGB bytes of linear light in 0 to 1 (IEC 61966-2-1)."""
    linear = np.linspace(0.0, 1.0, CURVE)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    table: np.ndarray = np.rint(255 * encoded).astype(np.uint8)
    return table


@cache
def _fades() -> np.ndarray:
    return np.exp(-np.linspace(0.0, THICKEST, FADES + 1))
