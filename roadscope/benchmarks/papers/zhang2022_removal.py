"""Section 3.1 of Zhang 2022: the dynamic points of two scans 1 s apart are removed."""

from __future__ import annotations

from collections.abc import Sequence
from time import process_time
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.papers.reproduction import FigureKey, Figures
from roadscope.benchmarks.papers.zhang2022_scene import (
    LIDAR_FROM_IMU,
    REMOVAL_CASES,
    SCANS_APART,
    CorridorSweep,
    sense_corridor,
)
from roadscope.odometry.clusters.segments import Clustering
from roadscope.odometry.loam.progress import ImuPrediction
from roadscope.odometry.zhang import DynamicThreshold, ZhangOdometry, ZhangSettings, dynamic_returns

REMOVAL = "dynamic points, case {}"
"""Title of the table of a case."""
BEFORE, AFTER, PRECISION, RECALL = "before", "after", "precision", "recall"
TIME_MS = "ms"
"""Quantities; the name of the time is its unit."""
TIMED_CALLS = 5
"""The time is the median of this many calls; one before them compiles and is not counted."""


class RemovalVariant(NamedTuple):
    """One way to run the removal.

    scans_apart: between the two scans, 0.1 s each. settings: of `ZhangOdometry`.
    knows_speed: whether the true velocity at the earlier scan is given.
    """

    scans_apart: int
    settings: ZhangSettings = ZhangSettings()
    knows_speed: bool = True


_FROM_ABOVE = DynamicThreshold(dimensions=2, sampled=0.01)
_BOUNDED_LINKS = ZhangSettings(windows=False)
REMOVAL_VARIANTS = {
    "zhang2022, 1 s apart": RemovalVariant(SCANS_APART),
    "zhang2022, 0.1 s apart": RemovalVariant(1),
    "speed unknown, 1 s": RemovalVariant(SCANS_APART, knows_speed=False),
    "displaced in x and y, 1 s": RemovalVariant(SCANS_APART, ZhangSettings(threshold=_FROM_ABOVE)),
    "epsilon as printed, 1 s": RemovalVariant(
        SCANS_APART, ZhangSettings(clustering=Clustering(spacings=0.0))
    ),
    "angle bounds links, 1 s": RemovalVariant(SCANS_APART, _BOUNDED_LINKS),
    "angle bounds links, 0.1 s": RemovalVariant(1, _BOUNDED_LINKS),
}


def measure_removal(seed: int) -> Figures:
    """Return the figures of all cases and variants."""
    figures: Figures = {}
    for case, experiment in REMOVAL_CASES.items():
        sweeps = list(sense_corridor(experiment, seed))
        for name, variant in REMOVAL_VARIANTS.items():
            for quantity, value in removal(sweeps, variant).items():
                figures[FigureKey(REMOVAL.format(case), name, quantity)] = value
    return figures


def removal(sweeps: Sequence[CorridorSweep], variant: RemovalVariant) -> dict[str, float]:
    """Return points before and after, precision and recall in per cent, and milliseconds.

    sweeps: all of a case. Precision is NaN where nothing was removed, recall where no walking
    person has returns.
    """
    before, now = sweeps[-1 - variant.scans_apart], sweeps[-1]
    motion = predicted_motion(sweeps, variant.scans_apart, knows_speed=variant.knows_speed)
    rule = ZhangOdometry(variant.settings)
    times_s = []
    for _ in range(1 + TIMED_CALLS):
        start = process_time()
        dynamic = dynamic_returns(rule, before.scan, now.scan, motion)
        # Both scans are clustered; an odometry keeps the clusters of the scan before.
        times_s.append((process_time() - start) / 2)
    right = float((dynamic & now.moving).sum())
    removed, moving = float(dynamic.sum()), float(now.moving.sum())
    return {
        BEFORE: float(len(dynamic)),
        AFTER: float(len(dynamic)) - removed,
        PRECISION: 100 * right / removed if removed else np.nan,
        RECALL: 100 * right / moving if moving else np.nan,
        TIME_MS: 1e3 * float(np.median(times_s[1:])),
    }


def predicted_motion(
    sweeps: Sequence[CorridorSweep], scans_apart: int, *, knows_speed: bool = True
) -> np.ndarray:
    """Return the (4, 4) motion by the IMU from an earlier sweep to the last (eq. 3).

    knows_speed: it starts with the true velocity at the earlier sweep, which an odometry knows
    from its steps; otherwise at rest.
    """
    imu = ImuPrediction(LIDAR_FROM_IMU)
    for sweep in sweeps:
        imu.add(sweep.imu)
    if knows_speed:
        imu.velocity = sweeps[-1 - scans_apart].velocity
    return imu.motion(sweeps[-1 - scans_apart].scan.stamp_s, sweeps[-1].scan.stamp_s)
