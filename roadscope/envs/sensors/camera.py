"""One exposure of a camera in a moving scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose
from roadscope.core.image import CameraImage
from roadscope.core.record import Record
from roadscope.envs.imaging.ground import Ground
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.raster import FACES, Raster, Solids, rasterise, solids_of
from roadscope.envs.imaging.shading import curve, shade
from roadscope.envs.raycast.cast import GROUND, NOTHING
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.camera_spec import CameraSpec
from roadscope.envs.sensors.exposure_kernels import develop


@dataclass(frozen=True, slots=True, eq=False)
class ImageTruth(Record):
    """What is in an image.

    depth: (H, W) float32, metres along the optical axis, 0 in the sky.
    owners: (H, W) int32, the actor's row, `GROUND`, -2 and below for scenery, `NOTHING` for sky.
    visible_pixels: (A,) int64. boxes: (A, 4) float64, left top right bottom, of the whole actor,
        seen or hidden, as far as it is inside the image.
    occluded_fraction: (A,) float64, share of the actor's outline in the image that something
        else hides; 1 when it has none.
    """

    depth: np.ndarray
    owners: np.ndarray
    visible_pixels: np.ndarray
    boxes: np.ndarray
    occluded_fraction: np.ndarray


def expose(
    scene: Scene,
    spec: CameraSpec,
    world_from_camera: Pose,
    stamp_s: float,
    *,
    ground: Ground,
    light: Light,
    categories: np.ndarray,
    sensor: str = "camera",
    noise_seed: int = 0,
    extinction_per_m: float = 0.0,
) -> tuple[CameraImage, ImageTruth]:
    """Take one image at the stamp, the middle of the exposure.

    categories: (A,) of the actors. Noise depends on seed and stamp alone.
    """
    solids = solids_of(scene, stamp_s)
    raster = rasterise(
        scene, spec.pinhole, world_from_camera, stamp_s, outlines=True, solids=solids
    )
    pixels = shade(
        raster, scene, solids, spec.pinhole, world_from_camera, stamp_s=stamp_s, ground=ground,
        light=light, categories=categories, extinction_per_m=extinction_per_m,
    )  # fmt: skip
    _develop(pixels, spec, noise_seed, stamp_s)
    image = CameraImage(pixels, spec.pinhole.intrinsics, stamp_s, sensor)
    return image, image_truth(raster, solids, len(scene.present))


def image_truth(raster: Raster, solids: Solids, actors: int) -> ImageTruth:
    """Say what every pixel shows."""
    with np.errstate(divide="ignore"):
        depth = np.where(raster.q > 0, 1 / raster.q, 0).astype(np.float32)
    # Faces -2 and -1 index the two entries at the end.
    table = np.concatenate([np.repeat(solids.owners, FACES), [NOTHING, GROUND]]).astype(np.int32)
    owners = table[raster.faces]
    visible = np.bincount(owners[owners >= 0], minlength=actors)
    hidden = 1 - visible / np.maximum(raster.outline_pixels, 1)
    return ImageTruth(depth, owners, visible, raster.boxes, np.clip(hidden, 0.0, 1.0))


def _develop(pixels: np.ndarray, spec: CameraSpec, noise_seed: int, stamp_s: float) -> None:
    nanoseconds = int(np.rint(stamp_s * 1e9)) % 2**64
    key = np.random.SeedSequence([noise_seed, nanoseconds]).generate_state(1, np.uint64)[0]
    u, v = spec.pinhole.centre_px
    develop(
        pixels, _light_of_bytes(), curve(), np.array([spec.vignetting, u, v]),
        np.array([spec.full_well, spec.read_noise]), key,
    )  # fmt: skip


def _light_of_bytes() -> np.ndarray:
    """(256,) linear light of sRGB bytes (IEC 61966-2-1)."""
    encoded = np.arange(256) / 255
    linear: np.ndarray = np.where(
        encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4
    )
    return linear
