"""Scenes, motions of them, and comparisons of boxes that the laws share."""

from dataclasses import replace

import numpy as np
from toy_lidar import CALIBRATION, scan

from roadscope.core import Calibration, Detections, Frame, Pose, wrap_angle

MOUNT = CALIBRATION.pose("lux")
LIMITED = np.radians(np.arange(-54.875, 55, 0.25))
"""Columns stand between whole degrees, on which sectors of angle begin."""
AROUND = np.radians(np.arange(179.75, -180, -0.5))
LAYERS = np.linspace(-6, 4, 6)

DECIDED = (
    (20.0, 6.0, 4.6, 1.85, 1.5, 0.15),
    (32.0, -4.0, 4.4, 1.8, 1.5, 0.1),
    (14.0, -9.0, 4.6, 1.85, 1.5, 0.5),
    (-13.0, 5.0, 4.5, 1.8, 1.5, -0.2),
)
"""Cars, ahead and behind, that show a flank: the visible returns distinguish front and side."""


def look_around(boxes=DECIDED, *, seed: int = 0, **options) -> Frame:
    """One full turn; noise puts the returns in general position."""
    options = {"azimuths": AROUND, "elevations": LAYERS, "noise_m": 0.02, **options}
    return Frame(1.0, CALIBRATION, scan(boxes, seed=seed, **options))


def look_ahead(boxes=DECIDED[:3], *, seed: int = 0, **options) -> Frame:
    """One sweep of a sensor that looks ahead."""
    options = {"azimuths": LIMITED, "noise_m": 0.02, **options}
    return Frame(1.0, CALIBRATION, scan(boxes, seed=seed, **options))


def film(*, count: int = 7, seed: int = 0, start_s: float = 1.0, speed_m_s: float = 0.0):
    """Frames 0.1 s apart of one car that comes nearer by 1 m a frame among others that stand.

    A detector of what moves needs to have seen what stands. At a speed the ego drives a bend and
    its odometry says how.
    """
    frames, before = [], None
    for k in range(count):
        world_from_ego = Pose.planar(0.1 * speed_m_s * k, 0.0, 0.002 * speed_m_s * k)
        sweep = scan(
            [_in_ego_frame(world_from_ego, b) for b in (_oncoming(count - 1 - k), *DECIDED[1:3])],
            seed=seed + k,
            azimuths=LIMITED,
            noise_m=0.02,
        )
        stamp_s = start_s + 0.1 * k
        own = before.inverse() @ world_from_ego if before is not None and speed_m_s else None
        sweep = replace(sweep, stamp_s=stamp_s)
        frames.append(Frame(stamp_s, CALIBRATION, sweep, previous_from_ego=own))
        before = world_from_ego
    return frames


def _oncoming(to_come_m: float):
    return (22.0 + to_come_m, 1.0, 4.6, 1.85, 1.5, 0.1)


def _in_ego_frame(world_from_ego: Pose, box):
    x, y, _ = world_from_ego.inverse().apply(np.array([[box[0], box[1], 0.0]]))[0]
    return (x, y, *box[2:5], box[5] - world_from_ego.yaw)


def mounted(frame: Frame, pose: Pose) -> Frame:
    return replace(frame, calibration=Calibration(((frame.lidar.sensor, pose),)))


def carried(frame: Frame, motion: Pose) -> Frame:
    """Move scene and sensor together within the ego frame."""
    there = mounted(frame, motion @ frame.calibration.pose(frame.lidar.sensor))
    if frame.previous_from_ego is None:
        return there
    own = motion @ frame.previous_from_ego @ motion.inverse()
    return replace(there, previous_from_ego=own)


def turned_sensor(frame: Frame, inside: Pose) -> Frame:
    """Mount the sensor otherwise; every return stays where it is in the ego frame."""
    sweep = frame.lidar
    points = inside.inverse().apply(sweep.points)
    there = replace(frame, lidar=replace(sweep, points=points))
    return mounted(there, frame.calibration.pose(sweep.sensor) @ inside)


def mirrored(frame: Frame) -> Frame:
    """Swap left and right, and with them the direction in which the sensor turns."""
    sweep = frame.lidar
    points = sweep.points * np.array([1, -1, 1], np.float32)
    column = sweep.column.max(initial=0) - sweep.column
    own = frame.previous_from_ego
    if own is not None:
        own = Pose.planar(own.translation[0], -own.translation[1], -own.yaw)
    there = replace(sweep, points=points, column=column)
    return replace(frame, lidar=there, previous_from_ego=own)


def mirror_boxes(boxes: Detections) -> Detections:
    return replace(boxes, centres=boxes.centres * [1, -1, 1], yaws=wrap_angle(-boxes.yaws))


KEPT = ("sizes", "scores")


def differences(boxes: Detections, expected: Detections) -> np.ndarray:
    """Greatest difference, (4,), of place and size in metres, axis in radians, and score.

    Boxes are paired one to one; inf where that cannot be.
    """
    if len(boxes) != len(expected):
        return np.full(4, np.inf)
    worst, free = np.zeros(4), list(range(len(expected)))
    for row in range(len(boxes)):
        gaps = [np.hypot(*(expected.centres[k] - boxes.centres[row])[:2]) for k in free]
        k = free.pop(int(np.argmin(gaps)))
        axis = (boxes.yaws[row] - expected.yaws[k] + np.pi / 2) % np.pi - np.pi / 2
        size, score = (abs(getattr(boxes, n)[row] - getattr(expected, n)[k]) for n in KEPT)
        worst = np.maximum(worst, [min(gaps), size.max(), abs(axis), score])
    return worst
