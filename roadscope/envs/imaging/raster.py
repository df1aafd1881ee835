"""What a camera sees first in every pixel: the ray caster's answer, found face by face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose
from roadscope.core.record import Record
from roadscope.envs.imaging.face_kernels import FACES, Canvas, Lens, Solids
from roadscope.envs.imaging.pinhole import Pinhole
from roadscope.envs.imaging.raster_kernels import draw_all
from roadscope.envs.raycast.scene import Scene

__all__ = ["FACES", "Lens", "Raster", "Solids", "lens_of", "rasterise", "solids_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Raster(Record):
    """The nearest surface behind every pixel.

    q: (H, W) float32, 1/m, reciprocal of the depth along the optical axis, 0 in the sky.
    faces: (H, W) int32, prism * 16 + side, prisms counted over scenery and bodies joined; -1 is
        the ground, -2 the sky. Sides 0 to 11 are upright, 12 is the top, 13 the bottom.
    boxes: (A, 4) float64, left top right bottom in pixels, of the whole actor, seen or hidden, as
        far as it is inside the image; without extent where it is not.
    outline_pixels: (A,) int64, pixels that the actor would cover if nothing else were there;
        zeros unless asked for.
    """

    q: np.ndarray
    faces: np.ndarray
    boxes: np.ndarray
    outline_pixels: np.ndarray


def rasterise(
    scene: Scene,
    pinhole: Pinhole,
    world_from_camera: Pose,
    stamp_s: float,
    *,
    outlines: bool = False,
    solids: Solids | None = None,
) -> Raster:
    """Find the nearest surface behind the middle of every pixel at one instant.

    Solid bodies and the ground are where `raycast.cast` finds them. Foliage is made of cells of
    leaves in the world, so that it looks alike from frame to frame.
    """
    shape = (pinhole.height, pinhole.width)
    marks = np.empty(shape if outlines else (0, 0), np.int32)
    canvas = Canvas(np.empty(shape, np.float32), np.empty(shape, np.int32), marks)
    extents = np.tile([np.inf, np.inf, -np.inf, -np.inf, 0.0], (len(scene.present), 1))
    given = solids_of(scene, stamp_s) if solids is None else solids
    draw_all(lens_of(pinhole, world_from_camera), given, canvas, extents)
    extents[~np.isfinite(extents[:, 0]), :4] = 0.0
    return Raster(canvas.q, canvas.faces, extents[:, :4], extents[:, 4].astype(np.int64))


def lens_of(pinhole: Pinhole, world_from_camera: Pose) -> Lens:
    """Put a camera into the world."""
    return Lens(
        np.ascontiguousarray(world_from_camera.rotation.T),
        np.ascontiguousarray(world_from_camera.translation),
        np.array(pinhole.focal_px, np.float64), np.array(pinhole.centre_px, np.float64),
    )  # fmt: skip


def solids_of(scene: Scene, stamp_s: float) -> Solids:
    """Put all prisms at one instant into the world frame; absent actors' lose their corners."""
    static, moving = scene.static, scene.moving
    x, y, yaw = scene.poses_at(np.array([stamp_s]))[0][moving.owners].T[:, :, None]
    along, across = moving.footprints[..., 0], moving.footprints[..., 1]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    placed = np.stack(
        [x + cosine * along - sine * across, y + sine * along + cosine * across], axis=-1
    )
    corners = np.where(scene.present[moving.owners], moving.corners, 0)
    joined = [
        np.concatenate(pair)
        for pair in (
            (static.footprints, placed), (static.corners, corners),
            (static.bottoms, moving.bottoms), (static.tops, moving.tops),
            (static.owners, moving.owners), (static.extinctions, moving.extinctions),
        )
    ]  # fmt: skip
    return Solids(*joined)
