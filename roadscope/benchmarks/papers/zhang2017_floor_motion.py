"""How the car moves on between the frames that the information floor joins.

It keeps a constant speed and turn rate, both unknown, and moves along its heading.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S
from roadscope.benchmarks.papers.zhang2017_scene import Run
from roadscope.core.pose import wrap_angle

SPEED_M_S, RATE_RAD_S = 20.0, np.radians(60.0)
"""Standard deviations of the first proposal of speed and turn rate; their prior is flat."""
STATE = 5
"""Offsets of x, y, yaw, speed and turn rate."""
STEP = 1e-5


def motion_of(run: Run, k: int) -> tuple[float, float]:
    """Return speed and turn rate of the car at a frame."""
    step = 1e-3
    before, after = run.drive.car(FRAME_S * k + np.array([-step, step]))
    way = after - before
    return float(np.hypot(*way[:2]) / (2 * step)), float(wrap_angle(way[2]) / (2 * step))


def offsets_after(states: np.ndarray, motion: tuple[float, float], time_s: float) -> np.ndarray:
    """Return (N, 3) offsets from the true pose a time later.

    states: (N, 5) offsets of x, y, yaw, speed and turn rate from the truth now.
    motion: true speed and turn rate. Offsets are in the frame of the true pose then.
    """
    truth = _arrived(np.zeros((1, STATE)), motion, time_s)[0]
    moved = _arrived(states, motion, time_s) - truth
    c, s = np.cos(truth[2]), np.sin(truth[2])
    return np.ascontiguousarray(moved @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _arrived(states: np.ndarray, motion: tuple[float, float], time_s: float) -> np.ndarray:
    x, y, yaw, speed, rate = states.T
    half = 0.5 * (motion[1] + rate) * time_s
    way = (motion[0] + speed) * time_s * np.sinc(half / np.pi)
    return np.column_stack(
        [x + way * np.cos(yaw + half), y + way * np.sin(yaw + half), yaw + 2 * half]
    )


def joined(
    motion: tuple[float, float], answers: Iterable[tuple[float, np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Join frames' posteriors as if they were normal; return mean and covariance of the state.

    answers: time from now, mean (3 + E,) and covariance of a frame's pose and of E unknowns that
    do not change; the state has them last.
    """
    information, pull = np.zeros((0, 0)), np.zeros(0)
    for time_s, mean, covariance in answers:
        if not len(pull):
            size = STATE + len(mean) - 3
            information, pull = np.zeros((size, size)), np.zeros(size)
            information[3, 3], information[4, 4] = SPEED_M_S**-2, RATE_RAD_S**-2
        slopes = np.zeros((len(mean), len(pull)))
        slopes[:3, :STATE] = _slopes(motion, time_s)
        slopes[3:, STATE:] = np.eye(len(mean) - 3)
        weight = np.linalg.inv(covariance)
        information += slopes.T @ weight @ slopes
        pull += slopes.T @ weight @ mean
    covariance = np.linalg.inv(information)
    return covariance @ pull, covariance


def _slopes(motion: tuple[float, float], time_s: float) -> np.ndarray:
    """(3, 5) derivatives of offsets a time later by those now."""
    steps = STEP * np.eye(STATE)
    rise = offsets_after(steps, motion, time_s) - offsets_after(-steps, motion, time_s)
    slopes: np.ndarray = rise.T / (2 * STEP)
    return slopes
