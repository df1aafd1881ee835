"""One exposure of a camera in a moving scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose
from roadscope.core.image import CameraImage
from roadscope.core.record import Record
from roadscope.envs.imaging.ground import Ground
from roadscope.envs.imaging.light import Light
from roadscope.envs.imaging.raster import FACES, Raster, Solids, rasterise, solids_of
from roadscope.envs.imaging.shading import CameraView, shade, shade_plain
from roadscope.envs.raycast.casting import GROUND, NOTHING
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.camera_spec import CameraSpec
from roadscope.envs.sensors.exposure import CameraMotion, count_visible, depths_and_owners, exposed
from roadscope.envs.sensors.rig import CameraMount
from roadscope.envs.traffic.timeline import Timeline

# --------------------------------------------------------------------------------------------------
# Motion of camera and actors while the shutter is open.


def motion_during(
    timeline: Timeline,
    mount: CameraMount,
    stamp_s: float,
    world_from_ego: Callable[[float], Pose] | None = None,
) -> CameraMotion:
    """Return the mean motion over the exposure whose middle is the stamp.

    world_from_ego: pose of the ego at a stamp; None for that of the timeline.
    """
    pose_at = timeline.world_from_ego if world_from_ego is None else world_from_ego
    exposure_s = mount.spec.exposure_s
    opens_s, closes_s = stamp_s - exposure_s / 2, stamp_s + exposure_s / 2
    states = timeline.at(np.array([opens_s, closes_s]))
    ahead = np.stack([np.cos(states.yaws), np.sin(states.yaws)], axis=-1)
    centres = states.axles + timeline.centre_ahead_m[:, None] * ahead
    first, last = (pose_at(t) for t in (opens_s, closes_s))
    turned = np.arctan2(np.sin(last.yaw - first.yaw), np.cos(last.yaw - first.yaw))
    start, end = ((pose @ mount.ego_from_camera).translation for pose in (first, last))
    return CameraMotion(
        (end - start) / exposure_s,
        np.array([0.0, 0.0, turned / exposure_s]),
        (centres[1] - centres[0]) / exposure_s,
    )


# --------------------------------------------------------------------------------------------------
# One exposure of a camera in a moving scene.


@dataclass(frozen=True, slots=True, eq=False)
class ImageTruth(Record):
    """Truth of an image.

    depth: (H, W) float32, metres along the optical axis, 0 in the sky.
    owners: (H, W) int32, the actor's row, `GROUND`, -2 and below for scenery, `NOTHING` for sky.
    visible_pixels: (A,) int64. boxes: (A, 4) float64, left top right bottom, of the whole actor,
        visible or hidden, clipped to the image.
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
    rain_mm_h: float = 0.0,
    motion: CameraMotion | None = None,
) -> tuple[CameraImage, ImageTruth]:
    """Take one image at the stamp, the middle of the exposure.

    categories: (A,) of the actors. Noise depends on seed and stamp alone. A plain camera
    (`CameraSpec.plain`) ignores weather and motion.
    """
    solids = solids_of(scene, stamp_s)
    raster = rasterise(
        scene, spec.pinhole, world_from_camera, stamp_s, outlines=True, solids=solids
    )
    truth = image_truth(raster, solids, len(scene.present))
    view = CameraView(raster, scene, solids, spec.pinhole, world_from_camera, stamp_s, categories)
    if spec.plain:
        pixels = shade_plain(view, ground, light)
    else:
        shaded = shade(
            view, ground, light, extinction_per_m=extinction_per_m, wet=min(1.0, rain_mm_h / 5.0)
        )
        pixels = exposed(
            shaded,
            raster,
            solids,
            spec,
            light,
            world_from_camera=world_from_camera,
            stamp_s=stamp_s,
            noise_seed=noise_seed,
            rain_mm_h=rain_mm_h,
            motion=motion,
            extinction_per_m=extinction_per_m,
        )
    return CameraImage(pixels, spec.pinhole.intrinsics, stamp_s, sensor), truth


def image_truth(raster: Raster, solids: Solids, actors: int) -> ImageTruth:
    """Return the truth of every pixel and actor."""
    # Faces -2 and -1 index the two entries at the end.
    table = np.concatenate([np.repeat(solids.owners, FACES), [NOTHING, GROUND]]).astype(np.int32)
    depth, owners = np.empty_like(raster.q), np.empty_like(raster.faces)
    depths_and_owners(raster.q, raster.faces, table, depth, owners)
    visible = np.zeros(actors, np.int64)
    count_visible(owners, visible)
    hidden = 1 - visible / np.maximum(raster.outline_pixels, 1)
    return ImageTruth(depth, owners, visible, raster.boxes, np.clip(hidden, 0.0, 1.0))
