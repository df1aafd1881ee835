"""A suite's settings of the boards that run plug-ins on KITTI's scans and images."""

from __future__ import annotations

from roadscope.benchmarks.recorded.kitti_drive import KittiDrive
from roadscope.benchmarks.suite import BoardSettings, Names


class KittiSettings(BoardSettings, frozen=True, kw_only=True):
    """The settings of one board.

    drives: the sequences, or the parts of the object data.
    remark: what a reader must know about frames and coordinates.
    lidar, camera: detectors whose detections fusions get.
    """

    drives: tuple[KittiDrive, ...] = ()
    remark: str = ""
    lidar: Names = ()
    camera: Names = ()
