"""A vehicle's pose from the scans around it: one motion for all of them, a fixed lag behind."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose, wrap_angle
from roadscope.detectors.pose.body_descent import LIMIT, SLACKS_M, descend, misfits_of
from roadscope.detectors.pose.body_fit import (
    CHANCES,
    COARSE_RAYS,
    NEAR,
    TURN_SD,
    pose_of,
    still_problem,
    thinned,
    thinned_problem,
)
from roadscope.detectors.pose.body_kernels import HIT, POSE, Chances, Rays, pose_after
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_posterior import Guess, around, posterior
from roadscope.detectors.pose.body_rays import Sighting, sight
from roadscope.detectors.pose.body_sampling import WHOLE, Posterior, Problem, free_of
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.envs.sensors.lidar_spec import LidarSpec

SPEED_SD, ACCELERATION_SD = 30.0, 0.7
"""Standard deviations of a vehicle's speed (m/s) and acceleration (m/s2) before it is seen."""
SPEED = 3
"""Place of the speed among what is free, where it is."""
SEEN = 3
"""Returns from which a scan alone gives a good first guess."""
TORN_S = 0.05
"""Time within which a sweep meets a body, unless the seam of the sweep goes through it."""
BUDGET, LEAST = 480, 96
"""Returns of all scans of a window, and of one, above which neighbours are joined: with fewer of
one scan, beams of a near vehicle would be left out."""
WORK = 14_000
"""Effort of the sampling: a window's posterior is nearer to a normal one than a scan's."""
NEAR_SLACKS_M = (0.06, 0.02, 0.0)
"""Added to the noise on the way from a guess that is nearly right."""
WIDER = 1.5
"""How much wider than the last posterior, as a factor on its covariance, the next one is looked
for: of windows as long all but one scan are the same."""
COUNTED = 50.0
"""Effective samples from which the posterior around the last one is taken as it is."""
LONG = 3
"""Scans from which a window's posterior is told by the last one."""
FITTING = 2.0
"""Standard deviations of the cost, above its mean, up to which the last answer, moved on, is
taken to be right."""
CLOSE = 30.0
"""How much more than the best one of two first fits may cost to be looked at, too."""
WORSE = 1.1
"""By how much the cost of a return must grow for another search, after one that gained nothing."""
BACKWARD_M_S, WAY_M = -1.0, 0.5
"""Speed from which a vehicle is taken to have been turned round, and the way that tells."""
TURNED = 1e3
"""Added to the cost of a vehicle turned round, or across the way it goes."""
COURSE_M, COURSE_M_S = 1.5, 3.0
"""Way of the returns' mean within the window, and speed, from which it tells where a vehicle
heads: which of its sides are seen may change that mean by much of its size, but not that fast."""


@dataclass(frozen=True, slots=True)
class _Seen:
    """One scan of the window: when, its rays, and where the sensor was, x, y, yaw."""

    stamp_s: float
    sighting: Sighting
    place: np.ndarray

    @property
    def met_s(self) -> float:
        """When the body was met, or the stamp where it was not."""
        rays = self.sighting.rays
        hits = rays.kind == HIT
        return self.stamp_s + float(rays.time[hits].mean()) if hits.any() else self.stamp_s

    @property
    def torn(self) -> bool:
        """Whether the body was met both when the sweep began and when it ended: twice, in effect.

        One that goes fast is elsewhere by then, and no pose fits both.
        """
        times = self.sighting.rays.time[self.sighting.rays.kind == HIT]
        return bool(np.ptp(times) > TORN_S) if len(times) else False


class _Shot(NamedTuple):
    """One scan as it came; fields as in `Smoother.update`."""

    scan: LidarScan
    target: np.ndarray
    world_from_lidar: Pose
    rolling: bool


