"""Building blocks of scripted traffic: motions in closed form, lanes full of vehicles, roads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.course import Course
from roadscope.envs.traffic.mix import CARS, VANS, RoadUserBody, draw_body
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.traffic.timeline import Timeline

STEP_S = 0.04
"""Time between two instants of a scripted timeline: 25 Hz."""
BEHIND_M, AHEAD_M = 60.0, 220.0
"""How far a straight road extends behind and ahead of all actors; chosen by hand."""
WITHIN_M = 250.0
"""An actor is present while it is at most this far from the ego along the course."""
BEYOND_M = 260.0
"""How far a winding road extends behind and ahead of the ego's positions."""
REACH_M = 220.0
"""A lane is filled this far behind and ahead of the ego, at every instant."""
SPEED_VARIATION_M_S = 0.8
"""By how much the speed of a stream of vehicles varies at most; chosen by hand."""


NO_DELAY_S, USUAL_DELAYS_S, USUAL_GAPS_M = Bounds(0.0, 0.0), Bounds(0.8, 1.5), Bounds(4.0, 16.0)
"""Reaction times of followers and gaps between bumpers at standstill; chosen by hand."""


class Change(NamedTuple):
    """A smooth change of a speed (m/s) or of a lateral position (metres)."""

    start_s: float
    duration_s: float
    amount: float


