"""What an odometry promises, one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from operator import methodcaller
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.check.items import (
    Promise,
    PromiseError,
    begins,
    begun,
    has_method,
    leaving_alone,
    settled,
)
from roadscope.benchmarks.drive import Step, drive, imu_mounting, select
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.ride import checked
from roadscope.benchmarks.jobs.stack import EntryError, guarded
from roadscope.benchmarks.metrics.odometry import Trajectories, absolute_errors
from roadscope.core import LidarScan, OdometryEstimate
from roadscope.core.registry import Plugin

SCENE = Episode("two-way", 0, "vlp16-imu", 2.0)
"""Traffic, one of the training seeds, sensors, length."""
FEW = 8
START_M = 1e-6


@lru_cache(maxsize=1)
def steps() -> tuple[Step, ...]:
    """Return the scans of the two-second scene."""
    return tuple(drive(SCENE))


def updated(plugin: Plugin[Any], odometry: Any, step: Step) -> OdometryEstimate:
    """Call update; an answer that is not what the contract says is a fault."""
    answer = guarded(plugin.spec, odometry.update, step.scan, step.imu)
    try:
        return checked(plugin.spec, answer, step.scan)
    except EntryError as error:
        raise PromiseError(str(error).removeprefix(f"{plugin.spec}: ")) from None


def told(plugin: Plugin[Any], odometry: Any) -> list[OdometryEstimate]:
    """Run an odometry over the first scans of the scene."""
    return _over(plugin, odometry, steps()[:FEW])


def _over(plugin: Plugin[Any], odometry: Any, scans: Sequence[Step]) -> list[OdometryEstimate]:
    return [updated(plugin, odometry, step) for step in scans]


def methods(plugin: Plugin[Any]) -> str:
    """Look for reset, with and without the mounting of the IMU, and update."""
    has_method(plugin, "reset")
    has_method(plugin, "reset", "lidar_from_imu")
    has_method(plugin, "update", "scan", "imu")
    return ""


def answers(plugin: Plugin[Any]) -> str:
    """Look at what comes back: the first pose is the start."""
    first = told(plugin, begun(plugin))[0].start_from_lidar
    away_m = float(np.linalg.norm(first.translation))
    turned = float(np.abs(first.matrix[:3, :3] - np.eye(3)).max())
    if max(away_m, turned) > START_M:
        raise PromiseError(
            f"the first pose is {away_m:.3g} m from the start; poses are start_from_lidar, in the "
            "LiDAR's frame of the first scan"
        )
    return ""


def without_imu(plugin: Plugin[Any]) -> str:
    """Look at scans that come without inertial samples."""
    _over(plugin, begun(plugin), [replace(step, imu=None) for step in steps()[:FEW]])
    return ""


def poor_scans(plugin: Plugin[Any]) -> str:
    """Look at scans of no return and of returns that are no numbers, at first and in between."""
    spoilt = [_spoilt(step, k) for k, step in enumerate(steps()[: FEW + 2])]
    words = {each.status.value for each in _over(plugin, begun(plugin), spoilt)[::3]}
    return "" if words == {"degraded"} else "a scan without returns is not called degraded"


def _spoilt(step: Step, k: int) -> Step:
    none = select(step.scan, slice(0, 0))
    return replace(step, scan={0: none, 2: _without_numbers(step.scan)}.get(k % 3, step.scan))


def _without_numbers(scan: LidarScan) -> LidarScan:
    spoilt = select(scan, slice(None))
    spoilt.points[::5] = np.nan
    return spoilt


def two_seconds(plugin: Plugin[Any]) -> str:
    """Follow two seconds of traffic; how well is remarked."""
    odometry = plugin.make()
    guarded(plugin.spec, methodcaller("reset", imu_mounting(SCENE)), odometry)
    poses, calls_ms = [], []
    for step in steps():
        given, start = step.copied(), process_time()
        estimate = updated(plugin, odometry, given)
        calls_ms.append((process_time() - start) * 1e3)
        poses.append(estimate.start_from_lidar.matrix)
    truth = np.array([step.world_from_lidar.matrix for step in steps()])
    errors = absolute_errors(Trajectories(np.array(poses), truth), "origin")
    return (
        f"{errors.end_m:.2f} m off after {errors.distances_m[-1]:.0f} m among traffic, "
        f"{np.median(calls_ms):.2g} ms a scan"
    )


PROMISES = (
    *begins("update", methods),
    Promise("answers each scan with a pose, the first at the start", answers, steps),
    leaving_alone(
        updated, lambda: steps()[:FEW], "update changed the scan or the samples it was given"
    ),
    Promise("goes on without an IMU", without_imu),
    Promise("goes on after scans without returns or numbers", poor_scans),
    *settled(told, "scans", "poses"),
    Promise("follows two seconds of traffic", two_seconds),
)
