"""From the nearest surfaces to light."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.core import Pose
from roadscope.core.record import Record
from roadscope.envs.imaging.face_kernels import Lens
from roadscope.envs.imaging.ground import Ground
from roadscope.envs.imaging.lamp_kernels import POOL_M, POOL_SIDE, light_pools
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.looks import looks_of
from roadscope.envs.imaging.noise_kernels import noise_tile
from roadscope.envs.imaging.pattern_kernels import LANTERN, Looks
from roadscope.envs.imaging.pinhole import Pinhole
from roadscope.envs.imaging.raster import FACES, Raster, Solids, lens_of
from roadscope.envs.imaging.shading_kernels import light_faces, shade_all, shade_plainly
from roadscope.envs.imaging.shadow_kernels import cast_shadows, sunlit
from roadscope.envs.imaging.sky_kernels import BLOCK, Air, sky_blocks, skyline
from roadscope.envs.imaging.stage_kernels import FADES, THICKEST, Stage
from roadscope.envs.raycast.scene import Scene

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
        light.towards_sun, sun * hidden, zenith, horizon, ground, light.clouds, light.lamps,
        CLEAR_PER_M + extinction_per_m, veil, wet, balanced,
    )  # fmt: skip


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
        solids.footprints, solids.corners, normals, glow, *shadows, cells, ground.middles,
        noise_tile(), pools, corner, blocks, heights, _fades(),
    )  # fmt: skip


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
