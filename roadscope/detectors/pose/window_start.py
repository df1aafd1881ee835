"""First guesses of a vehicle's pose and speed from the scans of a window, each fitted alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.detectors.pose.body_descent import descend
from roadscope.detectors.pose.body_fit import (
    COARSE_RAYS,
    NEAR,
    TURN_SD,
    at_speed,
    still_problem,
    thinned,
)
from roadscope.detectors.pose.body_kernels import HIT, Chances
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_rays import Sighting
from roadscope.detectors.pose.body_sampling import WHOLE
from roadscope.detectors.pose.body_sight_kernels import points_of
from roadscope.detectors.pose.body_start import starts

SEEN = 3
"""Returns from which a scan alone gives a good first guess."""
TORN_S = 0.05
"""Time within which a sweep meets a body, unless the seam of the sweep goes through it."""
COURSE_M, COURSE_M_S = 1.5, 3.0
"""Way of the returns' mean within the window, and speed, from which it tells where a vehicle
heads: which of its sides are seen may change that mean by much of its size, but not that fast."""
QUARTERS = np.pi / 2 * np.arange(-2.0, 3.0)
"""Turns within a window that leave the first and the last heading as they are."""
HEADING_SD = 0.1
"""Standard deviation of a first heading, radians."""
TURNED = 1e3
"""Added to the cost of a vehicle turned round, or across the way it goes."""


@dataclass(frozen=True, slots=True)
class Seen:
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


class Guesses:
    """Guesses states of a window's vehicle; what scans say alone is remembered."""

    def __init__(self, model: BodyModel, chances: Chances) -> None:
        self._model, self._chances = model, chances
        self.reset()

    def reset(self) -> None:
        """Forget all scans."""
        self._single: dict[float, tuple[np.ndarray, np.ndarray]] = {}

    def at(self, stamp_s: float, window: Sequence[Seen]) -> np.ndarray:
        """Return first guesses (S, 11) of the state at a stamp from the poses of single scans."""
        some = [seen for seen in window if seen.sighting.returns]
        enough = [seen for seen in some if seen.sighting.returns >= SEEN] or some
        if not enough:
            return np.empty((0, WHOLE))
        clear = [seen for seen in enough if not seen.torn]
        # Scans that the seam tears tell how fast at least, and with that where.
        goings = _goings(some) if len(clear) < 2 else [None]
        used = clear or enough
        nearest = min(used, key=lambda seen: abs(seen.stamp_s - stamp_s))
        course = _course(used[0], used[-1])
        states = []
        for going in goings:
            known = [self._alone(seen, course, going) for seen in (used[0], nearest, used[-1])]
            states += [_between(known, stamp_s, turned, going) for turned in (0.0, np.pi)]
        return np.array(states)

    def _alone(
        self, seen: Seen, course: float | None, going: np.ndarray | None
    ) -> tuple[float, np.ndarray]:
        """Return when and in which pose (3,) a scan alone has it, of those along the way it goes.

        going: (2,) metres per second, by which what the seam tore is put together.
        """
        if seen.torn and going is not None:
            at_s, (vectors, costs) = seen.stamp_s, self._fitted(seen.sighting, going)
        else:
            at_s = seen.met_s
            if seen.stamp_s not in self._single:
                self._single[seen.stamp_s] = self._fitted(seen.sighting, np.zeros(2))
            vectors, costs = self._single[seen.stamp_s]
        if course is not None:
            costs = costs + TURNED * (np.abs(np.cos(vectors[:, 2] - course)) < NEAR)
        return at_s, vectors[np.argmin(costs)]

    def _fitted(self, sighting: Sighting, going: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (S, 3) of a scan alone and their costs (S,), of a body that goes so fast."""
        rays = thinned(sighting.rays, COARSE_RAYS)
        problem = still_problem(rays, self._model, self._chances, np.arange(3))
        speed = float(np.hypot(*going))
        points = np.asarray(points_of(sighting.rays, going))
        guesses = starts(points, sighting.origin, self._model, cut=sighting.cut)
        if speed > 0:
            problem = replace(problem, fixed=at_speed(speed))
            back = np.cos(guesses[:, 2] - np.arctan2(going[1], going[0])) < 0
            guesses[back, 2] += np.pi
        found = descend(problem, guesses)
        return found.vectors, found.costs


def _course(first: Seen, last: Seen) -> float | None:
    """Return the direction, radians, in which the returns' mean went from scan to scan."""
    span = last.met_s - first.met_s
    way = last.sighting.points.mean(axis=0) - first.sighting.points.mean(axis=0)
    length = float(np.hypot(*way))
    if length < COURSE_M or length < COURSE_M_S * span:
        return None
    return float(np.arctan2(way[1], way[0]))


def _goings(some: list[Seen]) -> list[np.ndarray | None]:
    """Return velocities (2,) that the returns' means may have, those of each half of a sweep apart.

    From half to half and, of several scans, from each half to its like: the halves of a sweep see
    different sides, of a vehicle that stands too.
    """
    halves: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for seen in some:
        rays, points = seen.sighting.rays, seen.sighting.points
        times = rays.time[rays.kind == HIT]
        for rows, half in zip(halves, (times < 0, times >= 0), strict=True):
            if half.any():
                rows.append(
                    np.array([seen.stamp_s + times[half].mean(), *points[half].mean(axis=0)])
                )
    known = [np.array(rows) for rows in halves if rows]
    alike = np.concatenate([rows - rows.mean(axis=0) for rows in known])
    every = np.concatenate(known) - np.concatenate(known).mean(axis=0)
    return [
        away[:, 0] @ away[:, 1:] / (away[:, 0] @ away[:, 0])
        for away in ((every, alike) if len(some) > 1 else (every,))
        if away[:, 0] @ away[:, 0] > 0
    ] or [np.zeros(2)]


def _between(
    known: list[tuple[float, np.ndarray]], stamp_s: float, turned: float,
    going: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """Return the state (11,) that goes with the poses of single scans.

    known: when and pose of the first, of the nearest to the stamp and of the last. going: (2,)
    metres per second, where all three are one scan.
    """
    (first_s, start), (nearest_s, pose), (last_s, end) = known
    state = np.zeros(WHOLE)
    state[:3] = pose
    state[2] += turned
    span = last_s - first_s
    if span > 0:
        going = (end[:2] - start[:2]) / span
        state[4] = _turn(known)
    if going is not None:
        state[:2] += going * (stamp_s - nearest_s)
        state[3] = going @ (np.cos(state[2]), np.sin(state[2]))
    return state


def _turn(known: list[tuple[float, np.ndarray]]) -> float:
    """Return the turn rate that goes with three headings, each known up to quarter turns."""
    (first_s, start), (nearest_s, pose), (last_s, end) = known
    span = last_s - first_s
    rates = (_up_to_a_quarter(end[2] - start[2]) + QUARTERS) / span
    off = _up_to_a_quarter(start[2] + rates * (nearest_s - first_s) - pose[2])
    return float(rates[np.argmin((off / HEADING_SD) ** 2 + (rates / TURN_SD) ** 2)])


def _up_to_a_quarter(angles: np.ndarray) -> np.ndarray:
    """Return angles from -45 to 45 degrees, quarter turns added."""
    return (angles + np.pi / 4) % (np.pi / 2) - np.pi / 4