@dataclass(frozen=True, slots=True)
class ScriptedMotion:
    """Motion of a rear axle whose speed and lateral position change by quintic smoothsteps.

    x_m, y_m: position at time 0 without any change, world frame. On a winding road x is the
        arc length along the course and y the distance to its left.
    speed: speed along x at the beginning, m/s.
    speed_changes, lane_changes: changes of the speed along x, and of y.

    Position is three times continuously differentiable, so yaw and yaw rate never jump.
    """

    x_m: float
    y_m: float
    speed: float
    speed_changes: tuple[Change, ...] = ()
    lane_changes: tuple[Change, ...] = ()

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return (T, 2) positions of the rear axle in metres."""
        x = self.x_m + self.speed * times
        y = np.full_like(times, self.y_m)
        for start, duration, change in self.speed_changes:
            x = x + change * duration * _smoothstep_integral((times - start) / duration)
        for start, duration, change in self.lane_changes:
            y = y + change * _smoothstep((times - start) / duration)
        return np.stack([x, y], axis=-1)

    def velocities(self, times: np.ndarray) -> np.ndarray:
        """Return (T, 2) velocities in m/s."""
        vx = np.full_like(times, self.speed)
        vy = np.zeros_like(times)
        for start, duration, change in self.speed_changes:
            vx = vx + change * _smoothstep((times - start) / duration)
        for start, duration, change in self.lane_changes:
            vy = vy + change / duration * _smoothstep_slope((times - start) / duration)
        return np.stack([vx, vy], axis=-1)

    def shifted(self, ahead_m: float, later_s: float) -> ScriptedMotion:
        """Return the same motion, farther ahead and later."""
        speed_changes, lane_changes = (
            tuple(Change(start + later_s, duration, amount) for start, duration, amount in changes)
            for changes in (self.speed_changes, self.lane_changes)
        )
        x_m = self.x_m + ahead_m - self.speed * later_s
        return ScriptedMotion(x_m, self.y_m, self.speed, speed_changes, lane_changes)

    def with_varying_speed(
        self, rng: np.random.Generator, interval_s: Bounds, limit_m_s: float
    ) -> ScriptedMotion:
        """Return the motion with a slowly varying speed, within the limit of the original one."""
        changes, offset = list(self.speed_changes), 0.0
        start = interval_s.low
        while start < interval_s.high:
            duration = float(rng.uniform(4.0, 8.0))
            next_offset = float(rng.uniform(-1.0, 1.0)) * limit_m_s
            changes.append(Change(start, duration, next_offset - offset))
            start, offset = start + duration + float(rng.uniform(0.0, 2.0)), next_offset
        return replace(self, speed_changes=tuple(changes))


@dataclass(frozen=True, slots=True)
class Actor:
    """A road user of a script.

    direction: 1 along the course, -1 for oncoming traffic, whose speed is negative.
    """

    motion: ScriptedMotion
    body: RoadUserBody
    direction: int = 1


class Reach(NamedTuple):
    """Distances behind and ahead of an actor up to which a lane is filled, metres."""

    behind: float
    ahead: float


@dataclass(frozen=True, slots=True)
class Lane:
    """Traffic of one lane by Newell's simplified car following (2002).

    A follower moves like its leader, `delay_s` later and a body and a gap behind, so no two
    vehicles collide, and speeds are smooth wherever the leader's speed is.

    left_m: offset of the lane to the left of the course.
    mix: a name of `mix.MIXES`.
    gaps_m: least and greatest distance between bumpers at standstill; drawn for each vehicle.
    delays_s: least and greatest reaction time after the leader; drawn for each vehicle.
    lateral_spread_m: greatest distance of a vehicle from the middle of the lane.
    direction: 1 along the course, -1 for oncoming traffic.
    """

    left_m: float
    mix: str
    gaps_m: Bounds
    delays_s: Bounds = NO_DELAY_S
    lateral_spread_m: float = 0.25
    direction: int = 1

    def around(self, rng: np.random.Generator, actor: Actor, reach_m: Reach) -> list[Actor]:
        """Return the other vehicles of the lane around an actor."""
        queue = []
        for step, reach in ((1, reach_m.ahead), (-1, reach_m.behind)):
            for other in self._queue(rng, actor, step):
                distance = step * self.direction * (other.motion.x_m - actor.motion.x_m)
                if distance > reach:
                    break
                queue.append(other)
        return queue

    def filled(
        self,
        rng: np.random.Generator,
        motion: ScriptedMotion,
        reach_m: Reach,
        body: RoadUserBody | None = None,
    ) -> list[Actor]:
        """Return all vehicles of the lane; the first of them has the motion and the body."""
        body = draw_body(self.mix, rng) if body is None else body
        first = Actor(replace(motion, y_m=self._lateral_m(rng)), body, self.direction)
        return [first, *self.around(rng, first, reach_m)]

    def _queue(self, rng: np.random.Generator, actor: Actor, step: int) -> Iterator[Actor]:
        """Yield vehicle after vehicle in driving direction (step 1) or against it (-1)."""
        motion, body = actor.motion, actor.body
        while True:
            previous, body = body, draw_body(self.mix, rng)
            # Positions are those of rear axles: a body lies ahead of its own axle.
            spacing = float(rng.uniform(*self.gaps_m)) + (previous if step > 0 else body).size[0]
            delay = float(rng.uniform(*self.delays_s))
            motion = motion.shifted(self.direction * step * spacing, -step * delay)
            motion = replace(motion, y_m=self._lateral_m(rng))
            yield Actor(motion, body, self.direction)

    def _lateral_m(self, rng: np.random.Generator) -> float:
        return self.left_m + float(rng.uniform(-1.0, 1.0)) * self.lateral_spread_m


@dataclass(frozen=True, slots=True)
class Carriageways:
    """Lanes in the ego's direction and, left of a median, oncoming ones.

    count: number of lanes in the ego's direction.
    ego_lane: which of them is the ego's, counted from the left; it lies on the course.
    mix: a name of `mix.MIXES`.
    oncoming: number of lanes of the other direction.
    gaps_m, delays_s: as in `Lane`.
    median_m: width of the gap between both directions.
    """

    count: int
    ego_lane: int
    mix: str
    oncoming: int = 0
    gaps_m: Bounds = USUAL_GAPS_M
    delays_s: Bounds = USUAL_DELAYS_S
    width_m: float = 3.5
    median_m: float = 1.0

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """Lanes of the ego's direction from left to right, then oncoming ones."""
        same = [((self.ego_lane - i) * self.width_m, 1) for i in range(self.count)]
        first = (self.ego_lane + 1) * self.width_m + self.median_m
        oncoming = [(first + i * self.width_m, -1) for i in range(self.oncoming)]
        return tuple(
            Lane(left, self.mix, self.gaps_m, self.delays_s, direction=direction)
            for left, direction in same + oncoming
        )

    def stream(
        self,
        rng: np.random.Generator,
        lane: Lane,
        *,
        lane_speed: float,
        ego_speed: float,
        until_s: float,
    ) -> list[Actor]:
        """Return all vehicles of a lane that come near the ego until then.

        lane_speed: of the lane in its own direction, m/s; ego_speed: along the course, m/s.
        """
        overtaken_m = (lane_speed - lane.direction * ego_speed) * until_s
        reach_m = Reach(REACH_M + max(overtaken_m, 0.0), REACH_M + max(-overtaken_m, 0.0))
        motion = ScriptedMotion(float(rng.uniform(-20.0, 20.0)), 0.0, lane.direction * lane_speed)
        motion = motion.with_varying_speed(rng, Bounds(-2.0, until_s), SPEED_VARIATION_M_S)
        return lane.filled(rng, motion, reach_m)

    def road(self, course: Course, style: str) -> WindingRoad:
        """Return the road with these lanes."""
        return WindingRoad(course, self.lanes, self.width_m, style)


