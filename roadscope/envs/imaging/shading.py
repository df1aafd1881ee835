"""From the nearest surfaces to colours."""

from __future__ import annotations

import numpy as np

from roadscope.core import Pose
from roadscope.envs.imaging.ground import Ground
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.pattern_kernels import Looks
from roadscope.envs.imaging.pinhole import Pinhole
from roadscope.envs.imaging.raster import Raster, Solids, lens_of
from roadscope.envs.imaging.shading_kernels import CURVE, Air, face_normals, shade_all
from roadscope.envs.imaging.shadow_kernels import cast_shadows, sunlit
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.world.materials import MATERIALS

_COLOURS = np.array([m.colour for m in MATERIALS])
_PATTERNS = np.array([int(m.pattern) for m in MATERIALS])
_GLOSS = np.array([m.gloss for m in MATERIALS])


def shade(
    raster: Raster,
    scene: Scene,
    solids: Solids,
    pinhole: Pinhole,
    world_from_camera: Pose,
    *,
    stamp_s: float,
    ground: Ground,
    light: Light,
    categories: np.ndarray,
    extinction_per_m: float = 0.0,
) -> np.ndarray:
    """Return (H, W, 3) uint8 sRGB pixels of what the raster saw."""
    lens = lens_of(pinhole, world_from_camera)
    towards = light.towards_sun
    lit, open_sky = np.empty((2, *raster.faces.shape), np.uint8)
    looks = looks_of(scene, solids, stamp_s, categories)
    cast_shadows(lens, solids, raster.faces, towards, lit, open_sky)
    sunlit(solids, towards, lens, looks.lit)
    normals = np.empty((len(solids.corners), 14, 3))
    face_normals(solids.footprints, solids.corners, normals)
    pixels = np.empty((*raster.faces.shape, 3), np.uint8)
    air = Air(
        towards, np.array(light.sun), np.array(light.zenith), np.array(light.horizon),
        np.array(light.ground), light.clouds, light.lamps, extinction_per_m,
        np.array(light.horizon), light.gain,
    )  # fmt: skip
    cells = ground.around(world_from_camera.translation[:2])
    shade_all(
        lens, raster.q, raster.faces, lit, open_sky, normals, looks, cells, air, curve(), pixels
    )  # fmt: skip
    return pixels


def curve() -> np.ndarray:
    """(4096,) uint8, sRGB bytes of linear light in 0 to 1 (IEC 61966-2-1)."""
    linear = np.linspace(0.0, 1.0, CURVE)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    table: np.ndarray = np.rint(255 * encoded).astype(np.uint8)
    return table


def looks_of(scene: Scene, solids: Solids, stamp_s: float, categories: np.ndarray) -> Looks:
    """Find colour, pattern and frame of every prism."""
    static, moving = scene.static, scene.moving
    rows = np.concatenate([static.materials, moving.materials]).astype(np.int64)
    yaws = scene.poses_at(np.array([stamp_s]))[0][moving.owners, 2]
    headings = np.concatenate([static.headings, moving.headings + yaws])
    kinds = np.concatenate([np.full(len(static), -1.0), categories[moving.owners]])
    frames, seeds = _frames(solids, headings, kinds)
    return Looks(_COLOURS[rows], _PATTERNS[rows], _GLOSS[rows], frames, np.ones(len(rows)), seeds)


def _frames(
    solids: Solids, headings: np.ndarray, kinds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(P, 8) frames of the things that prisms belong to, and (P,) a number in 0 to 1 each."""
    if len(headings) == 0:
        return np.empty((0, 8)), np.empty(0)
    owners, things = np.unique(solids.owners, return_inverse=True)
    cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x, y = solids.footprints[..., 0], solids.footprints[..., 1]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    lows, highs = np.full((2, len(owners)), np.inf), np.full((3, len(owners)), -np.inf)
    for i, values in enumerate((along, across)):
        np.minimum.at(lows[i], things, values.min(axis=1))
        np.maximum.at(highs[i], things, values.max(axis=1))
    np.maximum.at(highs[2], things, solids.tops)
    u, v = ((lows + highs[:2]) / 2)[:, things]
    half = ((highs[:2] - lows) / 2)[:, things]
    c, s = cosine[:, 0], sine[:, 0]
    seeds = (owners.astype(np.int64) * 2654435761 % 2**32 / 2**32)[things]
    return np.column_stack(
        [u * c - v * s, u * s + v * c, c, s, *half, highs[2][things], kinds]
    ), seeds
