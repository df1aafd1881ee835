"""Recorded drives of KITTI: scans, images, labels and poses in place of simulated traffic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from roadscope.benchmarks.drive_steps import Step
from roadscope.benchmarks.drive_steps import drive as steps_of
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fingerprints import code_hash
from roadscope.benchmarks.formats.image_folder import read_image
from roadscope.benchmarks.formats.kitti_frames import (
    EGO_FROM_CAMERA,
    LabelCamera,
    detections_from_rows,
    kitti_objects,
    kitti_results,
    truth_of_labels,
)
from roadscope.benchmarks.formats.kitti_labels import KittiObjects, KittiType
from roadscope.benchmarks.formats.kitti_odometry import KittiOdometrySequence
from roadscope.benchmarks.formats.kitti_scans import IMAGES, KittiFrames, KittiView, check_frames
from roadscope.benchmarks.images import Picture, believed_projections, image_rows, pictures
from roadscope.benchmarks.metrics.image_labels import ParkedBoxes
from roadscope.benchmarks.metrics.trajectory_errors import Trajectories
from roadscope.core import (
    Calibration,
    CameraImage,
    Category,
    Detections,
    Frame,
    Pose,
    Tracks,
    Truth,
)
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection

LIDAR_HEIGHT_M = 1.73
"""Of KITTI's Velodyne above the road (Geiger et al. 2013, figure 3)."""
CATEGORIES = {
    KittiType.CAR: Category.CAR,
    KittiType.VAN: Category.VAN,
    KittiType.TRUCK: Category.TRUCK,
    KittiType.PEDESTRIAN: Category.PEDESTRIAN,
    KittiType.PERSON: Category.PEDESTRIAN,
    KittiType.CYCLIST: Category.CYCLIST,
}
"""The categories of labels; the other types have none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedDrive(Episode):
    """A drive that was recorded; `seed` numbers it. digest: of the content of its files."""

    simulated: ClassVar[bool] = False
    scenario: str = "kitti"
    rig: str = "kitti"
    weather: str = "as recorded"
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class KittiDrive(RecordedDrive):
    """A sequence of KITTI's data, or a part of its object data, as an episode.

    The ego frame has its origin on the road below the LiDAR, with the LiDAR's axes: KITTI's files
    do not say where the rear axle is. Calibration says where the camera is.

    files: of the frames. sensors: those that plug-ins get.
    lidar_height_m: height of the LiDAR above the road, which no file gives.
    """

    files: KittiFrames
    sensors: tuple[str, ...]
    lidar_height_m: float = LIDAR_HEIGHT_M

    @property
    def name(self) -> str:
        """The sequence, or the numbers of the frames."""
        return self.files.name

    @property
    def ego_from_lidar(self) -> Pose:
        """Where the LiDAR is."""
        return Pose.from_parts(np.eye(3), np.array([0.0, 0.0, self.lidar_height_m]))

    def spec(self) -> dict[str, object]:
        """Return what frames and truth depend on: the content of the files, not their place."""
        return {
            "name": self.name,
            "digest": self.digest,
            "sensors": self.sensors,
            "lidar_height_m": self.lidar_height_m,
            "code": code_hash(__name__),
        }

    def check(self) -> None:
        """Read the files; a malformed one raises `FormatError`."""
        check_frames(self.files, self.sensors)

    def scans(self) -> Iterator[tuple[Frame, Truth]]:
        """Yield the frames with scans and their truth, the labels."""
        previous: Pose | None = None
        for scan, poses, truth in zip(
            self.files.scans(), frame_poses(self), truths_by_frame(self), strict=True
        ):
            motion = poses.motion_since(previous)
            yield Frame(scan.stamp_s, poses.calibration, scan, previous_from_ego=motion), truth
            previous = poses.world_from_ego

    def images(self, *, pixels: bool = True) -> Iterator[tuple[Frame, Truth]]:
        """Yield the frames with images and their truth; without pixels, one grey one stands in."""
        grey = np.full((1, 1, 3), 128, np.uint8)
        for number, poses, truth in zip(
            self.files.numbers, frame_poses(self), truths_by_frame(self), strict=True
        ):
            content = read_image(self.files.file(IMAGES, number)) if pixels else grey
            image = CameraImage(
                content, poses.view.camera.projection[:, :3], truth.stamp_s, "camera"
            )
            yield Frame(truth.stamp_s, poses.calibration, camera=image), truth

    def rows(self, detections: Sequence[Detections]) -> list[KittiObjects]:
        """Return detections of each frame, world frame, as KITTI's rows: those in the image."""
        pairs = zip(detections, frame_poses(self), strict=True)
        return [poses.rows(each) for each, poses in pairs]


sensed.register(KittiDrive, KittiDrive.scans)


@believed_projections.register
def _projections(drive: KittiDrive, scans: int) -> list[Projection]:
    return [poses.projection for poses in frame_poses(drive)]


@image_rows.register
def _all_image_rows(drive: KittiDrive, every_s: float) -> list[int]:
    return list(range(len(drive.files.numbers)))


@pictures.register
def _pictures(drive: KittiDrive, rows: Sequence[int], *, pixels: bool = True) -> Iterator[Picture]:
    no_parked_cars = ParkedBoxes(np.empty((0, 4)), np.empty(0))
    for row, (frame, truth) in enumerate(drive.images(pixels=pixels)):
        yield Picture(row, frame, truth, no_parked_cars)


