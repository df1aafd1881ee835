"""How the car moves on between the frames that the information floor joins.

It moves along its heading and departs from its true way by a constant speed and turn rate, both
unknown, and by a constant acceleration where that is unknown, too.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S
from roadscope.benchmarks.papers.zhang2017_scene import Run
from roadscope.core.pose import wrap_angle
from roadscope.detectors.pose.smoother import ACCELERATION_SD

SPEED_M_S, RATE_RAD_S = 20.0, np.radians(60.0)
"""Standard deviations of the first proposal of speed and turn rate; their prior is flat."""
STATE = 5
"""Offsets of x, y, yaw, speed and turn rate; of the acceleration beside them if that is unknown."""
STEP = 1e-5


def motion_of(run: Run, k: int) -> tuple[float, float]:
    """Return speed and turn rate of the car at a frame."""
    step = 1e-3
    before, after = run.drive.car(FRAME_S * k + np.array([-step, step]))
    way = after - before
    return float(np.hypot(*way[:2]) / (2 * step)), float(wrap_angle(way[2]) / (2 * step))


def acceleration_of(run: Run, k: int) -> float:
    """Return by how much the car gains speed at a frame, m/s2."""
    step = 1e-2
    before, now, after = run.drive.car(FRAME_S * k + np.array([-step, 0.0, step]))
    gained = (after - 2 * now + before)[:2] / step**2
    return float(gained @ [np.cos(now[2]), np.sin(now[2])])


def log_prior(offsets: np.ndarray, true: float) -> np.ndarray:
    """Return how likely (N,) accelerations off the true one are, as our fit supposes."""
    logs: np.ndarray = -0.5 * ((offsets + true) / ACCELERATION_SD) ** 2
    return logs


def offsets_after(states: np.ndarray, motion: tuple[float, float], time_s: float) -> np.ndarray:
    """Return (N, 3) offsets from the true pose a time later.

    states: (N, 5 or 6) offsets of x, y, yaw, speed, turn rate and acceleration from the truth now.
    motion: true speed and turn rate. Offsets are in the frame of the true pose then.
    """
    truth = _arrived(np.zeros((1, STATE)), motion, time_s)[0]
    moved = _arrived(states, motion, time_s) - truth
    c, s = np.cos(truth[2]), np.sin(truth[2])
    return np.ascontiguousarray(moved @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _arrived(states: np.ndarray, motion: tuple[float, float], time_s: float) -> np.ndarray:
    x, y, yaw, speed, rate = states.T[:STATE]
    gained = 0.5 * states[:, STATE:].sum(axis=1) * time_s
    half = 0.5 * (motion[1] + rate) * time_s
    way = (motion[0] + speed + gained) * time_s * np.sinc(half / np.pi)
    return np.column_stack(
        [x + way * np.cos(yaw + half), y + way * np.sin(yaw + half), yaw + 2 * half]
    )


def joined(
    motion: tuple[float, float],
    answers: Iterable[tuple[float, np.ndarray, np.ndarray]],
    acceleration: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Join frames' posteriors as if they were normal; return mean and covariance of the state.

    answers: time from now, mean (3 + E,) and covariance of a frame's pose and of E unknowns that
    do not change; the state has them last. acceleration: the true one, m/s2, where it is unknown;
    None where it is known.
    """
    moving = STATE + (acceleration is not None)
    information, pull = np.zeros((0, 0)), np.zeros(0)
    for time_s, mean, covariance in answers:
        if not len(pull):
            size = moving + len(mean) - 3
            information, pull = np.zeros((size, size)), np.zeros(size)
            information[3, 3], information[4, 4] = SPEED_M_S**-2, RATE_RAD_S**-2
            if acceleration is not None:
                information[STATE, STATE] = ACCELERATION_SD**-2
                pull[STATE] = -acceleration * ACCELERATION_SD**-2
        slopes = np.zeros((len(mean), len(pull)))
        slopes[:3, :moving] = _slopes(motion, time_s, moving)
        slopes[3:, moving:] = np.eye(len(mean) - 3)
        weight = np.linalg.inv(covariance)
        information += slopes.T @ weight @ slopes
        pull += slopes.T @ weight @ mean
    covariance = np.linalg.inv(information)
    return covariance @ pull, covariance


def _slopes(motion: tuple[float, float], time_s: float, size: int) -> np.ndarray:
    """(3, size) derivatives of offsets a time later by those now."""
    steps = STEP * np.eye(size)
    rise = offsets_after(steps, motion, time_s) - offsets_after(-steps, motion, time_s)
    slopes: np.ndarray = rise.T / (2 * STEP)
    return slopes
