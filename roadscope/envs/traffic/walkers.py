"""People on foot and on bicycles beside and across the road."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from math import cos, sin
from typing import Any

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.driving import Driver, between
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.mix import Body

# --------------------------------------------------------------------------------------------------
# People on foot and on bicycles beside and across the road.

ACCELERATION_M_S2 = 1.2
COMFORTABLE_BRAKING_M_S2 = 2.0
"""Who crosses expects drivers to brake no harder than this."""
REACTION_S = 0.6
MARGIN_M = 2.5
LOOK_M, AHEAD_S = 15.0, 0.8
CORNER_CUTS = 4
"""Rounds of corner cutting (Chaikin 1974) that turn a polyline into a path one can walk."""


class Walker:
    """Someone who follows a path at a pace of their own and waits at a kerb until it is safe.

    Positions are in highway-env's frame. Drivers see who is on the carriageway as they see each
    other; nobody is hit, since who crosses does so only before drivers that can stop.
    """

    target_lane_index = lane_index = lane = None
    collidable = check_collisions = False
    solid = crashed = False

    def __init__(
        self,
        path: np.ndarray,
        body: Body,
        pace: float,
        *,
        start_m: float = 0.0,
        kerb_m: float | None = None,
        across_m: float = 0.0,
        patience_s: float = 0.0,
    ) -> None:
        """Walk a (K, 2) polyline with rounded corners at a pace in m/s, from start_m on.

        kerb_m: where along the path to wait for a gap, None for nowhere; across_m: how far it is
        from there to the other side. patience_s: time to stand there before looking.
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
        ways = np.concatenate([[0.0], np.cumsum(steps)])
        self._ways = ways.tolist()
        self._turns = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])).tolist()
        self._middles = ((ways[:-1] + ways[1:]) / 2).tolist()
        self._along_m = start_m
        self._goes = kerb_m is None or start_m > kerb_m
        self._held = False
        self._settle()

    @property
    def velocity(self) -> np.ndarray:
        """(2,) m/s."""
        return self.speed * np.array([np.cos(self.heading), np.sin(self.heading)])

    @property
    def arrived(self) -> bool:
        """Whether the path is at its end."""
        return bool(self._along_m >= self._ways[-1] - 1e-6)

    def act(self, action: Any = None) -> None:
        """Decide nothing: `look` has done so."""

    def look(self, drivers: Sequence[Driver], places: np.ndarray, dt: float) -> None:
        """Step off the kerb if every driver who comes can stop before; never walk into one.

        places: (D, 2) metres, where the drivers are.
        """
        near = np.flatnonzero(np.abs(places - self.position).max(axis=1) <= LOOK_M)
        steps = [self._along_m + m + self.LENGTH for m in (0.5, 1.0, 0.5 + self.speed)]
        ahead = [self._place(along_m) for along_m in steps] if len(near) else []
        self._held = any(self._in_the_way(drivers[k], ahead) for k in near.tolist())
        if self._goes or self._kerb_m is None or self._along_m < self._kerb_m - 0.3:
            return
        self._patience_s -= dt
        if self._patience_s <= 0.0:
            line = self._line_across()
            self._goes = all(self._safe(driver, line) for driver in drivers)

    def _in_the_way(self, driver: Driver, steps: Sequence[np.ndarray]) -> bool:
        """Whether a driver is, or is about to be, where the next steps lead."""
        ahead = cos(driver.heading), sin(driver.heading)
        place, half, side = driver.position.tolist(), driver.LENGTH / 2, driver.WIDTH / 2
        front = half + 0.4 + driver.speed * AHEAD_S
        for step in steps:
            along, across = _seen(step.tolist(), place, ahead)
            if -half - 0.4 < along < front and abs(across) < side + 0.4:
                # Who already stands in front of a driver goes on: the driver is the one to stop.
                along, across = _seen(self.position.tolist(), place, ahead)
                return bool(abs(across) > side + 0.3 or along < half)
        return False

    def _line_across(self) -> np.ndarray:
        """Return (5, 2) places on the way across."""
        assert self._kerb_m is not None
        share = np.linspace(0.0, 1.0, 5)[:, None]
        here = self._place(self._kerb_m)
        there = self._place(min(self._kerb_m + self._across_m, self._ways[-1]))
        line: np.ndarray = here + share * (there - here)
        return line

    @staticmethod
    def _safe(driver: Driver, line: np.ndarray) -> bool:
        """Whether a driver can stop before the way across, or has passed it, or never comes."""
        ahead = np.array([np.cos(driver.heading), np.sin(driver.heading)])
        offsets = line - driver.position
        along = offsets @ ahead
        across = np.abs(offsets[:, 0] * ahead[1] - offsets[:, 1] * ahead[0])
        met = (across < driver.WIDTH / 2 + 1.5) & (along > -driver.LENGTH / 2 - 1.0)
        if not met.any():
            return True
        room = float(along[met].min()) - driver.LENGTH / 2 - MARGIN_M
        speed = float(driver.speed)
        return room > speed * REACTION_S + speed**2 / (2 * COMFORTABLE_BRAKING_M_S2)

    def step(self, dt: float) -> None:
        """Go on along the path, slowing down for the kerb and for its end."""
        stop = self._ways[-1] if self._goes or self._kerb_m is None else self._kerb_m
        room = max(stop - self._along_m, 0.0)
        pace = 0.0 if self._held else self._pace
        wish = min(pace, np.sqrt(2 * ACCELERATION_M_S2 * room))
        most = ACCELERATION_M_S2 * dt
        change = between(wish - self.speed, -2 * most, most)
        before, self.speed = self.speed, max(0.0, self.speed + change)
        self._along_m = min(self._along_m + 0.5 * (before + self.speed) * dt, stop)
        self._settle()

    def handle_collisions(self, other: Any, dt: float) -> None:
        """Touch nobody."""

    def _place(self, along_m: float) -> np.ndarray:
        x, y = (_read(along_m, self._ways, each) for each in self._xy)
        return np.array([x, y])

    def _settle(self) -> None:
        self.heading = _read(self._along_m, self._middles, self._turns)
        # The rear end follows the path: timelines take it for an axle that does not slip.
        ahead = np.array([np.cos(self.heading), np.sin(self.heading)])
        self.position = self._place(self._along_m) + self.LENGTH / 2 * ahead


