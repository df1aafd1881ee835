"""The direction of travel in a LiDAR's own axes, whose x axis need not point ahead."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from roadscope.core import LidarScan, OdometryEstimate, Pose, wrap_angle
from roadscope.odometry.voxel_map import VoxelMapOdometry

STEPS = 11
"""Steps from scan to scan in a window in which scans are matched."""
SETTLING = 3
"""Steps of a window after which the speed of scan matching has converged."""
PLACES = 8
"""Greatest number of windows in a recording that are tried. Chosen by hand."""
GUESSES_RAD = (0.0, np.pi / 2, -np.pi / 2)
"""Directions that are tried one after the other: `voxel-map` looks for the first speed along x, and
finds it if the direction is wrong by 45 degrees, or by 180."""
WINDOWS = 3
"""Number of windows that have to agree on the direction. Chosen by hand."""
LEAST_M = 3.0
"""Least distance driven in a window. On validation drives of 15 scenarios, matches that moving
objects mislead have up to 1.3 m, and those of 3 m and more are within 13 degrees of the true
direction."""
AGREEMENT_RAD = np.deg2rad(20.0)
"""Directions agree if they differ from their mean by at most this; in a bend they differ by 13
degrees. The x axis points ahead if the direction of travel differs from it by less than this."""
SQUARE_RAD = np.deg2rad(15.0)
"""A direction this near to a multiple of 90 degrees is replaced by it. Chosen by hand."""


class RecordedScans(Protocol):
    """Scans in order that can be read again."""

    def __len__(self) -> int:
        """Return how many there are."""

    def part(self, first: int, end: int) -> Iterable[LidarScan]:
        """Return the scans from `first` up to but not including `end`."""


def matched_window(
    recorded: RecordedScans, start: int, guess: float = 0.0
) -> list[OdometryEstimate]:
    """Return the estimates of `voxel-map`, without an IMU, in a window after `SETTLING` steps.

    It is empty where scans do not determine the motion. start: number of the window's first scan.
    guess: assumed azimuth of the direction of travel, radians.
    """
    turn, odometry = Pose.from_euler(0, 0, 0, yaw=-guess), VoxelMapOdometry()
    scans = recorded.part(start, start + STEPS + 1)
    turned = (turned_scan(scan, turn.rotation) if guess else scan for scan in scans)
    settled = [odometry.update(scan) for scan in turned][SETTLING:]
    if len(settled) <= STEPS - SETTLING or not all(each.ok for each in settled):
        return []
    return [turned_back(each, turn) for each in settled] if guess else settled


def direction_of_travel(recorded: RecordedScans) -> float | None:
    """Return the azimuth of the direction of travel in the LiDAR's axes, radians; None if unclear.

    A LiDAR that drives backwards all the time counts as mounted backwards.
    """
    last = len(recorded) - STEPS - 1
    if last < 0:
        return None
    starts: list[int] = np.unique(np.linspace(0, last, PLACES).round().astype(int)).tolist()
    for guess in GUESSES_RAD:
        matched, directions = 0, list[float]()
        for start in starts:
            window = matched_window(recorded, start, guess)
            direction = window_direction(window) if window else None
            matched += bool(window)
            directions += [] if direction is None else [direction]
            if len(directions) == WINDOWS:
                return agreed_direction(directions)
        if matched >= WINDOWS:  # Scans can be matched, so the LiDAR is slow or stands.
            return None
    return None


def agreed_direction(directions: Sequence[float]) -> float | None:
    """Return the direction that all windows agree on, radians; None if they do not agree."""
    middle = float(np.angle(np.exp(1j * np.array(directions)).mean()))
    if any(abs(wrap_angle(each - middle)) > AGREEMENT_RAD for each in directions):
        return None
    right_angle = float(np.round(middle / (np.pi / 2)) * np.pi / 2)
    is_near = abs(wrap_angle(middle - right_angle)) < SQUARE_RAD
    return float(wrap_angle(right_angle if is_near else middle))


def window_direction(estimates: Sequence[OdometryEstimate]) -> float | None:
    """Return the azimuth of the motion in a window, radians; None if it is short."""
    first, last = (each.start_from_lidar for each in (estimates[0], estimates[-1]))
    moved = first.inverse() @ last
    if np.linalg.norm(moved.translation[:2]) < LEAST_M:
        return None
    # In a bend the direction of the chord is the mean of the first and the last direction.
    return float(np.arctan2(moved.translation[1], moved.translation[0])) - moved.yaw / 2


def turned_scan(scan: LidarScan, rotation: np.ndarray) -> LidarScan:
    """Return a scan whose points are rotated; rotation: (3, 3)."""
    return replace(scan, points=(scan.points @ rotation.T).astype(np.float32))


def turned_back(estimate: OdometryEstimate, turn: Pose) -> OdometryEstimate:
    """Return an estimate that was made from rotated scans in the axes of the LiDAR.

    turn: rotation from the LiDAR's axes to those of the scans, without translation.
    """
    both = np.kron(np.eye(2), turn.rotation)
    covariance = both.T @ estimate.covariance @ both
    return replace(
        estimate,
        start_from_lidar=turn.inverse() @ estimate.start_from_lidar @ turn,
        covariance=(covariance + covariance.T) / 2,
    )
