"""The camera images of an episode with their truth; they are drawn again for every use."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial, singledispatch

import numpy as np

from roadscope.benchmarks.episode import Episode, LastEpisode, sensing_of, timeline_of
from roadscope.benchmarks.fingerprints import fingerprint
from roadscope.benchmarks.metrics.image_labels import ParkedBoxes
from roadscope.benchmarks.parked import parked_boxes
from roadscope.core import CameraImage, Frame, Pose, Truth
from roadscope.core.projection import Projection
from roadscope.envs.imaging.raster import rasterise, solids_of
from roadscope.envs.sensors.camera import image_truth
from roadscope.envs.sensors.rig import CameraMount, Rig
from roadscope.envs.sensors.rigs import rig as rig_of
from roadscope.envs.sensors.sensing import IMAGE_RANGE_M, Sensing, truth_of_image, world_of
from roadscope.envs.traffic.timeline import Timeline
from roadscope.fusion.pairing import LIMIT_S


@dataclass(frozen=True, slots=True)
class Picture:
    """One image and its truth; the frame has no image if a fault lost it.

    index: number of the image. parked: the parked cars in it, which are scenery.
    """

    index: int
    frame: Frame
    truth: Truth
    parked: ParkedBoxes


class WithoutPixels(Sensing):
    """Sensing that draws no images: each is one grey pixel. The truth is that of drawn images."""

    def sense_image_at(self, timeline: Timeline, stamp_s: float) -> tuple[Frame, Truth]:
        """Return a frame with one pixel, or without if the image is lost, and its truth."""
        mount = camera_of(self.rig)
        placed = self._place_bodies(timeline, np.array([stamp_s]), stamp_s, IMAGE_RANGE_M)
        solids = solids_of(placed.scene, stamp_s)
        raster = rasterise(
            placed.scene,
            mount.spec.pinhole,
            timeline.ego_poses(placed.knots)[0] @ mount.ego_from_camera,
            stamp_s,
            outlines=True,
            solids=solids,
        )
        shown = image_truth(raster, solids, len(placed.scene.present))
        grey = np.full((1, 1, 3), 128, np.uint8)
        image = CameraImage(grey, mount.spec.pinhole.intrinsics, stamp_s, mount.name)
        believed_s = stamp_s + self.image_late_s
        frame = Frame(believed_s, self.calibration, camera=self._delivered(image, believed_s))
        return frame, truth_of_image(timeline, placed.around, shown)


def camera_of(rig: Rig) -> CameraMount:
    """Return the rig's camera; raise `ValueError` for a rig without one."""
    if rig.camera is None:
        raise ValueError(f"rig '{rig.name}' has no camera; li2021 and wide have one")
    return rig.camera


def projection_of(rig: Rig, ego_from_camera: Pose | None = None) -> Projection:
    """Return the projection from the ego frame into the rig's images.

    ego_from_camera: the mounting pose; None: the true one.
    """
    camera = camera_of(rig)
    pinhole, mounting = camera.spec.pinhole, ego_from_camera or camera.ego_from_camera
    return Projection.of(pinhole.intrinsics, mounting, pinhole.width, pinhole.height)


@singledispatch
def believed_projections(episode: Episode, scans: int) -> list[Projection]:
    """Return for each scan the projection into images, by the calibration that users believe."""
    sensing = sensing_of(episode)
    mounting = sensing.calibration.pose(camera_of(sensing.rig).name)
    return [projection_of(sensing.rig, mounting)] * scans


def sensing_without_pixels(episode: Episode) -> Sensing:
    """Return the sensing of an episode that draws no images."""
    drawing = sensing_of(episode)
    return WithoutPixels(drawing.rig, episode.seed, weather=episode.weather, faults=episode.faults)


@singledispatch
def image_rows(episode: Episode, every_s: float) -> list[int]:
    """Return the numbers of images that are about `every_s` apart, each once."""
    camera, end_s = camera_of(rig_of(episode.rig)), timeline_of(episode).end_s
    last = int(
        np.floor(
            (end_s - camera.spec.exposure_s / 2 - camera.stamp_s(0)) / camera.spec.period_s + 1e-6
        )
    )
    return list(range(0, last + 1, max(1, round(every_s / camera.spec.period_s))))


def image_rows_of_scans(episode: Episode, every_s: float) -> list[int]:
    """Return the numbers of the images nearest to scans that are about `every_s` apart.

    If the nearest image is lost by a fault, the nearest of the others is returned too, if it is
    near enough to be paired with the scan.
    """
    sensing, timeline = sensing_of(episode), timeline_of(episode)
    lidar, rows = sensing.rig.lidar, np.array(image_rows(episode, 0.0))
    stamps_s = np.array([camera_of(sensing.rig).stamp_s(int(k)) for k in rows])
    stamps_s += sensing.image_late_s
    scans = int(timeline.end_s / lidar.spec.period_s) + 1
    step = max(1, round(every_s / lidar.spec.period_s))
    last_s = timeline.end_s - lidar.spec.sweep_s / 2 + 1e-9
    scan_s = np.array([lidar.stamp_s(k) for k in range(0, scans, step)])
    gaps = np.abs(stamps_s - scan_s[scan_s <= last_s, None])
    lost = np.array([sensing.image_lost(row) is not None for row in rows.tolist()], bool)
    second = np.where(lost, np.inf, gaps).argmin(axis=1)
    paired = np.where(lost, np.inf, gaps).min(axis=1) <= LIMIT_S
    of_scans: list[int] = rows[np.union1d(gaps.argmin(axis=1), second[paired])].tolist()
    return of_scans


_last_images = LastEpisode[Picture](most_bytes=400_000_000)


@singledispatch
def pictures(episode: Episode, rows: tuple[int, ...], *, pixels: bool = True) -> Iterator[Picture]:
    """Yield images by number, the same bytes every time, in arrays that a plug-in may write to.

    pixels: whether images are drawn; else one grey pixel stands for each.
    """
    pinhole = camera_of(rig_of(episode.rig)).spec.pinhole
    size_bytes = len(rows) * pinhole.width * pinhole.height * 3 if pixels else 0
    key = fingerprint(episode.spec()), rows, pixels
    for picture in _last_images.get(key, size_bytes, partial(_pictures, episode, rows, pixels)):
        yield replace(picture, frame=deepcopy(picture.frame))


def _pictures(episode: Episode, rows: tuple[int, ...], pixels: bool) -> Iterator[Picture]:
    timeline = timeline_of(episode)
    sensing = sensing_of(episode) if pixels else sensing_without_pixels(episode)
    projection, world = projection_of(sensing.rig), world_of(timeline, episode.seed)
    for row in rows:
        frame, truth = sensing.sense_image(timeline, row)
        yield Picture(row, frame, truth, parked_boxes(world, truth.world_from_ego, projection))
