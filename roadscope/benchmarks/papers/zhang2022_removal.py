"""Dynamic points of two scans 1 s apart, removed (Zhang 2022, section 3.1)."""

from __future__ import annotations

from time import process_time

import numpy as np

from roadscope.benchmarks.papers.zhang2022_plays import APART
from roadscope.benchmarks.papers.zhang2022_scene import IMU, LIDAR, Play, Shot, film
from roadscope.odometry.loam.progress import ImuPrediction
from roadscope.odometry.zhang import ZhangOdometry, dynamic_returns

BEFORE, AFTER, PRECISION, RECALL, MS = "before", "after", "precision", "recall", "ms"
TURNS = 5
"""The time is the median of so many; before, one that is not counted compiles."""
LIDAR_FROM_IMU = LIDAR.ego_from_lidar.inverse() @ IMU.ego_from_imu


def removal(
    play: Play, seed: int, apart: int = APART, rule: ZhangOdometry | None = None
) -> dict[str, float]:
    """Return points before and after, precision and recall in per cent, and milliseconds.

    apart: scans between the two; nan for the recall where nobody is seen who walks. rule: a
        reading of the paper; None: the one taken.
    """
    shots = list(film(play, seed))
    first, last = shots[-1 - apart], shots[-1]
    motion = predicted(shots, apart)
    rule = ZhangOdometry() if rule is None else rule
    took_s = []
    for _ in range(1 + TURNS):
        start = process_time()
        told = dynamic_returns(rule, first.scan, last.scan, motion)
        # Both scans are clustered; an odometry has the one before.
        took_s.append((process_time() - start) / 2)
    right = float((told & last.moving).sum())
    claimed, there = float(told.sum()), float(last.moving.sum())
    return {
        BEFORE: float(len(told)),
        AFTER: float(len(told)) - claimed,
        PRECISION: 100 * right / claimed if claimed else np.nan,
        RECALL: 100 * right / there if there else np.nan,
        MS: 1e3 * float(np.median(took_s[1:])),
    }


def predicted(shots: list[Shot], apart: int) -> np.ndarray:
    """Return the (4, 4) motion by the IMU between the two scans, from the true speed at the first.

    An odometry knows that from its steps.
    """
    imu = ImuPrediction(LIDAR_FROM_IMU)
    for shot in shots:
        imu.add(shot.imu)
    imu.velocity = shots[-1 - apart].velocity
    return imu.motion(shots[-1 - apart].scan.stamp_s, shots[-1].scan.stamp_s)
