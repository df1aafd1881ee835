"""From linear light to an image: glare, rain, motion blur, vignetting and noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.core import Pose
from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.lighting import BLOCK
from roadscope.envs.imaging.raster import SKY_FACE, Raster, Solids
from roadscope.envs.imaging.shading import thread_buffer
from roadscope.envs.raycast.prism_hits import SPLITMIX_STEP, mix
from roadscope.envs.sensors.camera_spec import METERED_S, CameraSpec

# --------------------------------------------------------------------------------------------------
# Effects of lens and sensor: soft edges, motion blur, glare, vignetting, noise.

MOST_TAPS = 9
"""Most samples along the displacement of a pixel during the exposure."""
FOCAL_BLUR = 0.2
"""Weight of each neighbour of a pixel at an edge, relative to the pixel's own weight of 1."""
LEAST_PX = 0.8
"""Shorter displacements than this are not blurred."""
STRETCH = 32
"""Most pixels along a row that share one displacement."""
SRGB_COEFFICIENTS = (
    np.float32(-0.0422323),
    np.float32(1.5752777),
    np.float32(-1.8995242),
    np.float32(3.8985967),
    np.float32(-5.0034247),
    np.float32(3.4188949),
    np.float32(-0.9477371),
)
"""sRGB's curve as a polynomial in the square root of the light; its error is below 0.04 of 255."""
DRAWS = 1 << 18
"""Number of normal draws; the noise of each row is a random section of them."""


class Shutter(NamedTuple):
    """Motion of the view while the shutter is open.

    active: whether it moves. displacements: (A + 1, 3), metres, camera frame, relative to the
    camera: a row for each actor, and a last row for everything that stands still. turn: (3,)
    radians, camera frame.
    focal, centre: (2,) pixels. rows: (P,) row of `displacements` of each prism.
    """

    active: bool
    displacements: np.ndarray
    turn: np.ndarray
    focal: np.ndarray
    centre: np.ndarray
    rows: np.ndarray


