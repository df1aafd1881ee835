"""Runs an odometry over an episode; only the plug-in's own call is timed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from operator import methodcaller
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.drive import Step, drive, imu_mounting
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.stack import STAMP_TOLERANCE_S, EntryError, guarded
from roadscope.benchmarks.metrics.odometry import Trajectories
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES, imitated, noisy_poses
from roadscope.benchmarks.oracle_odometry import method_of, spared
from roadscope.core import LidarScan, OdometryEstimate, Pose
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.api import asked
from roadscope.odometry.estimates import estimate

WARM_SCANS = 4
FARTHEST_M = 1e6
"""A pose farther from the start is no pose."""
_WARM: set[str] = set()
"""Odometries of ours that were called in this process."""


@dataclass(frozen=True, slots=True, eq=False)
class Ride:
    """What an odometry told of T scans, beside the truth.

    both: its poses and the true ones. stamps_s: (T,). degraded: (T,) bool.
    dynamic, moving: (N,) bool of each scan, returns held to be dynamic and those that truly are.
    calls_ms: (T,) processor time of each call, all threads together; (0,) of imitations.
    """

    both: Trajectories
    stamps_s: np.ndarray
    degraded: np.ndarray
    dynamic: tuple[np.ndarray, ...]
    moving: tuple[np.ndarray, ...]
    calls_ms: np.ndarray


def ride(odometry: str, episode: Episode) -> Ride:
    """Run an odometry, one that is spared all that moves, or an imitation over an episode.

    Whatever the plug-in does wrong raises `EntryError`.
    """
    if imitated(odometry):
        return imitation(odometry, episode)
    spec, mounting = method_of(odometry), imu_mounting(episode)
    steps = drive(episode) if spared(odometry) is None else _spared(drive(episode))
    steps = _warmed_up(spec, steps, mounting)
    plugin = guarded(spec, lambda: ODOMETRIES.make(spec))
    guarded(spec, methodcaller("reset", mounting), plugin)
    told: list[OdometryEstimate] = []
    truths: list[np.ndarray] = []
    moving: list[np.ndarray] = []
    calls_ms = []
    for step in steps:
        estimate, took_ms = _timed(spec, plugin, step)
        told.append(checked(spec, estimate, step.scan))
        truths.append(step.world_from_lidar.matrix)
        moving.append(step.moving)
        calls_ms.append(took_ms)
    if not told:
        raise ValueError("no scan arrives: the episode is too short, or all are lost")
    return _joined(told, truths, moving, calls_ms)


def imitation(spec: str, episode: Episode) -> Ride:
    """Return poses made from truth, which no call has cost."""
    steps = list(drive(episode))
    truth = [step.world_from_lidar for step in steps]
    poses = noisy_poses(ODOMETRY_NOISES.make(spec), truth, episode.seed)
    told = [
        estimate(pose.matrix, np.zeros((6, 6)), step.scan.stamp_s, len(step.scan))
        for pose, step in zip(poses, steps, strict=True)
    ]
    return _joined(told, [pose.matrix for pose in truth], [step.moving for step in steps], [])


def checked(spec: str, answer: Any, scan: LidarScan) -> OdometryEstimate:
    """Refuse what is no answer to a scan."""
    if not isinstance(answer, OdometryEstimate):
        raise EntryError(f"{spec}: update returned {type(answer).__name__}, not OdometryEstimate")
    if not abs(answer.stamp_s - scan.stamp_s) <= STAMP_TOLERANCE_S:
        raise EntryError(
            f"{spec}: the estimate is stamped {round(answer.stamp_s, 6)} s, its scan is at "
            f"{round(scan.stamp_s, 6)} s"
        )
    if len(answer.dynamic) != len(scan):
        raise EntryError(
            f"{spec}: dynamic has {len(answer.dynamic)} values for {len(scan)} returns"
        )
    away_m = float(np.linalg.norm(answer.start_from_lidar.translation))
    if not away_m <= FARTHEST_M:
        raise EntryError(f"{spec}: a pose {away_m:.3g} m from the start")
    return answer


def _spared(steps: Iterator[Step]) -> Iterator[Step]:
    return (step.without_moving() for step in steps)


def _warmed_up(spec: str, steps: Iterator[Step], mounting: Pose | None) -> Iterator[Step]:
    """Let an instance that is thrown away see the first scans, which compiles ours, then yield all.

    Others are not called more often than they are asked; of theirs the first call is not counted.
    """
    if spec in _WARM or not ODOMETRIES.resolve(spec).ours:
        return steps
    first = list(islice(steps, WARM_SCANS))
    plugin = guarded(spec, lambda: ODOMETRIES.make(spec))
    guarded(spec, plugin.reset, mounting)
    for step in first:
        copy = step.copied()
        guarded(spec, asked, plugin, copy.scan, copy.imu, copy.wheels)
    _WARM.add(spec)
    return chain(first, steps)


def _timed(spec: str, plugin: Any, step: Step) -> tuple[Any, float]:
    start = process_time()
    estimate = guarded(spec, asked, plugin, step.scan, step.imu, step.wheels)
    return estimate, (process_time() - start) * 1e3


def _joined(
    told: Sequence[OdometryEstimate], truths: Sequence[np.ndarray], moving: Sequence[np.ndarray],
    calls_ms: Sequence[float],
) -> Ride:  # fmt: skip
    poses = np.array([each.start_from_lidar.matrix for each in told])
    return Ride(
        Trajectories(poses, np.array(truths)),
        np.array([each.stamp_s for each in told]),
        np.array([not each.ok for each in told]),
        tuple(each.dynamic for each in told),
        tuple(moving),
        np.array(calls_ms),
    )
