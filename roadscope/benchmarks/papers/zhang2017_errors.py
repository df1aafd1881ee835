"""Errors of estimated poses as Zhang 2017 counts them: RMSE over the frames of a run."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.papers.zhang2017_methods import Poses
from roadscope.benchmarks.papers.zhang2017_scene import Run
from roadscope.detectors.pose.estimate import axis_difference

FEWEST_RETURNS = 3
"""Frames with fewer returns of the car are not scored."""
LATERAL, LONGITUDINAL, HEADING, POSITION = ("lateral", "longitudinal", "heading", "position")
UNITS = {LATERAL: "m", LONGITUDINAL: "m", HEADING: "deg", POSITION: "m"}
"""The columns of tables 1 and 2: RMSE across and along the car's true heading, of the heading,
and of the distance. The paper does not say along which axes; on the straight its own are those of
the world."""
MEDIAN_POSITION, MEDIAN_HEADING = "median position", "median heading"
TURNED, SILENT = "turned by 90 deg", "no answer"
BESIDE_UNITS = {MEDIAN_POSITION: "m", MEDIAN_HEADING: "deg", TURNED: "%", SILENT: "%"}
FLIPPED = np.pi / 4
"""A heading that is off by more has taken a side for the rear."""


def scored(run: Run) -> np.ndarray:
    """(K,) bool: frames with at least `FEWEST_RETURNS` returns of the car."""
    return np.array([shot.target.sum() >= FEWEST_RETURNS for shot in run.shots])


def errors(run: Run, poses: Poses) -> np.ndarray:
    """(K, 3) estimate minus truth along and across the car (metres) and in heading (radians).

    NaN where there is no estimate. A rectangle has no front: headings count up to half a turn.
    """
    off, yaw = _offsets(run, poses), run.truth[:, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    along = c * off[:, 0] + s * off[:, 1]
    across = c * off[:, 1] - s * off[:, 0]
    return np.column_stack([along, across, off[:, 2]])


def _offsets(run: Run, poses: Poses) -> np.ndarray:
    """(K, 3) estimate minus truth, world frame, NaN where there is no estimate."""
    rows = np.full((len(run.shots), 3), np.nan)
    for k, pose in enumerate(poses):
        if pose is not None:
            rows[k] = pose.x, pose.y, pose.yaw
    truth = run.truth
    turned = axis_difference(rows[:, 2], truth[:, 2])
    return np.column_stack([rows[:, :2] - truth[:, :2], turned])


def rmse(run: Run, found: np.ndarray) -> dict[str, float]:
    """Return the columns of tables 1 and 2 from the (K, 3) errors."""
    used = found[scored(run) & np.isfinite(found[:, 0])]
    squares = (used**2).mean(axis=0) if len(used) else np.full(3, np.nan)
    return named_columns(squares)


def typical(run: Run, found: np.ndarray) -> dict[str, float]:
    """Return medians and the percentages of scored frames that RMSE hides."""
    used = found[scored(run)]
    known = used[np.isfinite(used[:, 0])]
    if not len(known):
        return {MEDIAN_POSITION: np.nan, MEDIAN_HEADING: np.nan, TURNED: 0.0, SILENT: 100.0}
    away, turned = np.hypot(known[:, 0], known[:, 1]), np.abs(known[:, 2])
    return {
        MEDIAN_POSITION: float(np.median(away)),
        MEDIAN_HEADING: float(np.degrees(np.median(turned))),
        TURNED: 100.0 * float((turned > FLIPPED).sum() / len(used)),
        SILENT: 100.0 * (1.0 - len(known) / len(used)),
    }


def nees(run: Run, poses: Poses) -> float:
    """Return the mean over scored frames of squared errors in units of the covariance.

    3 is expected of x, y and yaw. NaN where the method gives no covariance.
    """
    values = [
        float(off @ np.linalg.solve(pose.covariance, off))
        for off, pose, counts in zip(_offsets(run, poses), poses, scored(run), strict=True)
        if counts and pose is not None and pose.covariance is not None
    ]
    return float(np.mean(values)) if values else np.nan


def named_columns(squares: np.ndarray) -> dict[str, float]:
    """Name mean squares along, across (square metres) and in heading (square radians)."""
    return {
        LATERAL: float(np.sqrt(squares[1])),
        LONGITUDINAL: float(np.sqrt(squares[0])),
        HEADING: float(np.degrees(np.sqrt(squares[2]))),
        POSITION: float(np.sqrt(squares[0] + squares[1])),
    }
