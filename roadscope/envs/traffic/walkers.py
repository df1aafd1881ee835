"""People on foot and on bicycles beside and across the road."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from math import cos, sin
from typing import Any, NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.driving import Driver, clamp
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.mix import RoadUserBody, Size

ACCELERATION_M_S2 = 1.2
COMFORTABLE_BRAKING_M_S2 = 2.0
"""People cross only if no driver would have to brake harder than this; chosen by hand."""
REACTION_S = 0.6
"""Reaction time of drivers that people assume."""
MARGIN_M = 2.5
"""Distance from a stopped driver that people want to keep."""
NEARBY_M, AHEAD_S = 15.0, 0.8
"""People notice drivers within this distance, and stay out of where these are this much later."""
CORNER_CUTS = 4
"""Rounds of corner cutting (Chaikin 1974) that turn a polyline into a smooth path."""


class _Direction(NamedTuple):
    """A unit vector."""

    cos: float
    sin: float


class Walker:
    """A person who follows a path at a constant pace and waits at a kerb until it is safe.

    Positions are in highway-env's frame. Drivers treat a person on the carriageway like another
    vehicle; nobody is hit, since people cross only in front of drivers that can stop.
    """

    target_lane_index = lane_index = lane = None
    collidable = check_collisions = False
    solid = crashed = False

    def __init__(
        self,
        path: np.ndarray,
        body: RoadUserBody,
        pace: float,
        *,
        start_m: float = 0.0,
        kerb_m: float | None = None,
        across_m: float = 0.0,
        patience_s: float = 0.0,
    ) -> None:
        """Follow a (K, 2) polyline with rounded corners at a pace in m/s, from start_m on.

        kerb_m: where along the path to wait for a gap, None for nowhere; across_m: distance from
        there to the other side. patience_s: time to stand there before crossing.
        """
        self.body = body
        self.LENGTH, self.WIDTH, _ = body.size
        self.diagonal = float(np.hypot(self.LENGTH, self.WIDTH))
        self.action = {"steering": 0.0, "acceleration": 0.0}
        self.speed = 0.0 if kerb_m == start_m else pace
        self.slot = -1
        self._pace, self._kerb_m, self._across_m = pace, kerb_m, across_m
        self._patience_s = patience_s
        points = rounded_path(path)
        self._xy = tuple(each.tolist() for each in points.T)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        arc_lengths = np.concatenate([[0.0], np.cumsum(steps)])
        self._arc_lengths = arc_lengths.tolist()
        self._turns = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])).tolist()
        self._middles = ((arc_lengths[:-1] + arc_lengths[1:]) / 2).tolist()
        self._along_m = start_m
        self._crossing = kerb_m is None or start_m > kerb_m
        self._blocked = False
        self._update_pose()

    @property
    def velocity(self) -> np.ndarray:
        """Return the velocity, (2,) m/s."""
        return self.speed * np.array([np.cos(self.heading), np.sin(self.heading)])

    @property
    def arrived(self) -> bool:
        """Return whether the person is at the end of the path."""
        return bool(self._along_m >= self._arc_lengths[-1] - 1e-6)

    def act(self, action: Any = None) -> None:
        """Do nothing: `decide` has chosen what to do."""

    def decide(self, drivers: Sequence[Driver], positions: np.ndarray, dt: float) -> None:
        """Start to cross if every driver can stop in time; stop before walking into a vehicle.

        positions: (D, 2) positions of the drivers, metres.
        """
        near = np.flatnonzero(np.abs(positions - self.position).max(axis=1) <= NEARBY_M)
        steps = [self._along_m + m + self.LENGTH for m in (0.5, 1.0, 0.5 + self.speed)]
        ahead = [self._position_at(along_m) for along_m in steps] if len(near) else []
        self._blocked = any(self._blocks(drivers[k], ahead) for k in near.tolist())
        if self._crossing or self._kerb_m is None or self._along_m < self._kerb_m - 0.3:
            return
        self._patience_s -= dt
        if self._patience_s <= 0.0:
            line = self._line_across()
            self._crossing = all(self._safe(driver, line) for driver in drivers)

    def _blocks(self, driver: Driver, steps: Sequence[np.ndarray]) -> bool:
        """Return whether a driver is, or soon will be, where the next steps lead."""
        ahead = _Direction(cos(driver.heading), sin(driver.heading))
        place, half, side = driver.position.tolist(), driver.LENGTH / 2, driver.WIDTH / 2
        front = half + 0.4 + driver.speed * AHEAD_S
        for step in steps:
            along, across = _along_and_across(step.tolist(), place, ahead)
            if -half - 0.4 < along < front and abs(across) < side + 0.4:
                # A person already in front of a driver continues: the driver has to stop.
                along, across = _along_and_across(self.position.tolist(), place, ahead)
                return bool(abs(across) > side + 0.3 or along < half)
        return False

    def _line_across(self) -> np.ndarray:
        """Return (5, 2) points on the line across the road, metres."""
        assert self._kerb_m is not None
        share = np.linspace(0.0, 1.0, 5)[:, None]
        here = self._position_at(self._kerb_m)
        there = self._position_at(min(self._kerb_m + self._across_m, self._arc_lengths[-1]))
        line: np.ndarray = here + share * (there - here)
        return line

    @staticmethod
    def _safe(driver: Driver, line: np.ndarray) -> bool:
        """Return whether a driver can stop before the line, has passed it, or never reaches it."""
        ahead = np.array([np.cos(driver.heading), np.sin(driver.heading)])
        offsets = line - driver.position
        along = offsets @ ahead
        across = np.abs(offsets[:, 0] * ahead[1] - offsets[:, 1] * ahead[0])
        crossed = (across < driver.WIDTH / 2 + 1.5) & (along > -driver.LENGTH / 2 - 1.0)
        if not crossed.any():
            return True
        clearance_m = float(along[crossed].min()) - driver.LENGTH / 2 - MARGIN_M
        speed = float(driver.speed)
        return clearance_m > speed * REACTION_S + speed**2 / (2 * COMFORTABLE_BRAKING_M_S2)

    def step(self, dt: float) -> None:
        """Move for `dt` seconds along the path; slow down for the kerb and for the end."""
        stop = self._arc_lengths[-1] if self._crossing or self._kerb_m is None else self._kerb_m
        left_m = max(stop - self._along_m, 0.0)
        pace = 0.0 if self._blocked else self._pace
        desired_speed = min(pace, np.sqrt(2 * ACCELERATION_M_S2 * left_m))
        limit = ACCELERATION_M_S2 * dt
        change = clamp(desired_speed - self.speed, -2 * limit, limit)
        before, self.speed = self.speed, max(0.0, self.speed + change)
        self._along_m = min(self._along_m + 0.5 * (before + self.speed) * dt, stop)
        self._update_pose()

    def handle_collisions(self, other: Any, dt: float) -> None:
        """Do nothing: people never collide."""

    def _position_at(self, along_m: float) -> np.ndarray:
        x, y = (_interpolate(along_m, self._arc_lengths, each) for each in self._xy)
        return np.array([x, y])

    def _update_pose(self) -> None:
        self.heading = _interpolate(self._along_m, self._middles, self._turns)
        # The rear end follows the path: timelines take it for an axle that does not slip.
        ahead = np.array([np.cos(self.heading), np.sin(self.heading)])
        self.position = self._position_at(self._along_m) + self.LENGTH / 2 * ahead


def _interpolate(value: float, knots: list[float], values: list[float]) -> float:
    """Return `np.interp` of one finite number and of lists, in a quarter of the time."""
    k = bisect_right(knots, value) - 1
    if k < 0:
        return values[0]
    if k >= len(knots) - 1:
        return values[-1]
    slope = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])
    return slope * (value - knots[k]) + values[k]


def _along_and_across(
    point: list[float], origin: list[float], ahead: _Direction
) -> tuple[float, float]:
    """Return the offset of a point from an origin, along and across a direction, metres."""
    dx, dy = point[0] - origin[0], point[1] - origin[1]
    return dx * ahead.cos + dy * ahead.sin, dx * ahead.sin - dy * ahead.cos


class People:
    """Lets all people decide once a step, and removes those who have arrived; a rule of a stage."""

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s

    def __call__(self, road: FlowRoad) -> None:
        """Let all people decide, and remove those at the end of their path."""
        people = [v for v in road.vehicles if isinstance(v, Walker)]
        drivers = [v for v in road.vehicles if isinstance(v, Driver)]
        positions = np.array([driver.position for driver in drivers]).reshape(-1, 2)
        for walker in people:
            walker.decide(drivers, positions, self._step_s)
        if any(walker.arrived for walker in people):
            road.vehicles = [v for v in road.vehicles if not (isinstance(v, Walker) and v.arrived)]
            road.refresh()


def rounded_path(points: np.ndarray) -> np.ndarray:
    """Return a (K, 2) polyline with rounded corners and the same ends."""
    path = np.asarray(points, np.float64)
    for _ in range(CORNER_CUTS):
        if len(path) < 3:
            break
        near, far = 0.75 * path[:-1] + 0.25 * path[1:], 0.25 * path[:-1] + 0.75 * path[1:]
        cut = np.stack([near, far], axis=1).reshape(-1, 2)
        path = np.concatenate([path[:1], cut[1:-1], path[-1:]])
    distinct = np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9)
    walkable: np.ndarray = path[distinct]
    return walkable


def pedestrian(rng: np.random.Generator) -> RoadUserBody:
    """Draw the body of an adult or a child; heights by DIN 33402-2, rounded."""
    height = float(rng.normal(1.70, 0.09)) if rng.random() < 0.88 else float(rng.uniform(1.1, 1.5))
    height = float(np.clip(height, 1.05, 2.0))
    length, width = round(0.34 * height, 3), round(0.29 * height, 3)
    return RoadUserBody(Category.PEDESTRIAN, Size(length, width, height))


def cyclist(rng: np.random.Generator) -> RoadUserBody:
    """Draw the body of a cyclist on a city bicycle with handlebars 0.6 m wide."""
    height = float(np.clip(rng.normal(1.75, 0.06), 1.5, 1.95))
    return RoadUserBody(Category.CYCLIST, Size(1.80, 0.60, height))


# --------------------------------------------------------------------------------------------------
# Where people walk: along lanes, across them, alone, in pairs and in crowds.

PAVEMENT_M = 2.9
"""From the edge of the lane to the middle of the pavement."""
KERB_M = 0.45
"""From the edge of the lane to where people wait."""
EDGE_M = 0.3
"""From the edge of the lane to the middle of a bicycle."""
WALKING_SPEEDS_M_S = Bounds(0.9, 1.7)
CYCLING_SPEEDS_M_S = Bounds(3.5, 5.5)
GROUPS = ((1, 0.55), (2, 0.30), (6, 0.15))
"""Number of people in a group and its probability: single, pair, crowd; chosen by hand."""


class Kerb:
    """One side of a lane: people walk beside it and cross from it."""

    def __init__(self, road: FlowRoad, lane_index: Any, width_m: float) -> None:
        """Take a lane whose right side is the road's edge, and the width of the whole road."""
        self._road = road
        self._lane = road.network.get_lane(lane_index)
        self._width_m = width_m

    @property
    def length_m(self) -> float:
        """Length of the lane."""
        return float(self._lane.length)

    def walk(self, rng: np.random.Generator, at_m: float, *, ends: Bounds) -> None:
        """Add a group that walks along the pavement in either direction.

        at_m: where the group begins; ends: between which coordinates along the lane it walks.
        """
        back = bool(rng.random() < 0.5)
        pace = float(rng.uniform(*WALKING_SPEEDS_M_S))
        count = _group(rng)
        for along, aside in _offsets(count, rng):
            stops = np.linspace(*ends, 12)
            points = np.array([self._beside(s, PAVEMENT_M + aside) for s in stops])
            start = at_m + along - ends.low
            if back:
                points, start = points[::-1], ends.high - at_m + along
            self._add(points, pedestrian(rng), pace, start_m=max(start, 0.0))

    def cross(self, rng: np.random.Generator, at_m: float, *, coming_m: float) -> None:
        """Add a group that walks `coming_m` along the pavement and crosses the road at `at_m`."""
        pace = float(rng.uniform(*WALKING_SPEEDS_M_S))
        patience = float(rng.uniform(0.3, 1.5))
        for along, aside in _offsets(_group(rng), rng):
            s = at_m + aside
            corner = self._beside(s, PAVEMENT_M)
            over = self._width_m + 2 * KERB_M
            far = self._beside(s, KERB_M - over - 0.5)
            points = np.array([self._beside(s - coming_m, PAVEMENT_M), corner, far])
            kerb = coming_m + PAVEMENT_M - KERB_M - 0.35 + min(along, 0.0)
            self._add(
                points,
                pedestrian(rng),
                pace,
                start_m=max(0.0, along),
                kerb_m=kerb,
                across_m=over,
                patience_s=patience,
            )

    def add_cyclist(self, rng: np.random.Generator, at_m: float, *, end_m: float) -> None:
        """Add a cyclist who rides with the traffic at the edge of the lane."""
        stops = np.linspace(at_m, end_m, 20)
        points = np.array([self._beside(s, -EDGE_M) for s in stops])
        self._add(points, cyclist(rng), float(rng.uniform(*CYCLING_SPEEDS_M_S)))

    def _beside(self, along_m: float, off_m: float) -> np.ndarray:
        """Return the (2,) point that far beyond the right edge of the lane, highway-env's frame."""
        half = float(self._lane.width_at(along_m)) / 2
        place: np.ndarray = np.asarray(self._lane.position(along_m, half + off_m))
        return place

    def _add(self, points: np.ndarray, body: Any, pace: float, **options: float) -> None:
        self._road.vehicles.append(Walker(points, body, pace, **options))


def _group(rng: np.random.Generator) -> int:
    sizes, shares = zip(*GROUPS, strict=True)
    return int(rng.choice(sizes, p=shares))


def _offsets(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return (count, 2) offsets within a group along and across its direction, metres."""
    if count == 1:
        return np.zeros((1, 2))
    if count == 2:
        return np.array([[0.0, -0.36], [float(rng.uniform(-0.1, 0.1)), 0.36]])
    rows = np.arange(count) // 2
    sides = np.where(np.arange(count) % 2 == 0, -0.4, 0.4)
    return np.column_stack([-0.85 * rows, sides]) + rng.uniform(-0.12, 0.12, (count, 2))
