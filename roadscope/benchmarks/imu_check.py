"""Checks whether IMU and wheels move as the scans do: that shows wrong units and mountings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.odometry.rigid import exp_so3, log_so3
from roadscope.odometry.travel import SETTLING, STEPS, matched_window

if TYPE_CHECKING:
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.benchmarks.odometry_runner import RecordedImu, RecordedWheels

MOST_TILT_DEG = 45.0
"""At rest a specific force points up, within this of a LiDAR's z axis. Chosen by hand: LiDARs on
cars are tilted by less."""
WINDOWS = 2
"""Greatest number of windows for turns, and for accelerations: those in which the IMU turns, or
accelerates, most."""
TRIES = 6
"""Greatest number of windows in which scans are matched, as some matches fail."""
LEAST_TURN_RAD = np.deg2rad(2.0)
"""Windows with less turn are not judged. Chosen by hand: scan matching errs by 0.1 degrees."""
LEAST_ACCELERATION = 1.0
"""Windows with less horizontal acceleration are not judged, m/s^2: gravity on a slope of 10 % looks
like this much."""
LEAST_SPEED_M_S = 2.0
"""Windows in which the wheels are slower are not judged. Chosen by hand."""
DEGREES_RATIO = 20.0
"""An IMU that turns more than this many times as far as the scans has rates in degrees (57.3
times)."""
RATIOS = (0.6, 1.6)
"""Limits of the ratio of the IMU's turn to that of the scans if both agree. Chosen by hand."""
LEAST_COSINE = 0.5
"""Cosine of the angle between two motions below which they are not the same: 60 degrees. With the
right mounting it is 0.96 and more (validation drives of 13 scenarios)."""


class Motion(NamedTuple):
    """Turn (rotation vector) and mean acceleration in a window, (3,) each, rad and m/s^2.

    In the LiDAR's axes at the start of the window.
    """

    turn: np.ndarray
    acceleration: np.ndarray


class MotionWindow(NamedTuple):
    """The motion in a window by both sensors."""

    by_imu: Motion
    by_scans: Motion


def doubt_of_imu(folder: ScanFolder, imu: RecordedImu) -> str:
    """Return how the motion of an IMU contradicts that of the scans; empty if it does not.

    Scans are matched without the IMU, by `voxel-map`, where the IMU turns or accelerates most.
    """
    if doubt := doubt_of_gravity(imu):
        return doubt
    starts = range(0, len(folder) - STEPS, STEPS)
    moved = [imu_motion(imu, *_times(folder, start)) for start in starts]
    turns = np.array([np.linalg.norm(each.turn) for each in moved])
    accelerations = np.array([np.linalg.norm(each.acceleration[:2]) for each in moved])
    by_scans = cache(lambda k: scan_motion(folder, starts[k]))
    windows: dict[int, MotionWindow] = {}
    for rows in (_greatest(turns, LEAST_TURN_RAD), _greatest(accelerations, LEAST_ACCELERATION)):
        known = ((k, by_scans(k)) for k in rows)
        pairs = ((k, MotionWindow(moved[k], motion)) for k, motion in known if motion is not None)
        windows.update(islice(pairs, WINDOWS))
    matched = list(windows.values())
    return doubt_of_turns(matched) or doubt_of_accelerations(matched)


def doubt_of_gravity(imu: RecordedImu) -> str:
    """Return how far the median specific force is from up, in words; empty if it points up."""
    force = np.median(imu.samples.specific_force, axis=0)
    if imu.lidar_from_imu is not None:
        force = imu.lidar_from_imu.rotation @ force
    tilt = _degrees(force[2] / np.linalg.norm(force))
    if tilt <= MOST_TILT_DEG:
        return ""
    return f"by its gravity, up is {tilt} degrees from the LiDAR's z axis: is --mounting right?"


def doubt_of_wheels(folder: ScanFolder, wheels: RecordedWheels) -> str:
    """Return how speeds of wheels contradict the motion of the scans; empty if they do not."""
    starts = range(0, len(folder) - STEPS, STEPS)
    speeds = np.array([_mean_speed(wheels, *_times(folder, start)) for start in starts])
    by_wheels, by_scans = list[float](), list[float]()
    for k in _greatest(speeds, LEAST_SPEED_M_S):
        settled = matched_window(folder, starts[k])
        if settled and len(by_wheels) < WINDOWS:
            first, last = settled[0], settled[-1]
            moved_m = (first.start_from_lidar.inverse() @ last.start_from_lidar).translation
            by_scans.append(float(np.linalg.norm(moved_m)) / (last.stamp_s - first.stamp_s))
            by_wheels.append(float(speeds[k]))
    if not by_wheels:
        return ""
    ratio = sum(by_wheels) / max(sum(by_scans), 1e-9)
    if RATIOS[0] < ratio < RATIOS[1]:
        return ""
    fast, slow = np.mean(by_wheels), np.mean(by_scans)
    return f"{fast:.3g} m/s where scans move at {slow:.3g}: are its speeds in m/s, not in km/h?"


