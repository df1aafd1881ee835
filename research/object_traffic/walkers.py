"""People of our traffic as objects."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from math import cos, sin
from typing import Any, NamedTuple

import numpy as np

from research.object_traffic.driving import Driver, clamp
from research.object_traffic.flow import FlowRoad
from roadscope.envs.traffic.walking import (
    ACCELERATION_M_S2,
    AHEAD_S,
    COMFORTABLE_BRAKING_M_S2,
    MARGIN_M,
    NEARBY_M,
    REACTION_S,
)


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

    def __init__(self, body: Any, knots: np.ndarray) -> None:
        """Take over a record of `RoadBody` and the knots of its path."""
        self.number = int(body["number"])
        self.LENGTH, self.WIDTH = float(body["length"]), float(body["width"])
        self.diagonal = float(np.hypot(self.LENGTH, self.WIDTH))
        self.action = {"steering": 0.0, "acceleration": 0.0}
        self.speed = float(body["speed"])
        self.slot = -1
        self._pace, self._across_m = float(body["pace"]), float(body["across"])
        self._kerb_m = None if np.isnan(body["kerb"]) else float(body["kerb"])
        self._patience_s = float(body["patience"])
        self._xy = (knots["x"].tolist(), knots["y"].tolist())
        self._arc_lengths = knots["arc"].tolist()
        self._turns = knots["turn"][:-1].tolist()
        self._middles = knots["middle"][:-1].tolist()
        self._along_m = float(body["along"])
        self._crossing = bool(body["crossing"])
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