@dataclass(frozen=True, slots=True)
class KittiDrives:
    """All drives of a folder: one sample, over which KITTI's average precision is computed."""

    drives: tuple[KittiDrive, ...]

    scenario = "kitti"
    seed = 0
    weather = condition = "as recorded"

    def check(self) -> None:
        """Read the files; a malformed one raises `FormatError`."""
        for drive in self.drives:
            drive.check()


class _FramePoses(NamedTuple):
    """The poses of the vehicle and its sensors at one frame.

    posed: whether the files give `world_from_ego`; otherwise it is the identity.
    """

    view: KittiView
    ego_from_lidar: Pose
    world_from_ego: Pose
    posed: bool

    @property
    def ego_from_camera(self) -> Pose:
        """The pose of the rectified camera."""
        return self.ego_from_lidar @ self.view.camera.camera_from_lidar.inverse()

    @property
    def world_from_turned(self) -> Pose:
        """The pose of the camera with the axes of ISO 8855, which is the ego of `kitti_frames`."""
        return self.world_from_ego @ self.ego_from_camera @ EGO_FROM_CAMERA.inverse()

    @property
    def projection(self) -> Projection:
        """Pixels of the image from metres in the ego frame."""
        return self.view.camera.projection_of(self.ego_from_lidar, *self.view.image_size)

    @property
    def calibration(self) -> Calibration:
        """Where the sensors are."""
        return Calibration((("lidar", self.ego_from_lidar), ("camera", self.ego_from_camera)))

    def motion_since(self, world_from_previous: Pose | None) -> Pose | None:
        """Return `previous_from_ego`; None for the first frame and without poses."""
        if world_from_previous is None or not self.posed:
            return None
        return world_from_previous.inverse() @ self.world_from_ego

    def rows(self, detections: Detections) -> KittiObjects:
        """Return detections, world frame, as rows, those in the image."""
        tracks = Tracks.of(detections, np.arange(len(detections)))
        camera = self.view.camera
        return kitti_objects(
            tracks, 0, self.world_from_turned, camera.projection, self.view.image_size
        )

    def fused_rows(self, fused: FusedDetections) -> KittiObjects:
        """Return fused targets as rows, those in the image.

        Their image boxes are their own, or those around their boxes in space.
        """
        projection, size = self.view.camera.projection, self.view.image_size
        camera = LabelCamera(self.ego_from_camera.inverse(), projection, size)
        rows = kitti_results(fused, camera)
        return rows.select(rows.in_image)


@lru_cache(maxsize=64)
def frame_poses(drive: KittiDrive) -> tuple[_FramePoses, ...]:
    """Return the poses of the vehicle and its sensors at each frame."""
    views, poses = drive.files.views(), drive.files.poses()
    mount = drive.ego_from_lidar
    if poses is None:
        return tuple(_FramePoses(view, mount, Pose.identity(), posed=False) for view in views)
    return tuple(
        _FramePoses(
            view,
            mount,
            pose @ EGO_FROM_CAMERA @ view.camera.camera_from_lidar @ mount.inverse(),
            posed=True,
        )
        for view, pose in zip(views, poses, strict=True)
    )


@lru_cache(maxsize=64)
def labels_by_frame(drive: KittiDrive) -> tuple[KittiObjects, ...]:
    """Return the labels of each frame."""
    return tuple(drive.files.labels())


def truths_by_frame(drive: KittiDrive) -> list[Truth]:
    """Return the labelled objects of each frame, world frame; velocities are 0."""
    truths = []
    frames = zip(labels_by_frame(drive), frame_poses(drive), drive.files.stamps_s, strict=True)
    for labels, poses, stamp_s in frames:
        rows = labels.select(np.isin(labels.types, list(CATEGORIES)))
        count = len(rows)
        scored = replace(rows, scores=np.ones(count))
        boxes = detections_from_rows(scored, Category.CAR, stamp_s=stamp_s, normalized=True)
        kinds = np.array([CATEGORIES[KittiType(kind)] for kind in rows.types], np.int8)
        truth = truth_of_labels(
            np.arange(count),
            replace(boxes, categories=kinds).moved(poses.world_from_turned, "world"),
            np.zeros((count, 2)),
            poses.world_from_ego,
            stamp_s=stamp_s,
            image_boxes=rows.boxes,
        )
        truths.append(truth)
    return truths


@dataclass(frozen=True, slots=True, kw_only=True)
class KittiOdometryDrive(RecordedDrive):
    """A sequence of KITTI's odometry data as an episode."""

    sequence: KittiOdometrySequence

    def spec(self) -> dict[str, object]:
        """Return what scans and poses depend on: the content of the files, not their place."""
        return {"name": self.sequence.name, "digest": self.digest, "code": code_hash(__name__)}

    def check(self) -> None:
        """Read the files; a malformed one raises `FormatError`."""
        self.sequence.check()

    def steps(self) -> Iterator[Step]:
        """Yield the scans with the true poses of the LiDAR; which returns move is not known."""
        mount = self.sequence.camera_from_lidar()
        for scan, pose in zip(self.sequence.scans(), self.sequence.camera_poses(), strict=True):
            yield Step(scan, None, None, pose @ mount, np.zeros(len(scan), bool))

    def of_camera(self, lidar: Trajectories) -> Trajectories:
        """Return the trajectories of the camera, which KITTI compares, for those of the LiDAR."""
        lidar_from_camera = self.sequence.camera_from_lidar().inverse().matrix
        return Trajectories(lidar.estimate @ lidar_from_camera, lidar.truth @ lidar_from_camera)


steps_of.register(KittiOdometryDrive, KittiOdometryDrive.steps)
