"""Poses: of an odometry, of one whose scans lack moving objects, or made from truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.drive_steps import Step, drive, imu_mounting
from roadscope.benchmarks.episode import Episode, sensing_of
from roadscope.benchmarks.kinds import ODOMETRY
from roadscope.benchmarks.loop import CallInput, Replies, RunOptions, run_plugin
from roadscope.benchmarks.nodes.traffic import SensingNode
from roadscope.benchmarks.noisy_odometry import noisy_poses
from roadscope.benchmarks.records import CallTimes, EpisodePoses
from roadscope.benchmarks.references import is_noise
from roadscope.core import OdometryEstimate, Pose, Spec
from roadscope.core.answers import STAMP_TOLERANCE_S
from roadscope.core.spec import ORACLE
from roadscope.odometry.rigid import orthonormal


@dataclass(frozen=True)
class PoseNode(SensingNode):
    """The poses of an odometry, of one whose scans lack moving objects, or made from truth."""

    source: Spec
    episode: Episode

    stage = "poses"
    folder = "poses"
    record = EpisodePoses

    def compute(self, options: RunOptions) -> EpisodePoses:
        """Run the odometry over the scans that arrive."""
        steps, odometry = self.steps(), self.source
        if is_noise(self.source):
            return _from_truth(self.source, list(steps), self.episode.seed)
        if self.source.kind == ORACLE:
            steps = (step.without_moving() for step in steps)
            odometry = self.source.parts["odometry"]
        reset = (imu_mounting(self.episode),)
        replies: Replies[_ScanTruth, OdometryEstimate]
        replies = run_plugin(odometry, ODOMETRY, _inputs(steps), reset=reset, options=options)
        if not replies.contexts:
            raise ValueError("no scan arrives: the episode is too short, or all are lost")
        answers = [answer for answer in replies.answers if answer is not None]
        return EpisodePoses(
            np.array([each.start_from_lidar.matrix for each in answers]),
            np.array([each.world_from_lidar for each in replies.contexts]),
            np.array([each.stamp_s for each in answers]),
            np.array([not each.ok for each in answers]),
            tuple(each.dynamic for each in answers),
            tuple(each.moving for each in replies.contexts),
            replies.times,
        )

    def steps(self) -> Iterable[Step]:
        """Return the scans of the episode that arrive."""
        return drive(self.episode)


def start_from_ego(poses: EpisodePoses, episode: Episode, stamps_s: Sequence[float]) -> list[Pose]:
    """Return the last pose of the ego that an odometry estimated up to each stamp, seconds.

    Poses are in the ego frame of the first scan, by the calibration as the user believes it;
    before the first scan they are the identity.
    """
    sensing = sensing_of(episode)
    mount = sensing.calibration.pose(sensing.rig.lidar.name)
    lidar_from_ego = mount.inverse()
    estimates = [
        (mount @ Pose(pose) @ lidar_from_ego).matrix for pose in poses.trajectories.estimate
    ]
    rows = np.searchsorted(poses.stamps_s, np.asarray(stamps_s) + STAMP_TOLERANCE_S) - 1
    return [Pose(np.eye(4) if row < 0 else estimates[row]) for row in rows]


@dataclass(frozen=True, slots=True)
class _ScanTruth:
    """The truth of a scan: the LiDAR's pose (4, 4), and the moving returns (N,)."""

    world_from_lidar: np.ndarray
    moving: np.ndarray


def _inputs(steps: Iterable[Step]) -> Iterator[CallInput[_ScanTruth]]:
    for step in steps:
        truth = _ScanTruth(step.world_from_lidar.matrix, step.moving)
        yield CallInput((step.scan, step.imu), truth, wheels=step.wheels)


def _from_truth(source: Spec, steps: Sequence[Step], seed: int) -> EpisodePoses:
    """Return the poses that a noise model makes from the true ones."""
    truth = [step.world_from_lidar for step in steps]
    noisy = noisy_poses(source.make(), truth, seed)
    return EpisodePoses(
        np.array([orthonormal(pose.matrix) for pose in noisy]),
        np.array([pose.matrix for pose in truth]),
        np.array([step.scan.stamp_s for step in steps]),
        np.zeros(len(steps), bool),
        tuple(np.zeros(len(step.scan), bool) for step in steps),
        tuple(step.moving for step in steps),
        CallTimes.zero(0),
    )