def _mean_speed(wheels: RecordedWheels, start_s: float, end_s: float) -> float:
    speeds = np.abs(wheels.between(start_s, end_s).speeds)
    return float(speeds.mean()) if len(speeds) else 0.0


def doubt_of_turns(windows: Sequence[MotionWindow]) -> str:
    """Return how the turns of both sensors contradict each other; empty if they do not."""
    pairs = [(each.by_imu.turn, each.by_scans.turn) for each in windows]
    pairs = [pair for pair in pairs if max(map(np.linalg.norm, pair)) > LEAST_TURN_RAD]
    if not pairs:
        return ""
    by_imu, by_scans = (sum(float(np.linalg.norm(pair[k])) for pair in pairs) for k in (0, 1))
    ratio = by_imu / max(by_scans, 1e-9)
    difference = f"it turns by {np.rad2deg(by_imu):.3g} degrees where scans turn by "
    difference += f"{np.rad2deg(by_scans):.3g}"
    if ratio > DEGREES_RATIO:
        return f"{difference}: are its rates in degrees per second?"
    if (cosine := _cosine(pairs)) < LEAST_COSINE:
        return f"{difference}, about an axis {_degrees(cosine)} degrees away: is --mounting right?"
    if not RATIOS[0] < ratio < RATIOS[1]:
        return f"{difference}: are its rates in rad/s, and its stamps on the clock of the scans?"
    return ""


def doubt_of_accelerations(windows: Sequence[MotionWindow]) -> str:
    """Return how horizontal accelerations differ in direction; empty if they do not."""
    pairs = [(each.by_imu.acceleration[:2], each.by_scans.acceleration[:2]) for each in windows]
    pairs = [pair for pair in pairs if min(map(np.linalg.norm, pair)) > LEAST_ACCELERATION]
    if not pairs or (cosine := _cosine(pairs)) > LEAST_COSINE:
        return ""
    degrees = _degrees(cosine)
    return f"it accelerates {degrees} degrees away from where scans do: is --mounting right?"


def _degrees(cosine: float) -> int:
    return round(float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))))


def _cosine(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Return the mean cosine between vectors, weighted by their lengths."""
    products = sum(float(a @ b) for a, b in pairs)
    return products / sum(float(np.linalg.norm(a) * np.linalg.norm(b)) for a, b in pairs)


def _greatest(values: np.ndarray, least: float) -> list[int]:
    """Return the rows of the greatest values that are large enough, the greatest first."""
    rows: list[int] = np.argsort(-values, kind="stable")[:TRIES].tolist()
    return [row for row in rows if values[row] > least]


def _times(folder: ScanFolder, start: int) -> tuple[float, float]:
    """Return first and last stamp of the part of a window in which scan matching has settled."""
    return folder.stamps_s[start + SETTLING], folder.stamps_s[start + STEPS]


def imu_motion(imu: RecordedImu, start_s: float, end_s: float) -> Motion:
    """Return the motion from one time to another by the IMU.

    The median specific force of the whole drive counts as gravity; what differs from it is
    acceleration.
    """
    samples = imu.between(start_s, end_s)
    rotation = np.eye(3) if imu.lidar_from_imu is None else imu.lidar_from_imu.rotation
    if not len(samples.stamps_s):
        return Motion(np.zeros(3), np.zeros(3))
    steps = np.diff(samples.stamps_s, prepend=start_s)
    start_from_imu, force = np.eye(3), np.zeros(3)
    for rate, sensed, step in zip(
        samples.angular_velocity, samples.specific_force, steps, strict=True
    ):
        start_from_imu = start_from_imu @ exp_so3(rate * step)
        force += start_from_imu @ sensed * step
    mean = force / steps.sum() - np.median(imu.samples.specific_force, axis=0)
    # The sum of all turns, so that rates in degrees are not taken modulo a full turn.
    turn = (samples.angular_velocity * steps[:, None]).sum(axis=0)
    return Motion(rotation @ turn, rotation @ mean)


def scan_motion(folder: ScanFolder, start: int) -> Motion | None:
    """Return the motion in a window by matching its scans; None where they do not show it."""
    settled = matched_window(folder, start)
    if not settled:
        return None
    start_from_lidar = [each.start_from_lidar.matrix for each in settled]
    moved = np.linalg.inv(start_from_lidar[0]) @ np.array(start_from_lidar)
    times_s = np.array([each.stamp_s for each in settled]) - settled[0].stamp_s
    curve = np.polynomial.polynomial.polyfit(times_s, moved[:, :3, 3], 2)
    return Motion(log_so3(moved[-1, :3, :3]), 2 * curve[2])
