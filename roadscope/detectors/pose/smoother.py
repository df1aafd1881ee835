"""A fixed-lag smoother: a vehicle's pose from the scans around it, with one motion for all."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose, wrap_angle
from roadscope.detectors.pose.body_fit import TURN_SD, PoseMode, likely_modes, pose_of, with_glass
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
"""Prior standard deviations of a vehicle's speed (m/s) and acceleration (m/s2)."""
BUDGET, LEAST_BUDGET = 2100, 300
"""Budget of returns of a window, and least budget of one of its scans, see `body_scan`."""
COARSE_RAYS = 150
"""Rays of the first search in a window."""
NEAR_SLACKS_M = (0.06, 0.02, 0.0)
"""Added to the noise in the rounds of a search that begins at the last result, see `descend`."""
LEAST_WINDOW = 3
"""Least number of scans in the window with which the prediction from the last result is nearly
right."""
FITTING_SD = 2.0
"""A result of a search from the last result is accepted if its cost is at most so many standard
deviations above the mean cost."""
WORSE_FACTOR = 1.1
"""After a search from new guesses there is no other one until the cost has grown by this factor.
Chosen by hand."""
ENOUGH_RETURNS = 3
"""With so many returns a single scan gives a good first guess."""
TURN_RATES = (-2 * TURN_SD, 0.0, 2 * TURN_SD)
"""Turn rates of first guesses, rad/s."""
SLOW_M_S, BACKWARD_SD = 1.0, 0.3
"""Below `SLOW_M_S` the motion of a vehicle does not show which end is the front, so both headings
are tried. `BACKWARD_SD`: standard deviation, m/s, of the speed of vehicles that go backwards.
Chosen by hand."""


class _WindowScan(NamedTuple):
    """One scan of the window: its stamp, its rays, and x, y and yaw of the sensor, world frame."""

    stamp_s: float
    body: BodyScan
    sensor_pose: np.ndarray


class Smoother:
    """Fits one motion of constant turn rate and nearly constant speed to the last scans.

    It multiplies the likelihoods of all scans instead of averaging their poses, so even a scan with
    a single return contributes. The sensor may move.
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

        frames: most scans in the window. lag: the pose is returned for the scan so many scans ago,
        0 for the newest, by default that in the middle of the window. tolerance: as in `BodyFit`.
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
        """Take a scan; return the pose at the stamp of the scan `lag` scans ago, world frame.

        It is None if there is no such scan yet, or no return in the window. Arguments as in
        `body_scan`. Stamps have to increase, otherwise `ValueError` is raised.
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
            # The motion of the sensor during its first scan is known only now.
            self._window[0] = self._window[0]._replace(body=self._body_scan(self._first, twist))
        self._first = None if self._window else read_scan
        body = self._body_scan(read_scan, twist)
        self._window.append(_WindowScan(scan.stamp_s, body, sensor_pose))
        return self._pose(len(self._window) - 1 - self._lag)

    def flush(self) -> list[VehiclePose | None]:
        """Return the poses of the last `lag` scans, when no more scans will come."""
        first = max(len(self._window) - self._lag, 0)
        return [self._pose(at) for at in range(first, len(self._window))]

    def _body_scan(self, read_scan: Callable[..., BodyScan], twist: np.ndarray) -> BodyScan:
        """Return a scan's rays. twist: (3,) of the sensor, m/s and rad/s, world frame."""
        body = read_scan(sensor_velocity=twist[:2], sensor_turn=float(twist[2]))
        return replace(body, rays=with_glass(self._model, body.rays))

    def _pose(self, at: int) -> VehiclePose | None:
        """Return the pose at the stamp of one scan of the window, from all scans."""
        if at < 0:
            return None
        stamp_s = self._window[at].stamp_s
        problem, modes = self._problem(stamp_s), []
        modes_from = partial(
            likely_modes, problem, state_cost=_backward_cost, coarse_rays=COARSE_RAYS
        )
        if len(self._last_state):
            starts = _moved(self._last_state, stamp_s - self._last_stamp_s)[:, problem.free]
            slacks_m = NEAR_SLACKS_M if len(self._window) >= LEAST_WINDOW else SLACKS_M
            modes = modes_from(starts, slacks_m=slacks_m)
        # The mean of so many squared standard normal residuals is 1, with this deviation.
        bound = 1.0 + FITTING_SD * np.sqrt(2 / max(problem.hits, 1))
        if not modes or _cost(problem, modes) > max(bound, WORSE_FACTOR * self._guessed_cost):
            starts = self._guesses(stamp_s)
            modes += modes_from(starts[:, problem.free]) if len(starts) else []
            if not modes:
                return None
            self._guessed_cost = _cost(problem, modes)
        self._last_stamp_s = stamp_s
        self._last_state = problem.states(_best(modes).mean[None])[0]
        return pose_of(modes, problem)

    def _problem(self, stamp_s: float) -> BodyProblem:
        """Return the problem of the whole window, with a stamp as reference time."""
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
        """Return states (S, 11) from which to search; they do not depend on the last result.

        The pose comes from the scan nearest to the stamp, the velocity from the means of the
        returns. Three turn rates are tried.
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


def _best(modes: Sequence[PoseMode]) -> Posterior:
    return max(modes, key=lambda mode: mode.log_weight).posterior


def _cost(problem: BodyProblem, modes: Sequence[PoseMode]) -> float:
    """Return the cost of the best result, divided by the number of returns."""
    return float(problem.cost(_best(modes).mean)) / max(problem.hits, 1)


def _moved(last: np.ndarray, span_s: float) -> np.ndarray:
    """Return a state (11,) after a time and, if it is slow, the reverse heading: (1 or 2, 11)."""
    state = last.copy()
    state[:3] = pose_after(last, span_s)
    state[SPEED] += state[ACCELERATION] * span_s
    mirrored = state.copy()
    mirrored[2] += np.pi
    mirrored[[SPEED, ACCELERATION]] *= -1
    return np.array([state, mirrored] if abs(state[SPEED]) < SLOW_M_S else [state])


def _backward_cost(states: np.ndarray) -> np.ndarray:
    """Return the (K,) cost of going backwards of states (K, 11): vehicles rarely do it."""
    return np.asarray((np.minimum(states[:, SPEED], 0.0) / BACKWARD_SD) ** 2)


def _velocities(scans: Sequence[_WindowScan]) -> list[np.ndarray]:
    """Return the velocities (2,) that the means of the returns may have; none without a scan.

    Split scans have two means, of early and of late returns. One velocity is that of all means. As
    the halves may be different sides of the vehicle, another one comes from early means among
    themselves and late means among themselves.
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
