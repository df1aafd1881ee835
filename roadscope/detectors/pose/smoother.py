"""A vehicle's pose from the scans around it: one motion for all of them, a fixed lag behind."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose, wrap_angle
from roadscope.detectors.pose.body_fit import (
    TURN_SD,
    Answer,
    likely_answers,
    pose_of,
    with_glass,
)
from roadscope.detectors.pose.body_likelihood import ROUGHLY_DRAWN, Tolerance, pose_after
from roadscope.detectors.pose.body_model import ACCELERATION, MOTION, SPEED, VALUES, BodyModel
from roadscope.detectors.pose.body_rays import BodyRays, BodyScan, body_scan
from roadscope.detectors.pose.body_search import (
    SLACKS_M,
    BodyProblem,
    Posterior,
    first_poses,
    prior_sd,
)
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.envs.sensors.lidar_spec import LidarSpec

SPEED_SD, ACCELERATION_SD = 30.0, 0.7
"""Standard deviations of a vehicle's speed (m/s) and acceleration (m/s2) before it is measured."""
BUDGET, LEAST_BUDGET = 2100, 300
"""Returns of all scans of a window, and of one, beyond which some are left out."""
COARSE_RAYS = 150
"""Rays of the first search in a window."""
NEAR_SLACKS_M = (0.06, 0.02, 0.0)
"""Added to the noise on the way from the last answer, see `descend`."""
LONG = 3
"""Scans from which the last answer, moved on, is nearly right."""
FITTING_SD = 2.0
"""Standard deviations of the cost, above its mean, up to which an answer from the last one is
taken to be right."""
WORSE = 1.1
"""By how much the cost must grow for another search with new guesses, after one."""
ENOUGH_RETURNS = 3
"""Returns from which a scan alone gives a good first guess."""
TURN_RATES = (-2 * TURN_SD, 0.0, 2 * TURN_SD)
"""Turn rates of first guesses, rad/s."""
SLOW_M_S, BACKWARD_SD = 1.0, 0.3
"""Speed up to which the looks of a vehicle must tell which way round it is, not its motion; and
standard deviation, m/s, of the speed of what goes backwards."""


class _WindowScan(NamedTuple):
    """One scan of the window: its stamp, what it says, and where the sensor was, x, y, yaw."""

    stamp_s: float
    body: BodyScan
    sensor_pose: np.ndarray


