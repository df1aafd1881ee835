"""Answers of plug-ins to recorded drives of KITTI: nodes of episodes whose inputs are files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from roadscope.benchmarks.drive import Step
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.recorded.kitti_drive import KittiDrive
from roadscope.benchmarks.recorded.kitti_odometry import KittiOdometryDrive
from roadscope.core import Frame, Pose, Truth


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
