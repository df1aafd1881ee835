"""A vehicle's pose from the scans around it: one motion for all of them, a fixed lag behind."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.detectors.pose.body_descent import SLACKS_M, descend
from roadscope.detectors.pose.body_fit import CHANCES, COARSE_RAYS, still_problem, thinned
from roadscope.detectors.pose.body_kernels import POSE, Chances, Rays, pose_after
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_rays import Sighting, sight
from roadscope.detectors.pose.body_sampling import WHOLE, Problem, free_of, refine
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.envs.sensors.lidar_spec import LidarSpec

SPEED_SD, TURN_SD, ACCELERATION_SD = 30.0, 0.7, 0.7
"""Standard deviations of a vehicle's speed (m/s), turn rate (rad/s) and acceleration (m/s2)
before it is seen."""
COUNT, ROUNDS = 192, 2
SEEN = 3
"""Returns from which a scan alone gives a first guess."""


@dataclass(frozen=True, slots=True)
class _Seen:
    """One scan of the window: when, its rays, and the pose that it gives alone, if any."""

    stamp_s: float
    sighting: Sighting
    guess: np.ndarray | None
    place: np.ndarray


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
        self._last: tuple[float, np.ndarray] | None = None

    def update(
        self, scan: LidarScan, target: np.ndarray, world_from_lidar: Pose, *, rolling: bool = True
    ) -> VehiclePose | None:
        """Take a scan in and return the pose `lag` scans ago, world frame, at its stamp.

        None while there is no such scan, or no return in the window. Arguments as in `sight`.
        """
        place = world_from_lidar.translation[:2]
        velocity = np.zeros(2)
        if self._window and rolling:
            before = self._window[-1]
            velocity = (place - before.place) / (scan.stamp_s - before.stamp_s)
        sighting = sight(
            self._spec, scan, target, world_from_lidar, sensor_velocity=velocity, rolling=rolling
        )
        self._window.append(_Seen(scan.stamp_s, sighting, self._alone(sighting), place.copy()))
        return self._solve(len(self._window) - 1 - self._lag)

    def flush(self) -> list[VehiclePose | None]:
        """Return the poses of the last `lag` scans, from the scans that there are."""
        first = max(len(self._window) - self._lag, 0)
        return [self._solve(at) for at in range(first, len(self._window))]

    def _alone(self, sighting: Sighting) -> np.ndarray | None:
        if sighting.returns < SEEN:
            return None
        rays = thinned(sighting.rays, COARSE_RAYS)
        problem = still_problem(rays, self._model, self._chances, np.arange(3))
        found = descend(problem, np.stack(starts(sighting.points, sighting.origin, self._model)))
        best: np.ndarray = found.vectors[np.argmin(found.costs)]
        return best

    def _solve(self, at: int) -> VehiclePose | None:
        """Return the pose of one scan of the window from all of them."""
        if at < 0:
            return None
        stamp_s = self._window[at].stamp_s
        problem = self._problem(stamp_s)
        guesses = self._guesses(stamp_s, len(problem.free))
        if not len(guesses):
            return None
        best = descend(problem, guesses, SLACKS_M[2:])
        costs = best.costs + 1e3 * (best.vectors[:, 3] < -1.0)
        chosen = int(np.argmin(costs))
        found = refine(
            problem, best.vectors[chosen], best.covariances[chosen], rounds=ROUNDS, count=COUNT
        )
        self._last = stamp_s, best.vectors[chosen]
        unknowns = problem.whole(found.mean[None])[:, POSE:]
        length, width = self._model.sizes(unknowns)
        x, y, yaw = found.mean[:3]
        return VehiclePose(
            float(x), float(y), float(yaw), float(length[0]), float(width[0]),
            found.covariance[:3, :3].copy(), found.evidence,
        )  # fmt: skip

    def _problem(self, stamp_s: float) -> Problem:
        rays = [seen.sighting.rays for seen in self._window]
        times = [
            r.time + (seen.stamp_s - stamp_s) for r, seen in zip(rays, self._window, strict=True)
        ]
        joined = Rays(*(np.concatenate(columns) for columns in zip(*rays, strict=True)))
        prior = np.ones(WHOLE)
        prior[:POSE] = np.inf, np.inf, np.inf, SPEED_SD, TURN_SD, ACCELERATION_SD
        zero = np.zeros(WHOLE)
        free = free_of(self._model, True)
        if len(self._window) == 1:
            free = np.delete(free, [3, 4, 5])
        return Problem(
            joined._replace(time=np.concatenate(times)), self._model, self._chances, zero, free,
            prior, zero,
        )  # fmt: skip

    def _guesses(self, stamp_s: float, size: int) -> np.ndarray:
        """Return first guesses (S, D) of the state at a stamp."""
        guesses = []
        if self._last is not None and len(self._last[1]) == size > 5:
            stamp_before, before = self._last
            moved = before.copy()
            moved[:3] = pose_after(before[:POSE], stamp_s - stamp_before)
            moved[3] += before[5] * (stamp_s - stamp_before)
            guesses.append(moved)
        known = [seen for seen in self._window if seen.guess is not None]
        if known:
            guesses += [self._between(known, stamp_s, size, turned) for turned in (0.0, np.pi)]
        return np.array(guesses)

    def _between(self, known: list[_Seen], stamp_s: float, size: int, turned: float) -> np.ndarray:
        """Return the state that goes with the poses that the scans give alone."""
        nearest = min(known, key=lambda seen: abs(seen.stamp_s - stamp_s))
        first, last = known[0], known[-1]
        assert nearest.guess is not None
        assert first.guess is not None
        assert last.guess is not None
        vector = np.zeros(size)
        vector[:3] = nearest.guess
        vector[2] += turned
        span = last.stamp_s - first.stamp_s
        if size <= 5 or span <= 0:
            return vector
        velocity = (last.guess[:2] - first.guess[:2]) / span
        heading = np.array([np.cos(vector[2]), np.sin(vector[2])])
        half = (last.guess[2] - first.guess[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        vector[:2] += velocity * (stamp_s - nearest.stamp_s)
        vector[3], vector[4] = velocity @ heading, half / span
        return vector