@dataclass(frozen=True, slots=True)
class WindingRoad:
    """A course with lanes beside it; style: roadside style, a name of `roadside.STYLES`."""

    course: Course
    lanes: tuple[Lane, ...]
    width_m: float
    style: str

    def timeline(self, actors: Sequence[Actor], times: np.ndarray) -> Timeline:
        """Return the traffic at (T,) times, seconds; the first actor is the ego."""
        positions = np.stack([actor.motion.positions(times) for actor in actors], axis=1)
        near = np.abs(positions[..., 0] - positions[:, :1, 0]) < WITHIN_M
        ever_near = near.any(axis=0)
        actors = [actor for actor, present in zip(actors, ever_near, strict=True) if present]
        positions, near = positions[:, ever_near], near[:, ever_near]
        speeds, yaws = self._speeds_and_yaws(actors, positions, times)
        sizes = np.array([actor.body.size for actor in actors])
        present = np.logical_or.accumulate(near) & np.logical_or.accumulate(near[::-1])[::-1]
        return Timeline(
            stamps_s=times,
            ids=np.arange(len(actors)),
            categories=np.array([actor.body.category for actor in actors], np.int8),
            sizes=sizes,
            centre_ahead_m=sizes[:, 0] / 2,
            present=present,
            axles=self.course.points(positions[..., 0], positions[..., 1]),
            yaws=yaws,
            speeds=speeds,
            crashed=np.zeros_like(present),
            road=self._map(positions[:, 0, 0]),
            style=self.style,
        )

    def _speeds_and_yaws(
        self, actors: Sequence[Actor], positions: np.ndarray, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (T, A) speeds and yaws of rear axles, which do not slip."""
        velocities = np.stack([actor.motion.velocities(times) for actor in actors], axis=1)
        direction = np.array([actor.direction for actor in actors])
        curvature = self.course.curvatures(positions[..., 0])
        # A standing vehicle has no direction of motion: rounding must not turn it.
        forward = np.maximum(
            direction * velocities[..., 0] * (1.0 - curvature * positions[..., 1]), 0.0
        )
        lateral = direction * velocities[..., 1]
        turned = np.where(direction > 0, 0.0, np.pi)
        yaws = self.course.headings(positions[..., 0]) + turned + np.arctan2(lateral, forward)
        return np.hypot(forward, lateral), yaws

    def _map(self, along: np.ndarray) -> RoadMap:
        samples = np.arange(along.min() - BEYOND_M, along.max() + BEYOND_M, 2.0)
        width = np.full_like(samples, self.width_m)
        return RoadMap.from_lanes(
            [
                (
                    self.course.points(samples, np.full_like(samples, lane.left_m))[
                        :: lane.direction
                    ],
                    width,
                )
                for lane in self.lanes
            ]
        )


@dataclass(frozen=True, slots=True)
class StraightRoad:
    """A road along x.

    lanes_m: offsets of its lanes to the left of y = 0; all in the ego's direction.
    """

    lanes_m: tuple[float, ...]
    width_m: float
    style: str

    def timeline(self, actors: Sequence[Actor], times: np.ndarray) -> Timeline:
        """Return the traffic at (T,) times, seconds; the first actor is the ego."""
        velocities = np.stack([actor.motion.velocities(times) for actor in actors], axis=1)
        axles = np.stack([actor.motion.positions(times) for actor in actors], axis=1)
        sizes = np.array([actor.body.size for actor in actors])
        present = np.ones(axles.shape[:2], np.bool_)
        return Timeline(
            stamps_s=times,
            ids=np.arange(len(actors)),
            categories=np.array([actor.body.category for actor in actors], np.int8),
            sizes=sizes,
            centre_ahead_m=sizes[:, 0] / 2,
            present=present,
            axles=axles,
            yaws=np.arctan2(velocities[..., 1], velocities[..., 0]),
            speeds=np.hypot(velocities[..., 0], velocities[..., 1]),
            crashed=~present,
            road=self._map(axles[:, :, 0]),
            style=self.style,
        )

    def _map(self, along: np.ndarray) -> RoadMap:
        x = np.arange(along.min() - BEHIND_M, along.max() + AHEAD_M, 2.0)
        width = np.full_like(x, self.width_m)
        return RoadMap.from_lanes(
            [(np.stack([x, np.full_like(x, y)], axis=-1), width) for y in self.lanes_m]
        )


def times_until(end_s: float) -> np.ndarray:
    """Return the instants of a script from two steps before 0 to two after its end, seconds."""
    return np.arange(-2, round(end_s / STEP_S) + 3) * STEP_S


def any_car(rng: np.random.Generator) -> RoadUserBody:
    """Draw a car."""
    return RoadUserBody(Category.CAR, CARS[int(rng.integers(len(CARS)))])


def any_van(rng: np.random.Generator) -> RoadUserBody:
    """Draw a van."""
    return RoadUserBody(Category.VAN, VANS[int(rng.integers(len(VANS)))])


def _smoothstep(u: np.ndarray) -> np.ndarray:
    """Return the quintic smoothstep, which rises from 0 at u = 0 to 1 at u = 1."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _smoothstep_slope(u: np.ndarray) -> np.ndarray:
    """Return the derivative of the smoothstep."""
    u = np.clip(u, 0.0, 1.0)
    return 30.0 * u**2 * (1.0 - u) ** 2


def _smoothstep_integral(u: np.ndarray) -> np.ndarray:
    """Return the integral of the smoothstep from 0."""
    inside = np.clip(u, 0.0, 1.0)
    area: np.ndarray = inside**4 * (2.5 - 3.0 * inside + inside**2) + np.maximum(u - 1.0, 0.0)
    return area