class Sensor(NamedTuple):
    """Properties of the image sensor.

    shot: variance of the noise for each unit of light. read: variance of the noise in the dark.
    vignetting: share of the light that is lost in the corners. centre: (2,) pixels. key: seed of
    the noise. draws: float32, standard normal numbers.
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
    transmitted = np.empty((width, 3), np.float32)
    squares = np.empty((width, 3), np.float32)
    for c in range(width):
        squares[c, :] = (c + 0.5 - u) ** 2
    lost = np.float32(sensor.vignetting / corner)
    for r in range(height):
        base = np.float32(1.0 - lost * (r + 0.5 - v) ** 2)
        _vignette(squares.reshape(-1), base, lost, transmitted.reshape(-1))
        # `line[:] = light[r]` would take Numba seconds to compile.
        for c in range(width):
            line[c, 0], line[c, 1], line[c, 2] = light[r, c, 0], light[r, c, 1], light[r, c, 2]
        _soften_edges(light, faces, r, line)
        if shutter.active:
            _smear_row(light, q[r], faces[r], r, shutter, line)
        if len(glare) > 0:
            _add_glare(glare, r, line)
        start = _noise_start(sensor.key, r, len(sensor.draws) - 3 * width)
        _encode_row(
            line.reshape(-1),
            transmitted.reshape(-1),
            sensor.draws[start : start + 3 * width],
            np.float32(sensor.shot),
            np.float32(sensor.read),
            pixels[r].reshape(-1),
        )


@compiled(borrowing=True)
def _noise_start(key: np.uint64, row: int, places: int) -> int:
    """Return where the noise of a row begins in the draws, below `places`."""
    return int(mix(key + np.uint64(row + 1) * SPLITMIX_STEP) >> np.uint64(2)) % places


@compiled(borrowing=True)
def _vignette(
    squares: np.ndarray, base: np.float32, lost: np.float32, transmitted: np.ndarray
) -> None:
    """Write the share of the light that the lens transmits to each pixel of a row."""
    for n in range(len(squares)):
        transmitted[n] = base - lost * squares[n]


@compiled(borrowing=True)
def _encode_row(
    line: np.ndarray,
    transmitted: np.ndarray,
    draws: np.ndarray,
    shot: np.float32,
    read: np.float32,
    pixels: np.ndarray,
) -> None:
    """Vignette one row of light, add noise, and encode it as sRGB."""
    zero, one = np.float32(0.0), np.float32(1.0)
    c0, c1, c2, c3, c4, c5, c6 = SRGB_COEFFICIENTS
    for n in range(len(line)):
        value = line[n] * transmitted[n]
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
    """Average each pixel at the edge of a face with its four neighbours."""
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
    """Return the displacement of a pixel during the exposure, in pixels.

    q: reciprocal of its depth, 1/m. row: of `displacements`. u, v: its ray is (u, v, 1).
    """
    wx, wy, wz = shutter.turn[0], shutter.turn[1], shutter.turn[2]
    x, y, z = (
        shutter.displacements[row, 0] * q,
        shutter.displacements[row, 1] * q,
        shutter.displacements[row, 2] * q,
    )
    x, y, z = x - (wy - wz * v), y - (wz * u - wx), z - (wx * v - wy * u)
    return shutter.focal[0] * (x - u * z), shutter.focal[1] * (y - v * z)


@compiled(borrowing=True)
def _smear_row(
    light: np.ndarray, q: np.ndarray, faces: np.ndarray, r: int, shutter: Shutter, line: np.ndarray
) -> None:
    """Blur one row, in stretches of one face that share one displacement."""
    width, start = len(q), 0
    v = (r + 0.5 - shutter.centre[1]) / shutter.focal[1]
    while start < width:
        face, end = faces[start], start + 1
        while end < width and end < start + STRETCH and faces[end] == face:
            end += 1
        middle = (start + end) // 2
        u = (middle + 0.5 - shutter.centre[0]) / shutter.focal[0]
        row = shutter.rows[face >> 4] if face >= 0 else len(shutter.displacements) - 1
        dx, dy = flow_at(shutter, q[middle], row, u, v)
        most = max(abs(dx), abs(dy))
        if most >= LEAST_PX:
            _smear(light, r, start, end, dx, dy, min(MOST_TAPS, int(most) + 2), line)
        start = end


@compiled(borrowing=True)
def _smear(
    light: np.ndarray,
    r: int,
    start: int,
    end: int,
    dx: float,
    dy: float,
    taps: int,
    line: np.ndarray,
) -> None:
    """Average the light of a stretch of pixels along their displacement (dx, dy)."""
    height, width = light.shape[:2]
    weight = np.float32(1.0 / taps)
    for c in range(start, end):
        line[c, 0] = line[c, 1] = line[c, 2] = np.float32(0.0)
    for n in range(taps):
        share = (n + 0.5) / taps - 0.5
        i = min(height - 1, max(0, int(np.floor(r + 0.5 + share * dy))))
        shift = int(np.floor(0.5 + share * dx))
        shift = min(width - end, max(-start, shift))
        for c in range(start, end):
            line[c, 0] += weight * light[i, c + shift, 0]
            line[c, 1] += weight * light[i, c + shift, 1]
            line[c, 2] += weight * light[i, c + shift, 2]


@compiled(borrowing=True)
def _add_glare(glare: np.ndarray, r: int, line: np.ndarray) -> None:
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
def depths_and_owners(
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


# --------------------------------------------------------------------------------------------------
# Stray light in lens and air: halos of lamps, the veil of the sun, streaks of rain.

HALO = 0.10
"""Scale of the weights of a halo; chosen by hand."""
BRIGHT = 0.9
"""Pixels with a colour above this have a halo; 1 is white."""
REACH = 9
"""Radius of a halo in blocks."""
DROPS = 60.0
"""Streaks at 1 mm/h in a view whose area is a third of the square of the focal length."""
FALL_M_S = 6.5
DROP_M = 0.0016
"""Speed and diameter of the drops."""


@compiled()
def halo_weights() -> np.ndarray:
    """Return (19, 19) float64 weights: how much of a bright block's light each neighbour gets."""
    weights = np.empty((2 * REACH + 1, 2 * REACH + 1))
    for di in range(-REACH, REACH + 1):
        for dj in range(-REACH, REACH + 1):
            square = di * di + dj * dj
            weight = HALO * (np.exp(-square / 2.5) + 1.2 / (square + 8.0))
            weights[di + REACH, dj + REACH] = weight * max(0.0, 1.0 - square / 90.0)
    return weights


