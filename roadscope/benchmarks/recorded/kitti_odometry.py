"""Recorded drives of KITTI's odometry data in place of simulated traffic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from roadscope.benchmarks.drive_steps import Step, drive
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprints import code_hash
from roadscope.benchmarks.formats.kitti_odometry import KittiOdometrySequence
from roadscope.benchmarks.metrics.trajectory_errors import Trajectories
from roadscope.benchmarks.recorded.recording import SequenceSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class KittiOdometryDrive(Episode):
    """A sequence of KITTI's odometry data as an episode. digest: of the files' content."""

    simulated: ClassVar[bool] = False
    sequence: KittiOdometrySequence
    digest: str

    @staticmethod
    def of(sequence: KittiOdometrySequence, number: int) -> KittiOdometryDrive:
        """Return the drive of a sequence. number: names it, as seeds name episodes."""
        return KittiOdometryDrive(
            "kitti",
            number,
            "kitti",
            weather="as recorded",
            sequence=sequence,
            digest=sequence.digest(),
        )

    def spec(self) -> dict[str, object]:
        """Return what scans and poses depend on: the content of the files, not their place."""
        return {
            "name": self.sequence.name,
            "digest": self.digest,
            "code": code_hash("roadscope.benchmarks.recorded.kitti_odometry"),
        }

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


drive.register(KittiOdometryDrive, KittiOdometryDrive.steps)


class KittiOdometrySettings(SequenceSettings, frozen=True, kw_only=True):
    """The settings of the board of odometries.

    drives: the sequences. remark: what a reader must know about them.
    """

    drives: tuple[KittiOdometryDrive, ...] = ()

    @property
    def seeds(self) -> Sequence[int]:
        """The numbers of its drives."""
        return [drive.seed for drive in self.drives]
