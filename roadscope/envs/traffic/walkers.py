"""People on foot and on bicycles beside and across the road."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.flow import Flow
from roadscope.envs.traffic.mix import RoadUserBody, Size
from roadscope.envs.traffic.road_users import PATH, WALKER, joined
from roadscope.envs.traffic.roads import LaneIndex
from roadscope.envs.traffic.walking import decide_people

CORNER_CUTS = 4
"""Rounds of corner cutting (Chaikin 1974) that turn a polyline into a smooth path."""


def add_walker(
    flow: Flow,
    path: np.ndarray,
    body: RoadUserBody,
    pace: float,
    *,
    start_m: float = 0.0,
    kerb_m: float | None = None,
    across_m: float = 0.0,
    patience_s: float = 0.0,
) -> None:
    """Add a person who follows a path at a constant pace and waits at a kerb until it is safe.

    Drivers treat a person on the carriageway like another vehicle; nobody is hit, since people
    cross only in front of drivers that can stop.

    path: (K, 2) polyline in highway-env's frame, metres; its corners are rounded. pace: m/s.
    start_m: where along it the person begins. kerb_m: where along it to wait for a gap, None for
    nowhere; across_m: distance from there to the other side. patience_s: time to stand there before
    crossing.
    """
    knots = _knots(rounded_path(path))
    heading = float(np.interp(start_m, knots["middle"][:-1], knots["turn"][:-1]))
    rear = [float(np.interp(start_m, knots["arc"], knots[axis])) for axis in "xy"]
    first = len(flow.paths)
    flow.paths = joined([flow.paths, knots])
    flow.add(
        body,
        kind=WALKER,
        x=rear[0] + body.size.length_m / 2 * np.cos(heading),
        y=rear[1] + body.size.length_m / 2 * np.sin(heading),
        heading=heading,
        speed=0.0 if kerb_m == start_m else pace,
        first_knot=first,
        last_knot=first + len(knots),
        along=start_m,
        pace=pace,
        kerb=np.nan if kerb_m is None else kerb_m,
        across=across_m,
        patience=patience_s,
        crossing=kerb_m is None or start_m > kerb_m,
    )


def _knots(points: np.ndarray) -> np.ndarray:
    """Return (K,) of `PATH`: the knots of a polyline."""
    knots = np.zeros(len(points), PATH)
    knots["x"], knots["y"] = points.T
    steps = np.diff(points, axis=0)
    arcs = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    knots["arc"] = arcs
    knots["middle"][:-1] = (arcs[:-1] + arcs[1:]) / 2
    knots["turn"][:-1] = np.unwrap(np.arctan2(*steps.T[::-1]))
    return knots


class People:
    """Lets all people decide, and removes those who have arrived: one of `Stage.rules`."""

    def __init__(self, step_s: float) -> None:
        self.step_s = step_s

    def __call__(self, flow: Flow) -> None:
        """Let all people decide, and remove those at the end of their path."""
        if decide_people(flow.bodies, flow.paths, self.step_s):
            flow.remove_gone()


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
"""From the edge of the lane outwards to the middle of the pavement."""
KERB_M = 0.45
"""From the edge of the lane outwards to where people wait."""
EDGE_M = 0.3
"""From the edge of the lane inwards to the middle of a bicycle."""
WALKING_SPEEDS_M_S = Bounds(0.9, 1.7)
CYCLING_SPEEDS_M_S = Bounds(3.5, 5.5)
GROUPS = ((1, 0.55), (2, 0.30), (6, 0.15))
"""Number of people in a group and its probability: single, pair, crowd; chosen by hand."""


class Kerb:
    """One side of a lane: people walk beside it and cross from it."""

    def __init__(self, flow: Flow, lane_index: LaneIndex, width_m: float) -> None:
        """Take a lane whose right side is the road's edge, and the width of the whole road."""
        self._flow = flow
        self._lane = flow.roads.lane(lane_index)
        self._width_m = width_m

    @property
    def length_m(self) -> float:
        """Length of the lane."""
        return float(self._lane.length)

    def walk(self, rng: np.random.Generator, at_m: float, *, ends: Bounds) -> None:
        """Add a group that walks along the pavement in either direction.

        Coordinates are along the lane. at_m: where the group begins. ends: least and greatest
        coordinate of its path.
        """
        back = bool(rng.random() < 0.5)
        pace = float(rng.uniform(*WALKING_SPEEDS_M_S))
        count = _draw_group_size(rng)
        for along, aside in _offsets(count, rng):
            knots = np.linspace(*ends, 12)
            points = np.array([self._beside(s, PAVEMENT_M + aside) for s in knots])
            start = at_m + along - ends.low
            if back:
                points, start = points[::-1], ends.high - at_m + along
            self._add(points, pedestrian(rng), pace, start_m=max(start, 0.0))

    def cross(self, rng: np.random.Generator, at_m: float, *, coming_m: float) -> None:
        """Add a group that walks along the pavement for `coming_m`, then crosses at `at_m`."""
        pace = float(rng.uniform(*WALKING_SPEEDS_M_S))
        patience = float(rng.uniform(0.3, 1.5))
        for along, aside in _offsets(_draw_group_size(rng), rng):
            s = at_m + aside
            corner = self._beside(s, PAVEMENT_M)
            crossing_m = self._width_m + 2 * KERB_M
            far = self._beside(s, KERB_M - crossing_m - 0.5)
            points = np.array([self._beside(s - coming_m, PAVEMENT_M), corner, far])
            kerb = coming_m + PAVEMENT_M - KERB_M - 0.35 + min(along, 0.0)
            self._add(
                points,
                pedestrian(rng),
                pace,
                start_m=max(0.0, along),
                kerb_m=kerb,
                across_m=crossing_m,
                patience_s=patience,
            )

    def wait(self, rng: np.random.Generator, at_m: float) -> int:
        """Add a person who stands at the kerb until `StepOuts` acts; return the person's number."""
        crossing_m = self._width_m + 2 * KERB_M
        points = np.array(
            [self._beside(at_m, off) for off in (PAVEMENT_M, KERB_M - crossing_m - 0.5)]
        )
        kerb = PAVEMENT_M - KERB_M - 0.35
        number = len(self._flow.users)
        self._add(
            points,
            pedestrian(rng),
            float(rng.uniform(*WALKING_SPEEDS_M_S)),
            start_m=kerb,
            kerb_m=kerb,
            across_m=crossing_m,
            patience_s=np.inf,
        )
        return number

    def add_cyclist(self, rng: np.random.Generator, at_m: float, *, end_m: float) -> None:
        """Add a cyclist who rides with the traffic at the edge of the lane."""
        knots = np.linspace(at_m, end_m, 20)
        points = np.array([self._beside(s, -EDGE_M) for s in knots])
        self._add(points, cyclist(rng), float(rng.uniform(*CYCLING_SPEEDS_M_S)))

    def _beside(self, along_m: float, off_m: float) -> np.ndarray:
        """Return the (2,) point at `along_m`, `off_m` beyond the lane's right edge, highway-env."""
        half = float(self._lane.width_at(along_m)) / 2
        place: np.ndarray = np.asarray(self._lane.position(along_m, half + off_m))
        return place

    def _add(self, points: np.ndarray, body: RoadUserBody, pace: float, **options: float) -> None:
        add_walker(self._flow, points, body, pace, **options)


def _draw_group_size(rng: np.random.Generator) -> int:
    """Draw the number of people in a group."""
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
