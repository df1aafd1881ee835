"""A vehicle's pose from the scans around it: one motion for all of them, a fixed lag behind."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose, wrap_angle
from roadscope.detectors.pose.body_descent import LIMIT, SLACKS_M, STEPS, descend, misfits_of
from roadscope.detectors.pose.body_fit import (
    CHANCES,
    TURN_SD,
    Likely,
    pose_of,
    thinned_problem,
)
from roadscope.detectors.pose.body_kernels import HIT, POSE, Chances, Rays, pose_after
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_posterior import Guess, around, posterior
from roadscope.detectors.pose.body_rays import Sighting, sight
from roadscope.detectors.pose.body_sampling import WHOLE, Posterior, Problem, free_of
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.window_start import TURNED, Guesses, Seen
from roadscope.envs.sensors.lidar_spec import LidarSpec

SPEED_SD, ACCELERATION_SD = 30.0, 0.7
"""Standard deviations of a vehicle's speed (m/s) and acceleration (m/s2) before it is seen."""
SPEED = 3
"""Place of the speed among what is free, where it is."""
BUDGET, LEAST = 960, 192
"""Returns of all scans of a window, and of one, above which neighbours are joined: with fewer of
one scan, beams of a near vehicle would be left out."""
WORK = 28_000
"""Effort of the sampling: a window's posterior is nearer to a normal one than a scan's."""
NEAR_SLACKS_M = (0.06, 0.02, 0.0)
"""Added to the noise on the way from a guess that is nearly right."""
WIDER = 1.5
"""How much wider than the last posterior, as a factor on its covariance, the next one is looked
for: of windows as long all but one scan are the same."""
COUNTED = 100.0
"""Effective samples from which the posterior around the last one is taken as it is."""
LONG = 3
"""Scans from which a window's posterior is told by the last one."""
FITTING = 2.0
"""Standard deviations of the cost, above its mean, up to which the last answer, moved on, is
taken to be right."""
SAME = 3.0
"""Standard deviations, and a descent's step, within which two answers are one."""
CLOSE = 30.0
"""How much more than the best one of two first fits may cost to be looked at, too."""
WORSE = 1.1
"""By how much the cost of a return must grow for another search, after one that gained nothing."""
SLOW_M_S = 1.0
"""Speed up to which a vehicle's looks must tell which way round it is, not its way."""
BACKWARD_M_S, WAY_M = -1.0, 0.5
"""Speed from which a vehicle is taken to have been turned round, and the way that tells."""


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
        left out, the middle of the window. chances: as in `BodyFit`.
        """
        if frames < 1:
            raise ValueError(f"frames must be at least 1, got {frames}")
        self._lag = frames // 2 if lag is None else lag
        if not 0 <= self._lag < frames:
            raise ValueError(f"lag must be from 0 to frames - 1 = {frames - 1}, got {lag}")
        self._spec, self._model, self._chances = spec, model, chances
        self._frames = frames
        self._guesses = Guesses(model, chances)
        self.reset()

    def reset(self) -> None:
        """Forget every scan."""
        self._window: deque[Seen] = deque(maxlen=self._frames)
        self._guesses.reset()
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

        None while there is no such scan, or no return in the window. Arguments as in `sight`;
        stamps that do not increase are a `ValueError`.
        """
        if self._window and not scan.stamp_s > self._window[-1].stamp_s:
            last_s = self._window[-1].stamp_s
            raise ValueError(f"stamps must increase: {scan.stamp_s} s after {last_s} s")
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
            self._guesses.reset()
        shot = _Shot(scan, target, world_from_lidar, rolling)
        self._first = None if self._window else shot
        self._window.append(Seen(scan.stamp_s, self._sighted(shot, motion), place))
        return self._solve(len(self._window) - 1 - self._lag)

    def _sighted(self, shot: _Shot, motion: np.ndarray) -> Sighting:
        """Return what a scan tells; motion: (3,) of the sensor, m/s and rad/s, world frame."""
        sighting = sight(
            self._spec, shot.scan, shot.target, shot.world_from_lidar,
            sensor_velocity=motion[:2], sensor_turn=float(motion[2]), rolling=shot.rolling,
            budget=max(BUDGET // self._frames, LEAST), rough_m=self._chances.rough_m,
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
        if found is None or _cost(problem, found) > self._bound(problem):
            found = self._searched(problem, stamp_s, found)
        if found is None:
            return None
        answers = [Likely(found.evidence, found)]
        if SPEED in problem.free and found.mean[SPEED] < SLOW_M_S:
            answers = [_forward(each) for each in (found, _twin(problem, found))]
            found = max(answers, key=lambda answer: answer.log).found
        self._last = stamp_s, problem.whole(found.mean[None])[0]
        self._known = _Known(stamp_s, problem.free, found)
        self._note_way(stamp_s, found.mean[:2])
        return pose_of(answers, problem)

    def _followed(self, problem: Problem, stamp_s: float) -> Posterior | None:
        """Return the posterior around the last one, moved on; None where there is none."""
        known = self._known
        if known is None or len(self._window) < LONG:
            return None
        if not np.array_equal(known.free, problem.free):
            return None
        found = posterior(problem, known.moved(stamp_s), work=WORK)
        turned = self._turned(problem.whole(found.mean[None]))[0]
        return found if found.reached and found.effective >= COUNTED and not turned else None

    def _searched(
        self, problem: Problem, stamp_s: float, followed: Posterior | None
    ) -> Posterior | None:
        """Return the posterior around the best state, which is the followed one's where it ends."""
        best, tries = self._best(problem, stamp_s)
        if best is None:
            return None
        found = followed
        if found is None or not _same(problem, found, best[0]):
            found = posterior(problem, around(problem, *best), work=WORK)
        # What one try alone came to may be far off, and says nothing of what can be reached.
        if tries > 1:
            self._settled = _cost(problem, found) / max((problem.rays.kind == HIT).sum(), 1)
        return found

    def _bound(self, problem: Problem) -> float:
        """Return the cost up to which the last answer, moved on, is taken to be right."""
        hits = (problem.rays.kind == HIT).sum()
        return float(max(hits + FITTING * np.sqrt(2 * hits), WORSE * self._settled * hits))

    def _best(
        self, problem: Problem, stamp_s: float
    ) -> tuple[tuple[np.ndarray, np.ndarray] | None, int]:
        """Return the best state and its covariance, and of how many tries it is the best.

        They are from the last state and, where that is bad, from anew.
        """
        bound = self._bound(problem)
        tries = []
        before = self._moved(stamp_s)
        if before is not None and not self._turned(before[None])[0]:
            rough = descend(thinned_problem(problem), before[None, problem.free], NEAR_SLACKS_M[:2])
            tries.append(descend(problem, rough.vectors, NEAR_SLACKS_M[2:]))
        if not tries or tries[0].costs[0] > bound:
            guesses = self._guesses.at(stamp_s, self._window)
            if len(guesses):
                rough = descend(thinned_problem(problem), guesses[:, problem.free], SLACKS_M[:-2])
                turned = self._turned(problem.whole(rough.vectors))
                costs = rough.costs + TURNED * turned
                chosen = np.flatnonzero(costs <= costs.min() + CLOSE)
                tries.append(descend(problem, rough.vectors[chosen], NEAR_SLACKS_M[1:]))
        if not tries:
            return None, 0
        vectors = np.concatenate([found.vectors for found in tries])
        costs = np.concatenate([found.costs for found in tries])
        covariances = np.concatenate([found.covariances for found in tries])
        costs = costs + TURNED * self._turned(problem.whole(vectors))
        if SPEED in problem.free:
            costs += _backward(vectors[:, SPEED], covariances[:, SPEED, SPEED])
        least = np.argmin(costs)
        return (vectors[least], covariances[least]), len(tries)

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


def _cost(problem: Problem, found: Posterior) -> float:
    """Return by how much the rays disagree with a posterior's mean, as a descent counts it."""
    off = misfits_of(problem, found.mean[None], 0.0)[0]
    return float(LIMIT**2 * np.log1p((off / LIMIT) ** 2).sum())


def _same(problem: Problem, found: Posterior, vector: np.ndarray) -> bool:
    """Whether a descent ended at a posterior's mean, as nearly as its steps are fine."""
    spread = np.sqrt(np.diag(found.covariance))
    return bool((np.abs(vector - found.mean) <= SAME * spread + STEPS[problem.free]).all())


def _twin(problem: Problem, found: Posterior) -> Posterior:
    """Return the posterior of a vehicle that is the other way round and goes the same way."""
    turned = found.mean.copy()
    turned[2] += np.pi
    turned[[SPEED, POSE - 1]] *= -1
    rough = descend(thinned_problem(problem), turned[None], SLACKS_M[:-2])
    best = descend(problem, rough.vectors, NEAR_SLACKS_M[1:])
    return posterior(problem, around(problem, best.vectors[0], best.covariances[0]), work=WORK)


def _forward(found: Posterior) -> Likely:
    """Return a posterior with the log of its evidence, less what it costs to go backwards."""
    cost = _backward(found.mean[[SPEED]], found.covariance[SPEED, SPEED])
    return Likely(found.evidence - 0.5 * float(cost[0]), found)


def _backward(speeds: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return what it costs (S,) to go backwards, as far as that is known: vehicles rarely do."""
    costs: np.ndarray = np.minimum(np.minimum(speeds, 0.0) ** 2 / variances, CLOSE)
    return costs