def _read(at: float, places: list[float], values: list[float]) -> float:
    """Return what `np.interp` does, of one finite number and lists in a quarter of the time."""
    k = bisect_right(places, at) - 1
    if k < 0:
        return values[0]
    if k >= len(places) - 1:
        return values[-1]
    slope = (values[k + 1] - values[k]) / (places[k + 1] - places[k])
    return slope * (at - places[k]) + values[k]


def _seen(
    point: list[float], place: list[float], ahead: tuple[float, float]
) -> tuple[float, float]:
    """Return how far along and across a heading a point is from a place, metres."""
    dx, dy = point[0] - place[0], point[1] - place[1]
    return dx * ahead[0] + dy * ahead[1], dx * ahead[1] - dy * ahead[0]


class People:
    """Lets everybody on foot look before they step; a rule of a stage."""

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s

    def __call__(self, road: FlowRoad) -> None:
        """Look, and go home at the end of the way."""
        people = [v for v in road.vehicles if isinstance(v, Walker)]
        drivers = [v for v in road.vehicles if isinstance(v, Driver)]
        places = np.array([driver.position for driver in drivers]).reshape(-1, 2)
        for walker in people:
            walker.look(drivers, places, self._step_s)
        if any(walker.arrived for walker in people):
            road.vehicles = [v for v in road.vehicles if not (isinstance(v, Walker) and v.arrived)]
            road.refresh()


