"""From light to an image: glare, rain, motion blur, vignetting and noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.core import Pose
from roadscope.core.record import Record
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.lighting import BLOCK
from roadscope.envs.imaging.raster import Raster, Solids
from roadscope.envs.imaging.shading import room
from roadscope.envs.sensors.camera_spec import METERED_S, CameraSpec
from roadscope.envs.sensors.exposure_kernels import DRAWS, Sensor, Shutter, develop
from roadscope.envs.sensors.glare_kernels import bloom, halo_weights, rain_streaks, spread_sun


@dataclass(frozen=True, slots=True, eq=False)
class Motion(Record):
    """How camera and actors move while the shutter is open, world frame.

    camera: (3,) m/s. turning: (3,) rad/s. actors: (A, 2) m/s.
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
    motion: Motion | None = None,
) -> np.ndarray:
    """Return (H, W, 3) uint8 sRGB pixels of light (H, W, 3), which rain is drawn into."""
    nanoseconds = int(np.rint(stamp_s * 1e9)) % 2**64
    key, drops = np.random.SeedSequence([noise_seed, nanoseconds]).generate_state(2, np.uint64)
    centre = np.array(spec.pinhole.centre_px, np.float64)
    if rain_mm_h > 0.0:
        rain_streaks(
            light, raster.q, light[0, ::16].mean(axis=0), spec.pinhole.focal_px[0],
            spec.exposure_s, rain_mm_h, drops,
        )  # fmt: skip
    iso = lighting.iso * METERED_S / spec.exposure_s
    pixels = np.empty(light.shape, np.uint8)
    develop(
        light, raster.q, raster.faces, shutter_of(spec, world_from_camera, motion, solids),
        _glare(light, raster, spec, lighting, world_from_camera, extinction_per_m),
        Sensor(*noise_of(spec, iso), spec.vignetting, centre, key, _draws()),
        pixels,
    )  # fmt: skip
    return pixels


def noise_of(spec: CameraSpec, iso: float) -> tuple[float, float]:
    """Variance of the noise: per light, by the count of electrons, and of reading in the dark."""
    return iso / spec.full_well, (iso * spec.read_noise / spec.full_well) ** 2


def shutter_of(
    spec: CameraSpec, world_from_camera: Pose, motion: Motion | None, solids: Solids
) -> Shutter:
    """Say how the view moves during an exposure."""
    focal, centre = np.array(spec.pinhole.focal_px), np.array(spec.pinhole.centre_px)
    if motion is None:
        none = np.zeros((1, 3))
        return Shutter(False, none, np.zeros(3), focal, centre, np.zeros(1, np.int64))
    actors = len(motion.actors)
    speeds = np.zeros((actors + 1, 3))
    speeds[:-1, :2] = motion.actors
    rotation = world_from_camera.rotation
    ways = (speeds - motion.camera) @ rotation * spec.exposure_s
    turn = motion.turning @ rotation * spec.exposure_s
    rows = np.where(solids.owners >= 0, solids.owners, actors).astype(np.int64)
    return Shutter(True, ways, turn, focal, centre, rows)


def _glare(
    light: np.ndarray,
    raster: Raster,
    spec: CameraSpec,
    lighting: Light,
    world_from_camera: Pose,
    extinction_per_m: float,
) -> np.ndarray:
    """Light that bright spots and the sun spread over the image, at the corners of blocks."""
    height, width = raster.q.shape
    sun = world_from_camera.rotation.T @ lighting.towards_sun
    strength = lighting.gain * np.array(lighting.sun) * np.exp(-2000.0 * extinction_per_m)
    strength = strength * max(0.0, 1.0 - lighting.clouds) * (not _night(lighting))
    dazzling = sun[2] > 0.3 and strength.max() > 0.02
    if not (lighting.lamps or dazzling):
        return np.empty((0, 0, 3), np.float32)
    glare = room("glare", (height // BLOCK + 2, width // BLOCK + 2, 3), np.float32)
    glare[:] = 0.0
    if lighting.lamps:
        bloom(light, _halo(), room("bloom", glare.shape, np.float32), glare)
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
    """(DRAWS,) float32 normal draws of mean 0 and variance 1."""
    draws: np.ndarray = np.random.default_rng(11).standard_normal(DRAWS, np.float32)
    return draws