@compiled(borrowing=True)
def bloom(light: np.ndarray, weights: np.ndarray, bright: np.ndarray, glare: np.ndarray) -> None:
    """Add the light of bright pixels to glare: averaged by blocks, spread over their neighbours.

    weights: of `halo_weights`. bright: scratch array of the shape of glare.
    """
    height, width = light.shape[:2]
    bright[:] = 0.0
    for r in range(height):
        for c in range(width):
            if max(light[r, c, 0], max(light[r, c, 1], light[r, c, 2])) > BRIGHT:
                for k in range(3):
                    bright[r // BLOCK, c // BLOCK, k] += light[r, c, k] / (BLOCK * BLOCK)
    rows, columns = bright.shape[:2]
    for i in range(rows):
        for j in range(columns):
            if bright[i, j, 0] + bright[i, j, 1] + bright[i, j, 2] > 0.0:
                for y in range(max(0, i - REACH), min(rows, i + REACH + 1)):
                    for x in range(max(0, j - REACH), min(columns, j + REACH + 1)):
                        weight = weights[y - i + REACH, x - j + REACH]
                        for k in range(3):
                            glare[y, x, k] += weight * bright[i, j, k]


@compiled(borrowing=True)
def spread_sun(
    light: np.ndarray,
    faces: np.ndarray,
    sun: np.ndarray,
    strength: np.ndarray,
    focal: np.ndarray,
    centre: np.ndarray,
    glare: np.ndarray,
) -> None:
    """Add the veil of the sun over the image, which falls with the square of the angle.

    sun: (3,) direction in the camera's frame. Draws the disc of the sun into light, and dims the
    veil by the share of the disc that something hides; outside the image it counts as visible.
    """
    height, width = faces.shape
    u, v = focal[0] * sun[0] / sun[2] + centre[0], focal[1] * sun[1] / sun[2] + centre[1]
    radius = 0.0075 * focal[0]
    visible, total = 0, 0
    for r in range(int(max(0.0, v - radius)), int(min(1.0 * height, v + radius + 1.0))):
        for c in range(int(max(0.0, u - radius)), int(min(1.0 * width, u + radius + 1.0))):
            away = np.sqrt((r + 0.5 - v) ** 2 + (c + 0.5 - u) ** 2)
            if away > radius:
                continue
            total += 1
            if faces[r, c] == SKY_FACE:
                visible += 1
                edge = min(1.0, 0.5 * (radius - away))
                for k in range(3):
                    light[r, c, k] += 12.0 * edge * strength[k]
    share = 1.0 if total == 0 else visible / total
    for i in range(glare.shape[0]):
        for j in range(glare.shape[1]):
            x = (j * BLOCK - centre[0]) / focal[0]
            y = (i * BLOCK - centre[1]) / focal[1]
            cosine = (x * sun[0] + y * sun[1] + sun[2]) / np.sqrt(1.0 + x * x + y * y)
            square = 2.0 * (1.0 - min(1.0, cosine))
            veil = share * (0.0035 / (square + 0.0012) + 0.06 * max(0.0, cosine) ** 4)
            for k in range(3):
                glare[i, j, k] += veil * strength[k]


@compiled(borrowing=True)
def rain_streaks(
    light: np.ndarray,
    q: np.ndarray,
    above: np.ndarray,
    focal: float,
    exposure_s: float,
    rate_mm_h: float,
    key: np.uint64,
) -> None:
    """Draw drops as streaks, as long as they fall during the exposure and as bright as the sky.

    They lie between camera and scene, 0.6 to 12 m away; the number grows as rate ** 0.63, as the
    extinction does. above: (3,) light of the sky.
    """
    height, width = q.shape
    count = int(DROPS * rate_mm_h**0.63 * (width / focal) * (height / focal) * 3.0)
    state = key | np.uint64(1)
    for _ in range(count):
        state = _next(state)
        x = width * _share(state)
        state = _next(state)
        y = height * (1.2 * _share(state) - 0.1)
        state = _next(state)
        depth = 0.6 + 11.4 * np.sqrt(_share(state))
        length = max(2.0, focal * FALL_M_S * exposure_s / depth)
        wide = focal * DROP_M / depth
        cover = min(0.5, 0.3 * wide)
        for n in range(int(length) + 1):
            r, c = int(y + n), int(x - 0.06 * n)
            if 0 <= r < height and 0 <= c < width and q[r, c] * depth < 1.0:
                fade = cover * min(1.0, 2.5 * min(n + 1.0, length - n) / length)
                for k in range(3):
                    light[r, c, k] += max(0.0, fade) * (1.15 * above[k] - light[r, c, k])


@compiled(forceinline=True, borrowing=True)
def _next(state: np.uint64) -> np.uint64:
    """Return the next state of a 64-bit xorshift generator (Marsaglia 2003)."""
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    state ^= state << np.uint64(17)
    return state


@compiled(forceinline=True, borrowing=True)
def _share(state: np.uint64) -> float:
    """Return a number from 0 to 1 of the generator's state."""
    value: float = np.float64(state >> np.uint64(11)) * 2.0**-53
    return value


# --------------------------------------------------------------------------------------------------
# The whole exposure.


@dataclass(frozen=True, slots=True, eq=False)
class CameraMotion(Record):
    """Motion of camera and actors during the exposure, world frame.

    camera: (3,) velocity, m/s. turning: (3,) angular velocity of the camera, rad/s. actors: (A, 2)
    velocities, m/s.
    """

    camera: np.ndarray
    turning: np.ndarray
    actors: np.ndarray


def exposed(
    light: np.ndarray,
    raster: Raster,
    solids: Solids,
    spec: CameraSpec,
    lighting: Light,
    *,
    world_from_camera: Pose,
    stamp_s: float,
    noise_seed: int = 0,
    rain_mm_h: float = 0.0,
    extinction_per_m: float = 0.0,
    motion: CameraMotion | None = None,
) -> np.ndarray:
    """Return (H, W, 3) uint8 sRGB pixels of light (H, W, 3); rain is drawn into the light."""
    nanoseconds = int(np.rint(stamp_s * 1e9)) % 2**64
    key, drops = np.random.SeedSequence([noise_seed, nanoseconds]).generate_state(2, np.uint64)
    centre = np.array(spec.pinhole.centre_px, np.float64)
    if rain_mm_h > 0.0:
        rain_streaks(
            light,
            raster.q,
            light[0, ::16].mean(axis=0),
            spec.pinhole.focal_px[0],
            spec.exposure_s,
            rain_mm_h,
            drops,
        )
    iso = lighting.iso * METERED_S / spec.exposure_s
    pixels = np.empty(light.shape, np.uint8)
    develop(
        light,
        raster.q,
        raster.faces,
        shutter_of(spec, world_from_camera, motion, solids),
        _glare(light, raster, spec, lighting, world_from_camera, extinction_per_m),
        Sensor(*noise_of(spec, iso), spec.vignetting, centre, key, _draws()),
        pixels,
    )
    return pixels


def noise_of(spec: CameraSpec, iso: float) -> tuple[float, float]:
    """Return the variances of shot noise, per unit of light, and of read noise."""
    return iso / spec.full_well, (iso * spec.read_noise / spec.full_well) ** 2


def shutter_of(
    spec: CameraSpec, world_from_camera: Pose, motion: CameraMotion | None, solids: Solids
) -> Shutter:
    """Return the motion of the view during an exposure."""
    focal, centre = np.array(spec.pinhole.focal_px), np.array(spec.pinhole.centre_px)
    if motion is None:
        none = np.zeros((1, 3))
        return Shutter(False, none, np.zeros(3), focal, centre, np.zeros(1, np.int64))
    actors = len(motion.actors)
    speeds = np.zeros((actors + 1, 3))
    speeds[:-1, :2] = motion.actors
    rotation = world_from_camera.rotation
    displacements = (speeds - motion.camera) @ rotation * spec.exposure_s
    turn = motion.turning @ rotation * spec.exposure_s
    rows = np.where(solids.owners >= 0, solids.owners, actors).astype(np.int64)
    return Shutter(True, displacements, turn, focal, centre, rows)


def _glare(
    light: np.ndarray,
    raster: Raster,
    spec: CameraSpec,
    lighting: Light,
    world_from_camera: Pose,
    extinction_per_m: float,
) -> np.ndarray:
    """Return the stray light of bright spots and of the sun, at the corners of blocks."""
    height, width = raster.q.shape
    sun = world_from_camera.rotation.T @ lighting.towards_sun
    strength = lighting.gain * np.array(lighting.sun) * np.exp(-2000.0 * extinction_per_m)
    strength = strength * max(0.0, 1.0 - lighting.clouds) * (not _night(lighting))
    dazzling = sun[2] > 0.3 and strength.max() > 0.02
    if not (lighting.lamps or dazzling):
        return np.empty((0, 0, 3), np.float32)
    glare = thread_buffer("glare", (height // BLOCK + 2, width // BLOCK + 2, 3), np.float32)
    glare[:] = 0.0
    if lighting.lamps:
        bloom(light, _halo(), thread_buffer("bloom", glare.shape, np.float32), glare)
    if dazzling:
        focal, centre = np.array(spec.pinhole.focal_px), np.array(spec.pinhole.centre_px)
        spread_sun(light, raster.faces, sun, strength, focal, centre, glare)
    if lighting.flare != 1.0:
        glare *= np.float32(lighting.flare)
    return glare


def _night(lighting: Light) -> bool:
    return max(lighting.sun) < 0.02


@cache
def _halo() -> np.ndarray:
    weights: np.ndarray = halo_weights()
    return weights


@cache
def _draws() -> np.ndarray:
    """Return (DRAWS,) float32 normal draws of mean 0 and variance 1."""
    draws: np.ndarray = np.random.default_rng(11).standard_normal(DRAWS, np.float32)
    return draws
