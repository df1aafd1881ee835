"""Answers of plug-ins to recorded drives of KITTI: nodes of episodes whose inputs are files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from roadscope.benchmarks.drive_steps import Step
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.images import Picture
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.fusion import FusionTargets
from roadscope.benchmarks.metrics.image_labels import ParkedBoxes
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.fusions import FusionNode, Lost
from roadscope.benchmarks.nodes.images import ImageNode, PictureDetector
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.recorded.kitti_drive import KittiDrive, places_of
from roadscope.benchmarks.recorded.kitti_odometry import KittiOdometryDrive
from roadscope.benchmarks.records import EpisodeDetections, EpisodeImageDetections
from roadscope.core import Frame, ImageDetections, Pose, Truth
from roadscope.core.projection import Projection


@dataclass(frozen=True)
class KittiDetectionNode(DetectionNode):
    """The detections of a LiDAR detector on the scans of a drive, or its labels."""

    episode: KittiDrive

    def sources(self) -> tuple[Node, ...]:
        """Return nothing: scans are files."""
        return ()

    def frames(self) -> Iterable[tuple[Frame, Truth]]:
        """Return the scans, and the labels as truth."""
        return self.episode.scans()


@dataclass(frozen=True)
class KittiImageNode(ImageNode):
    """The detections of a camera detector in the images of a drive, or its labels."""

    episode: KittiDrive

    def sources(self) -> tuple[Node, ...]:
        """Return nothing: images are files."""
        return ()

    def image_rows(self) -> tuple[int, ...]:
        """Return all images."""
        return tuple(range(len(self.episode.files.numbers)))

    def pictures(self, rows: tuple[int, ...], *, pixels: bool = True) -> Iterator[Picture]:
        """Yield the images, and the labels as truth."""
        nobody = ParkedBoxes(np.empty((0, 4)), np.empty(0))
        for row, (frame, truth) in enumerate(self.episode.images(pixels=pixels)):
            yield Picture(row, frame, truth, nobody)

    def from_truth(self) -> PictureDetector:
        """Return a function that returns the labels."""
        return lambda picture: labelled_boxes(picture.truth)


def labelled_boxes(truth: Truth) -> ImageDetections:
    """Return the labels of an image as detections."""
    assert truth.image_boxes is not None
    return ImageDetections(truth.image_boxes, truth.categories, np.ones(len(truth)), truth.stamp_s)


@dataclass(frozen=True)
class KittiFusionNode(FusionNode):
    """The answers of a fusion to the detections in the scans and images of a drive."""

    lidar: KittiDetectionNode
    camera: KittiImageNode

    @property
    def drive(self) -> KittiDrive:
        """The drive."""
        return self.lidar.episode

    def scan_rows(self, scans: int) -> np.ndarray:
        """Return all scans: every one has its image."""
        return np.arange(scans)

    def lost(self, rows: Sequence[int], images: Sequence[int]) -> Lost:
        """Return that nothing is lost."""
        return Lost([False] * len(rows), [False] * len(images))

    def projections(self, rows: Sequence[int]) -> Sequence[Projection]:
        """Return the projection of each scan, by its calibration."""
        return [place.projection for place in places_of(self.drive)]

    def targets(
        self, lidar: EpisodeDetections, camera: EpisodeImageDetections, rows: np.ndarray
    ) -> tuple[FusionTargets, ...]:
        """Return no objects: KITTI's rules need the labels themselves."""
        return ()


@dataclass(frozen=True)
class KittiPoseNode(PoseNode):
    """The poses of an odometry on the scans of a sequence."""

    episode: KittiOdometryDrive

    def sources(self) -> tuple[Node, ...]:
        """Return nothing: scans are files."""
        return ()

    def steps(self) -> Iterable[Step]:
        """Return the scans and the true poses."""
        return self.episode.steps()

    def mounting(self) -> Pose | None:
        """Return nothing: KITTI's odometry data have no IMU."""
        return None


@dataclass(frozen=True)
class AllDrives(Node):
    """The answers on all drives of a folder; only those of each drive are kept as files."""

    parts: tuple[Node, ...]

    stage = "reading"
    record: ClassVar[Any] = None
    recomputed_if_fresh = False

    def content(self) -> Mapping[str, Any]:
        """Return what the answers depend on."""
        return {"parts": [part.content() for part in self.parts]}

    def sources(self) -> tuple[Node, ...]:
        """Return the answers on each drive."""
        return self.parts

    def compute(self, options: RunOptions) -> Any:
        """Return the answers on each drive."""
        return tuple(part.read(options) for part in self.parts)

    def read(self, options: RunOptions | None = None, *, recompute: bool = False) -> Any:
        """Return the answers on each drive, from their files."""
        return self.compute(options or RunOptions())