def rounded_path(points: np.ndarray) -> np.ndarray:
    """Return a polyline whose corners are cut, (K, 2) in and out; the ends stay."""
    path = np.asarray(points, np.float64)
    for _ in range(CORNER_CUTS):
        if len(path) < 3:
            break
        near, far = 0.75 * path[:-1] + 0.25 * path[1:], 0.25 * path[:-1] + 0.75 * path[1:]
        cut = np.stack([near, far], axis=1).reshape(-1, 2)
        path = np.concatenate([path[:1], cut[1:-1], path[-1:]])
    kept = np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9)
    walked: np.ndarray = path[kept]
    return walked


def pedestrian(rng: np.random.Generator) -> Body:
    """Draw somebody: adults and some children, standing heights (DIN 33402-2, rounded)."""
    height = float(rng.normal(1.70, 0.09)) if rng.random() < 0.88 else float(rng.uniform(1.1, 1.5))
    height = float(np.clip(height, 1.05, 2.0))
    return Body(Category.PEDESTRIAN, (round(0.34 * height, 3), round(0.29 * height, 3), height))


def cyclist(rng: np.random.Generator) -> Body:
    """Draw somebody on a city bicycle, handlebars 0.6 m wide."""
    return Body(Category.CYCLIST, (1.80, 0.60, float(np.clip(rng.normal(1.75, 0.06), 1.5, 1.95))))


# --------------------------------------------------------------------------------------------------
# Where people walk: along lanes, across them, alone, in pairs and in crowds.

PAVEMENT_M = 2.9
"""From the edge of the lane to the middle of the pavement."""
KERB_M = 0.45
"""From the edge of the lane to where one waits."""
EDGE_M = 0.3
"""From the edge of the lane to the middle of a bicycle."""
PACES = (0.9, 1.7)
RIDES = (3.5, 5.5)
GROUPS = ((1, 0.55), (2, 0.30), (6, 0.15))
"""Size of a group and how often: single, pair, crowd."""


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

    def walk(self, rng: np.random.Generator, at_m: float, *, ends: tuple[float, float]) -> None:
        """Put a group on the pavement at a place along the lane, walking either way."""
        back = bool(rng.random() < 0.5)
        pace = float(rng.uniform(*PACES))
        count = _group(rng)
        for along, aside in _offsets(count, rng):
            stops = np.linspace(*ends, 12)
            points = np.array([self._beside(s, PAVEMENT_M + aside) for s in stops])
            start = at_m + along - ends[0]
            if back:
                points, start = points[::-1], ends[1] - at_m + along
            self._add(points, pedestrian(rng), pace, start_m=max(start, 0.0))

    def cross(self, rng: np.random.Generator, at_m: float, *, coming_m: float) -> None:
        """Send a group along the pavement for a while and then across the road."""
        pace = float(rng.uniform(*PACES))
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

    def ride(self, rng: np.random.Generator, at_m: float, *, end_m: float) -> None:
        """Put a cyclist at the edge of the lane, riding with the traffic."""
        stops = np.linspace(at_m, end_m, 20)
        points = np.array([self._beside(s, -EDGE_M) for s in stops])
        self._add(points, cyclist(rng), float(rng.uniform(*RIDES)))

    def _beside(self, along_m: float, off_m: float) -> np.ndarray:
        """Place a given way beyond the right edge of the lane, highway-env's frame."""
        half = float(self._lane.width_at(along_m)) / 2
        place: np.ndarray = np.asarray(self._lane.position(along_m, half + off_m))
        return place

    def _add(self, points: np.ndarray, body: Any, pace: float, **options: float) -> None:
        self._road.vehicles.append(Walker(points, body, pace, **options))


def _group(rng: np.random.Generator) -> int:
    sizes, shares = zip(*GROUPS, strict=True)
    return int(rng.choice(sizes, p=shares))


def _offsets(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 2) metres along and aside: nobody walks into somebody else."""
    if count == 1:
        return np.zeros((1, 2))
    if count == 2:
        return np.array([[0.0, -0.36], [float(rng.uniform(-0.1, 0.1)), 0.36]])
    rows = np.arange(count) // 2
    sides = np.where(np.arange(count) % 2 == 0, -0.4, 0.4)
    return np.column_stack([-0.85 * rows, sides]) + rng.uniform(-0.12, 0.12, (count, 2))