class Smoother:
    """Joins the last scans under constant turn rate and nearly constant speed.

    The likelihoods of all scans are joined, not their poses, so a scan with one return counts
    for what it is worth. The sensor may move.
    """

    def __init__(
        self,
        spec: LidarSpec,
        model: BodyModel,
        *,
        frames: int = 7,
        lag: int | None = None,
        tolerance: Tolerance = ROUGHLY_DRAWN,
    ) -> None:
        """Take the LiDAR, the body and the window.

        frames: scans joined at most. lag: how many scans back the answer is, 0 for the newest;
        left out, the middle of the window. tolerance: as in `BodyFit`.
        """
        if frames < 1:
            raise ValueError(f"frames must be at least 1, got {frames}")
        self._lag = frames // 2 if lag is None else lag
        if not 0 <= self._lag < frames:
            raise ValueError(f"lag must be from 0 to frames - 1 = {frames - 1}, got {lag}")
        self._spec, self._model, self._tolerance = spec, model, tolerance
        self._frames = frames
        self.reset()

    def reset(self) -> None:
        """Forget every scan."""
        self._window: deque[_WindowScan] = deque(maxlen=self._frames)
        self._first: Callable[..., BodyScan] | None = None
        self._last_stamp_s, self._last_state = 0.0, np.empty(0)
        self._guessed_cost = 0.0

    def update(
        self, scan: LidarScan, target: np.ndarray, world_from_lidar: Pose, *, rolling: bool = True
    ) -> VehiclePose | None:
        """Take a scan in and return the pose `lag` scans ago, world frame, at its stamp.

        None while there is no such scan, or no return in the window. Arguments as in `body_scan`;
        stamps that do not increase are a `ValueError`.
        """
        if self._window and not scan.stamp_s > self._window[-1].stamp_s:
            last_s = self._window[-1].stamp_s
            raise ValueError(f"stamps must increase: {scan.stamp_s} s after {last_s} s")
        sensor_pose = np.array([*world_from_lidar.translation[:2], world_from_lidar.yaw])
        twist = np.zeros(3)
        if self._window and rolling:
            before = self._window[-1]
            twist = sensor_pose - before.sensor_pose
            twist[2] = wrap_angle(twist[2])
            twist /= scan.stamp_s - before.stamp_s
        read_scan = partial(
            body_scan,
            self._spec,
            scan,
            target,
            world_from_lidar,
            rolling=rolling,
            budget=max(BUDGET // self._frames, LEAST_BUDGET),
            rough_m=self._tolerance.rough_m,
        )
        if self._first is not None and rolling:
            # Only now is known how the sensor moved while it took its first scan.
            self._window[0] = self._window[0]._replace(body=self._body_scan(self._first, twist))
        self._first = None if self._window else read_scan
        body = self._body_scan(read_scan, twist)
        self._window.append(_WindowScan(scan.stamp_s, body, sensor_pose))
        return self._pose(len(self._window) - 1 - self._lag)

    def flush(self) -> list[VehiclePose | None]:
        """Return the poses of the last `lag` scans, from the scans that there are."""
        first = max(len(self._window) - self._lag, 0)
        return [self._pose(at) for at in range(first, len(self._window))]

    def _body_scan(self, read_scan: Callable[..., BodyScan], twist: np.ndarray) -> BodyScan:
        """Return what a scan says; twist: (3,) of the sensor, m/s and rad/s, world frame."""
        body = read_scan(sensor_velocity=twist[:2], sensor_turn=float(twist[2]))
        return replace(body, rays=with_glass(self._model, body.rays))

    def _pose(self, at: int) -> VehiclePose | None:
        """Return the pose of one scan of the window from all of them."""
        if at < 0:
            return None
        stamp_s = self._window[at].stamp_s
        problem, answers = self._problem(stamp_s), []
        answers_from = partial(
            likely_answers, problem, state_cost=_backward_cost, coarse_rays=COARSE_RAYS
        )
        if len(self._last_state):
            starts = _moved(self._last_state, stamp_s - self._last_stamp_s)[:, problem.free]
            slacks_m = NEAR_SLACKS_M if len(self._window) >= LONG else SLACKS_M
            answers = answers_from(starts, slacks_m=slacks_m)
        # Squares of as many returns have this mean and standard deviation.
        bound = 1.0 + FITTING_SD * np.sqrt(2 / max(problem.hits, 1))
        if not answers or _cost(problem, answers) > max(bound, WORSE * self._guessed_cost):
            starts = self._guesses(stamp_s)
            answers += answers_from(starts[:, problem.free]) if len(starts) else []
            if not answers:
                return None
            self._guessed_cost = _cost(problem, answers)
        self._last_stamp_s = stamp_s
        self._last_state = problem.states(_best(answers).mean[None])[0]
        return pose_of(answers, problem)

    def _problem(self, stamp_s: float) -> BodyProblem:
        """Return the problem of the whole window, the reference time being a stamp."""
        rays = [
            scan.body.rays._replace(time=scan.body.rays.time + (scan.stamp_s - stamp_s))
            for scan in self._window
        ]
        return BodyProblem(
            BodyRays(*(np.concatenate(columns) for columns in zip(*rays, strict=True))),
            self._model,
            np.concatenate([np.arange(MOTION), self._model.uncertain]),
            self._tolerance,
            sd=prior_sd(speed=SPEED_SD, turn_rate=TURN_SD, acceleration=ACCELERATION_SD),
        )

    def _guesses(self, stamp_s: float) -> np.ndarray:
        """Return states (S, 11) to search from, the last answer being left aside.

        The scan nearest to the stamp gives the pose, the returns' means give the velocity, and
        the turn rate is tried.
        """
        filled = [scan for scan in self._window if scan.body.returns]
        usable = [scan for scan in filled if scan.body.returns >= ENOUGH_RETURNS] or filled
        states = []
        for velocity in _velocities(filled):
            scan = min(usable, key=lambda scan: (scan.body.is_split, abs(scan.stamp_s - stamp_s)))
            points, cut = scan.body.rays.points(velocity), scan.body.cut
            for x, y, yaw in first_poses(points, scan.body.origin, self._model, cut=cut):
                speed = velocity @ (np.cos(yaw), np.sin(yaw))
                place = (x, y) + velocity * (stamp_s - scan.stamp_s)
                rates = TURN_RATES if len(filled) > 1 else (0.0,)
                states += [[*place, yaw, speed, rate, *[0.0] * (VALUES - 5)] for rate in rates]
        return np.array(states)


def _best(answers: Sequence[Answer]) -> Posterior:
    return max(answers, key=lambda answer: answer.log_weight).posterior


def _cost(problem: BodyProblem, answers: Sequence[Answer]) -> float:
    """Return the cost of the best answer, by return."""
    return float(problem.cost(_best(answers).mean)) / max(problem.hits, 1)


def _moved(last: np.ndarray, span_s: float) -> np.ndarray:
    """Return a state (11,) after a time and, if it is slow, its mirror image: (1 or 2, 11)."""
    state = last.copy()
    state[:3] = pose_after(last, span_s)
    state[SPEED] += state[ACCELERATION] * span_s
    mirrored = state.copy()
    mirrored[2] += np.pi
    mirrored[[SPEED, ACCELERATION]] *= -1
    return np.array([state, mirrored] if abs(state[SPEED]) < SLOW_M_S else [state])


def _backward_cost(states: np.ndarray) -> np.ndarray:
    """Return what it costs (K,) states (K, 11) to go backwards: vehicles rarely do."""
    return np.asarray((np.minimum(states[:, SPEED], 0.0) / BACKWARD_SD) ** 2)


def _velocities(scans: Sequence[_WindowScan]) -> list[np.ndarray]:
    """Return velocities (2,) that the returns' means may have; none without a scan.

    Of split scans each half counts for itself: its mean may have moved from half to half, or, as
    the halves measure different sides of a vehicle that stands too, from each half to its like.
    """
    rows = []
    for scan in scans:
        times, points = scan.body.times, scan.body.rays.points(np.zeros(2))
        is_late = (times > times.mean()) & scan.body.is_split
        for half in (False, True):
            if (rows_of_half := is_late == half).any():
                mean = points[rows_of_half].mean(axis=0)
                rows.append([half, scan.stamp_s + times[rows_of_half].mean(), *mean])
    if not rows:
        return []
    table, velocities = np.array(rows), []
    for groups in (table[:, 0], 0 * table[:, 0])[: 1 + table[:, 0].any()]:
        off = np.concatenate(
            [table[groups == g, 1:] - table[groups == g, 1:].mean(axis=0) for g in set(groups)]
        )
        spread = off[:, 0] @ off[:, 0]
        velocities.append(off[:, 0] @ off[:, 1:] / spread if spread > 0 else np.zeros(2))
    return velocities
