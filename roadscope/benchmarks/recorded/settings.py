"""A suite's settings of the boards that run plug-ins on KITTI's scans and images."""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.benchmarks.recorded.kitti_drive import KittiDrive
from roadscope.benchmarks.recorded.recording import SequenceSettings
from roadscope.benchmarks.suite import Names


class KittiSettings(SequenceSettings, frozen=True, kw_only=True):
    """The settings of one board.

    drives: the sequences, or the parts of the object data.
    remark: what a reader must know about frames and coordinates.
    lidar, camera: detectors whose detections fusions get.
    """

    drives: tuple[KittiDrive, ...] = ()
    lidar: Names = ()
    camera: Names = ()

    @property
    def seeds(self) -> Sequence[int]:
        """The numbers of its drives."""
        return [drive.seed for drive in self.drives]
