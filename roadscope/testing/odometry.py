"""The promises of odometries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from roadscope.benchmarks.drive_steps import Step, drive
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.kinds import ODOMETRY
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.trajectory_errors import absolute_errors
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.core import OdometryEstimate, OdometryStatus, Pose, Spec
from roadscope.core.answers import check_estimate
from roadscope.testing.shared import figure_in_words, input_promise, memory_promises, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

SCENE = Episode("two-way", 0, "vlp16-imu", 2.0)
"""Traffic, one of the training seeds, sensors, seconds."""
OTHER_SCENE = Episode("racetrack", 1, "vlp16-imu", 1.0)
"""What an odometry gets before a reset, and has to forget."""
FEW = 8
"""Scans, the first of the scene, that most promises use."""
EVERY_EMPTY = 3
"""One scan in this many has no returns where empty scans are tested."""
START_TOLERANCE = 1e-6
"""For the first pose: metres, and entries of the rotation matrix."""
REFERENCE, MARK = "lidar-inertial", "still"
SHARE_OF_STILL = 0.5
"""An odometry is broken if its error is a greater share of the distance driven, which is the error
of `still`.

Chosen by hand: an odometry that uses its scans has an error of a few hundredths of the distance.
"""


@lru_cache(maxsize=2)
def steps(scene: Episode = SCENE) -> tuple[Step, ...]:
    """Return the scans of a scene."""
    return tuple(drive(scene))


def estimate(instance: Instance, consecutive: Sequence[Step]) -> list[OdometryEstimate]:
    """Return the estimates of consecutive scans."""
    return [
        check_estimate(
            instance.call("update", step.scan, step.imu),
            stamp_s=step.scan.stamp_s,
            returns=len(step.scan),
        )
        for step in consecutive
    ]


def estimate_few(instance: Instance) -> list[OdometryEstimate]:
    """Return the estimates of the first scans of the scene."""
    return estimate(instance, steps()[:FEW])


def answers(subject: Subject) -> str:
    """Run it over a few scans, and refuse a first pose that is not the start."""
    with subject.started() as instance:
        first = estimate_few(instance)[0].start_from_lidar
    away_m = float(np.linalg.norm(first.translation))
    turned = float(np.abs(first.matrix[:3, :3] - np.eye(3)).max())
    if max(away_m, turned) > START_TOLERANCE:
        raise PromiseError(
            f"the first pose is {away_m:.3g} m from the start; poses are start_from_lidar, in the "
            "LiDAR's frame of the first scan"
        )
    return ""


def without_imu(subject: Subject) -> str:
    """Run it over scans that come without inertial samples."""
    with subject.started() as instance:
        estimate(instance, [replace(step, imu=None) for step in steps()[:FEW]])
    return ""


def empty_scans(subject: Subject) -> str:
    """Run it over scans; some of them have no returns, the first one included."""
    scans = [
        step if number % EVERY_EMPTY else replace(step, scan=step.scan.select(np.empty(0, int)))
        for number, step in enumerate(steps()[: FEW + 2])
    ]
    with subject.started() as instance:
        estimates = estimate(instance, scans)[::EVERY_EMPTY]
    good = all(each.status is OdometryStatus.DEGRADED for each in estimates)
    return "" if good else "the status of scans without returns is not DEGRADED"


def compare(subject: Subject) -> str:
    """Estimate two seconds of a drive; refuse an error that is a large share of the distance."""
    error_m = _end_error_m(subject.spec, subject.options)
    beside = {name: _error_of(name) for name in (REFERENCE, MARK)}
    words = figure_in_words(
        "error after two seconds among traffic", error_m, beside=beside, unit=" m"
    )
    if error_m > SHARE_OF_STILL * beside[MARK]:
        raise PromiseError(f"{words}: poses are start_from_lidar, metres, x ahead, y left, z up")
    return words


@lru_cache(maxsize=2)
def _error_of(name: str) -> float:
    return _end_error_m(ODOMETRY.registry.resolve(name), RunOptions())


def _end_error_m(spec: Spec, options: RunOptions) -> float:
    poses = PoseNode(spec, SCENE).compute(options)
    return float(absolute_errors(poses.trajectories, "origin").end_m)


RESETS: tuple[tuple[Pose | None, ...], ...] = ((), (Pose.identity(),))
"""Arguments of `reset`: without and with `lidar_from_imu`."""
PROMISES = (
    *start_promises("update", "scan, imu", RESETS),
    Promise("answers each scan with a pose, the first at the start", answers),
    input_promise(estimate_few),
    Promise("goes on without an IMU", without_imu),
    Promise("goes on after scans without returns", empty_scans),
    *memory_promises(
        estimate_few,
        lambda instance: estimate(instance, steps(OTHER_SCENE)),
        inputs="scans",
        answers="poses",
    ),
    Promise("follows two seconds of traffic", compare),
)