@dataclass(frozen=True, slots=True)
class _Known:
    """The last answer: when, what of it was free, and what is known of that."""

    stamp_s: float
    free: np.ndarray
    found: Posterior

    def moved(self, stamp_s: float) -> Guess:
        """Return where to look at another stamp, in a window as long."""
        mean = self.found.mean.copy()
        mean[:POSE] = _state_after(mean[:POSE], stamp_s - self.stamp_s)
        return Guess(mean, WIDER * self.found.covariance, False)


def _state_after(state: np.ndarray, span: float) -> np.ndarray:
    """Return x to acceleration (6,) after a time."""
    moved = state.copy()
    moved[:3] = pose_after(state, span)
    moved[3] += state[5] * span
    return moved


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
        chances: Chances = CHANCES,
    ) -> None:
        """Take the LiDAR, the body and the window.

        frames: scans joined at most. lag: how many scans back the answer is, 0 for the newest;
        left out, the middle of the window.
        """
        if frames < 1:
            raise ValueError(f"frames must be at least 1, got {frames}")
        self._lag = frames // 2 if lag is None else lag
        if not 0 <= self._lag < frames:
            raise ValueError(f"lag must be from 0 to frames - 1 = {frames - 1}, got {lag}")
        self._spec, self._model, self._chances = spec, model, chances
        self._frames = frames
        self.reset()

    def reset(self) -> None:
        """Forget every scan."""
        self._window: deque[_Seen] = deque(maxlen=self._frames)
        self._single: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        self._last: tuple[float, np.ndarray] | None = None
        self._known: _Known | None = None
        self._anchor: tuple[float, np.ndarray] | None = None
        self._velocity: np.ndarray | None = None
        self._settled = 0.0
        self._first: _Shot | None = None

    def update(
        self, scan: LidarScan, target: np.ndarray, world_from_lidar: Pose, *, rolling: bool = True
    ) -> VehiclePose | None:
        """Take a scan in and return the pose `lag` scans ago, world frame, at its stamp.

        None while there is no such scan, or no return in the window. Arguments as in `sight`.
        """
        place = np.array([*world_from_lidar.translation[:2], world_from_lidar.yaw])
        motion = np.zeros(3)
        if self._window and rolling:
            before = self._window[-1]
            motion = place - before.place
            motion[2] = wrap_angle(motion[2])
            motion /= scan.stamp_s - before.stamp_s
        if self._first is not None and rolling:
            # Only now is known how the sensor went while it took its first scan.
            self._window[0] = replace(self._window[0], sighting=self._sighted(self._first, motion))
            self._single.clear()
        shot = _Shot(scan, target, world_from_lidar, rolling)
        self._first = None if self._window else shot
        self._window.append(_Seen(scan.stamp_s, self._sighted(shot, motion), place))
        return self._solve(len(self._window) - 1 - self._lag)

    def _sighted(self, shot: _Shot, motion: np.ndarray) -> Sighting:
        """Return what a scan tells; motion: (3,) of the sensor, m/s and rad/s, world frame."""
        sighting = sight(
            self._spec, shot.scan, shot.target, shot.world_from_lidar,
            sensor_velocity=motion[:2], sensor_turn=float(motion[2]), rolling=shot.rolling,
            budget=max(BUDGET // self._frames, LEAST),
        )  # fmt: skip
        return replace(sighting, rays=self._model.glazed(sighting.rays))

    def flush(self) -> list[VehiclePose | None]:
        """Return the poses of the last `lag` scans, from the scans that there are."""
        first = max(len(self._window) - self._lag, 0)
        return [self._solve(at) for at in range(first, len(self._window))]

    def _solve(self, at: int) -> VehiclePose | None:
        """Return the pose of one scan of the window from all of them."""
        if at < 0:
            return None
        stamp_s = self._window[at].stamp_s
        problem = self._problem(stamp_s)
        found = self._followed(problem, stamp_s)
        if found is None:
            best = self._best(problem, stamp_s)
            if best is None:
                return None
            found = posterior(problem, around(problem, *best), work=WORK)
        self._last = stamp_s, problem.whole(found.mean[None])[0]
        self._known = _Known(stamp_s, problem.free, found)
        self._note_way(stamp_s, found.mean[:2])
        return pose_of(found, problem)

    def _followed(self, problem: Problem, stamp_s: float) -> Posterior | None:
        """Return the posterior around the last one, moved on; None where that is not right."""
        known = self._known
        if known is None or len(self._window) < LONG:
            return None
        if not np.array_equal(known.free, problem.free):
            return None
        found = posterior(problem, known.moved(stamp_s), work=WORK)
        state = found.mean[None]
        off = misfits_of(problem, state, 0.0)[0]
        cost = LIMIT**2 * np.log1p((off / LIMIT) ** 2).sum()
        turned = self._turned(problem.whole(state))[0]
        likely = found.reached and found.effective >= COUNTED and cost <= self._bound(problem)
        return found if likely and not turned else None

    def _bound(self, problem: Problem) -> float:
        """Return the cost up to which the last answer, moved on, is taken to be right."""
        hits = (problem.rays.kind == HIT).sum()
        return float(max(hits + FITTING * np.sqrt(2 * hits), WORSE * self._settled * hits))

    def _best(self, problem: Problem, stamp_s: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the best state and its covariance, from the last one or, if bad, from anew."""
        hits = (problem.rays.kind == HIT).sum()
        bound = self._bound(problem)
        tries = []
        before = self._moved(stamp_s)
        if before is not None and not self._turned(before[None])[0]:
            rough = descend(thinned_problem(problem), before[None, problem.free], NEAR_SLACKS_M[:2])
            tries.append(descend(problem, rough.vectors, NEAR_SLACKS_M[2:]))
        if not tries or tries[0].costs[0] > bound:
            guesses = self._guesses(stamp_s)
            if len(guesses):
                rough = descend(thinned_problem(problem), guesses[:, problem.free], SLACKS_M[:-2])
                turned = self._turned(problem.whole(rough.vectors))
                costs = rough.costs + TURNED * turned
                chosen = np.flatnonzero(costs <= costs.min() + CLOSE)
                tries.append(descend(problem, rough.vectors[chosen], NEAR_SLACKS_M[1:]))
        if not tries:
            return None
        vectors = np.concatenate([found.vectors for found in tries])
        costs = np.concatenate([found.costs for found in tries])
        self._settled = float(costs.min() / max(hits, 1)) if len(tries) > 1 else self._settled
        covariances = np.concatenate([found.covariances for found in tries])
        costs = costs + TURNED * self._turned(problem.whole(vectors))
        if SPEED in problem.free:
            costs += _backward(vectors[:, SPEED], covariances[:, SPEED, SPEED])
        least = np.argmin(costs)
        return vectors[least], covariances[least]

    def _turned(self, states: np.ndarray) -> np.ndarray:
        """Whether states (S, 11) are those of a vehicle that is taken for its mirror image."""
        backward = states[:, 3] < BACKWARD_M_S
        if self._velocity is None or len(self._window) > 1:
            return backward
        headings = np.stack([np.cos(states[:, 2]), np.sin(states[:, 2])], axis=1)
        turned: np.ndarray = headings @ self._velocity < 0
        return turned

    def _note_way(self, stamp_s: float, place: np.ndarray) -> None:
        """Remember how the vehicle moves: one scan tells neither speed nor front from rear."""
        if self._anchor is None:
            self._anchor = stamp_s, place
        before, start = self._anchor
        if np.hypot(*(place - start)) > WAY_M:
            self._anchor, self._velocity = (stamp_s, place), (place - start) / (stamp_s - before)

    def _problem(self, stamp_s: float) -> Problem:
        rays = [seen.sighting.rays for seen in self._window]
        times = [
            r.time + (seen.stamp_s - stamp_s) for r, seen in zip(rays, self._window, strict=True)
        ]
        joined = Rays(*(np.concatenate(columns) for columns in zip(*rays, strict=True)))
        prior = np.ones(WHOLE)
        prior[:POSE] = np.inf, np.inf, np.inf, SPEED_SD, TURN_SD, ACCELERATION_SD
        zero, fixed = np.zeros(WHOLE), np.zeros(WHOLE)
        free = free_of(self._model, True)
        if len(self._window) == 1:
            free = np.delete(free, [3, 4, 5])
            fixed[3] = 0.0 if self._velocity is None else np.hypot(*self._velocity)
        return Problem(
            joined._replace(time=np.concatenate(times)), self._model, self._chances, fixed, free,
            prior, zero,
        )  # fmt: skip

    def _moved(self, stamp_s: float) -> np.ndarray | None:
        """Return the last answer's state (11,) moved on to a stamp."""
        if self._last is None:
            return None
        before, state = self._last
        return np.concatenate([_state_after(state[:POSE], stamp_s - before), state[POSE:]])

    def _guesses(self, stamp_s: float) -> np.ndarray:
        """Return first guesses (S, 11) of the state at a stamp from the poses of single scans."""
        some = [seen for seen in self._window if seen.sighting.returns]
        enough = [seen for seen in some if seen.sighting.returns >= SEEN] or some
        if not enough:
            return np.empty((0, WHOLE))
        enough = [seen for seen in enough if not seen.torn] or enough
        nearest = min(enough, key=lambda seen: abs(seen.stamp_s - stamp_s))
        course = _course(enough[0], enough[-1])
        known = [(seen, self._alone(seen, course)) for seen in (enough[0], nearest, enough[-1])]
        return np.array([_between(known, stamp_s, turned) for turned in (0.0, np.pi)])

    def _alone(self, seen: _Seen, course: float | None) -> np.ndarray:
        """Return the pose (3,) that a scan alone has, of those along the way it goes."""
        if seen.stamp_s not in self._single:
            sighting = seen.sighting
            problem = still_problem(
                thinned(sighting.rays, COARSE_RAYS), self._model, self._chances, np.arange(3)
            )
            guesses = starts(sighting.points, sighting.origin, self._model)
            found = descend(problem, guesses)
            self._single[seen.stamp_s] = found.vectors, found.costs
        vectors, costs = self._single[seen.stamp_s]
        if course is not None:
            costs = costs + TURNED * (np.abs(np.cos(vectors[:, 2] - course)) < NEAR)
        pose: np.ndarray = vectors[np.argmin(costs)]
        return pose


def _backward(speeds: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return what it costs (S,) to go backwards, as far as that is known: vehicles rarely do."""
    costs: np.ndarray = np.minimum(np.minimum(speeds, 0.0) ** 2 / variances, CLOSE)
    return costs


def _course(first: _Seen, last: _Seen) -> float | None:
    """Return the direction, radians, in which the returns' mean went from scan to scan."""
    span = last.met_s - first.met_s
    way = last.sighting.points.mean(axis=0) - first.sighting.points.mean(axis=0)
    length = float(np.hypot(*way))
    if length < COURSE_M or length < COURSE_M_S * span:
        return None
    return float(np.arctan2(way[1], way[0]))


def _between(known: list[tuple[_Seen, np.ndarray]], stamp_s: float, turned: float) -> np.ndarray:
    """Return the state (11,) that goes with the poses of single scans.

    known: of the first, of the nearest to the stamp and of the last.
    """
    nearest, pose = known[1]
    state = np.zeros(WHOLE)
    state[:3] = pose
    state[2] += turned
    (first, start), (last, end) = known[0], known[-1]
    span = last.met_s - first.met_s
    if span > 0:
        velocity = (end[:2] - start[:2]) / span
        heading = np.array([np.cos(state[2]), np.sin(state[2])])
        turn = (end[2] - start[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        state[:2] += velocity * (stamp_s - nearest.met_s)
        state[3], state[4] = velocity @ heading, turn / span
    return state
