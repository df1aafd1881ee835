"""Traffic on a road, stepped by kernels over one array of all bodies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.traffic.driving import (
    COMFORT_HEAVY_M_S2,
    COMFORT_M_S2,
    LANE_CHANGE_DELAY_S,
    PLAN,
    Exponents,
    control,
    decide,
)
from roadscope.envs.traffic.lane_geometry import Traffic, body_point
from roadscope.envs.traffic.mix import RoadUserBody
from roadscope.envs.traffic.motion import move, turn_wheels
from roadscope.envs.traffic.road_users import (
    BODY,
    DRIVER,
    OBSTACLE,
    PARKED,
    PATH,
    Bodies,
    copied,
    joined,
    new_body,
)
from roadscope.envs.traffic.roads import LaneIndex, Roads

HEAVY = (Category.TRUCK, Category.BUS)


@dataclass(slots=True)
class DriverSetup:
    """A driver before it is on a road.

    along_m: coordinate of the centre along the lane. speed, desired_speed: m/s, at first and on a
    free road. route: numbers of the roads to take, from that of the lane on; None to take the
    nearest lane at each end of a road. time_gap_s, standstill_gap_m, comfort_m_s2: parameters of
    IDM. timer_s: as `RoadBody.timer`.
    """

    body: RoadUserBody
    lane_index: LaneIndex
    along_m: float
    speed: float
    desired_speed: float
    lane_changes: bool = False
    route: list[int] | None = None
    time_gap_s: float = 1.2
    standstill_gap_m: float = 2.5
    comfort_m_s2: float = 0.0
    timer_s: float = 0.0

    def __post_init__(self) -> None:
        self.set_body(self.body)

    def set_body(self, body: RoadUserBody) -> None:
        """Set the body and the acceleration, which is less for drivers of heavy vehicles."""
        self.body = body
        self.comfort_m_s2 = COMFORT_HEAVY_M_S2 if body.category in HEAVY else COMFORT_M_S2

    def vary(self, rng: np.random.Generator) -> DriverSetup:
        """Draw the time gap, the gap at standstill and the acceleration of this driver."""
        self.time_gap_s = float(rng.uniform(0.9, 1.5))
        self.standstill_gap_m = float(rng.uniform(2.0, 3.0))
        self.comfort_m_s2 *= float(rng.uniform(0.85, 1.15))
        self.timer_s = float(rng.uniform(0.0, LANE_CHANGE_DELAY_S))
        return self


class Flow:
    """The bodies on a road and their motion.

    roads: the network. users: category and size of each body by its number, None for obstacles.
    paths: (K,) of `PATH`, the knots of all people's paths. now_s: time since the start.
    """

    def __init__(self, roads: Roads) -> None:
        self.roads = roads
        self.users: list[RoadUserBody | None] = []
        self.now_s = 0.0
        self.paths = np.zeros(0, PATH)
        self._legs: dict[tuple[int, ...], int] = {}
        self._leg_array = np.zeros(0, np.int64)
        self._waiting: list[np.ndarray] = []
        self._angles: np.ndarray | None = None
        self._set_bodies(np.zeros(0, BODY))

    @property
    def bodies(self) -> Bodies:
        """All bodies, (N,) of `BODY` in highway-env's frame, in the order in which they decide."""
        if self._waiting:
            self._set_bodies(joined([self._bodies, *self._waiting]))
        return self._bodies

    def add_driver(self, driver: DriverSetup) -> int:
        """Put a driver on its lane; return its number."""
        if driver.lane_changes and driver.route is not None:
            raise ValueError("a driver with a route keeps its lane")
        lane = self.roads.lane_numbers[driver.lane_index]
        first, last = self.add_route(driver.route or [])
        return self._place(
            driver.lane_index,
            driver.along_m,
            driver.body,
            kind=DRIVER,
            lane=lane,
            target=lane,
            speed=driver.speed,
            target_speed=driver.desired_speed,
            lane_changes=driver.lane_changes,
            time_gap=driver.time_gap_s,
            standstill_gap=driver.standstill_gap_m,
            comfort=driver.comfort_m_s2,
            timer=driver.timer_s,
            first_leg=first,
            last_leg=last,
        )

    def park(
        self, lane_index: LaneIndex, along_m: float, body: RoadUserBody, *, reverse: bool = False
    ) -> None:
        """Put a standing vehicle on a lane. reverse: against the lane's direction."""
        lane = self.roads.lane_numbers[lane_index]
        turned = np.pi * reverse
        self._place(lane_index, along_m, body, turned, kind=PARKED, lane=lane, target=lane)

    def add_obstacle(self, obstacle: Any) -> None:
        """Put an obstacle of highway-env on the road."""
        lane = self.roads.lane_numbers[obstacle.lane_index]
        self.add(
            None,
            kind=OBSTACLE,
            x=obstacle.position[0],
            y=obstacle.position[1],
            heading=obstacle.heading,
            length=obstacle.LENGTH,
            width=obstacle.WIDTH,
            lane=lane,
            target=lane,
        )

    def add(self, user: RoadUserBody | None, **values: Any) -> int:
        """Add a body with fields of `RoadBody`; return its number."""
        number = len(self.users)
        self.users.append(user)
        if user is not None:
            values["length"], values["width"] = user.size.length_m, user.size.width_m
        self._waiting.append(new_body(number=number, **values))
        return number

    def remove_gone(self) -> None:
        """Remove all bodies that are marked as gone."""
        self._set_bodies(copied(self.bodies, ~self.bodies["gone"]))

    def traffic(self) -> Traffic:
        """Return what kernels read."""
        bodies = self.bodies
        if self._angles is None:
            self._angles = _angles(bodies, self.roads.arrays.centres)
        return Traffic(bodies, self.roads.arrays, self._leg_array, self._angles)

    def with_bodies(self, bodies: Bodies) -> Flow:
        """Return a flow of other bodies on the same roads, with the same routes and instant."""
        flow = Flow(self.roads)
        flow._legs, flow._leg_array = dict(self._legs), self._leg_array
        flow.now_s = self.now_s
        flow._set_bodies(bodies)
        return flow

    def bodies_changed(self) -> None:
        """Forget what was computed of the bodies; call it after changing headings or places."""
        self._angles = None

    def decide(self, dt: float) -> np.ndarray:
        """Let all drivers choose lanes and accelerations for a step of `dt` seconds.

        Returns (N,) of `PLAN`: what each of them steers and brakes for.
        """
        traffic = self.traffic()
        decide(traffic, self._plans, self._slopes, EXPONENTS)
        bends = np.arctan(self._slopes) if self.roads.has_sine_lanes else self._slopes
        control(traffic, self._plans, bends, EXPONENTS, dt, self._sines)
        return self._plans

    def step(self, dt: float) -> None:
        """Let all drivers decide, and move all bodies for `dt` seconds."""
        self.decide(dt)
        traffic = self.traffic()
        turn_wheels(self._bodies, np.arctan(2 * np.tan(np.arcsin(self._sines))))
        slips = np.arctan(1 / 2 * np.tan(self._bodies["steering"]))
        move(traffic, self.paths, slips, self._order, dt)
        self._angles = None
        self.now_s += dt

    def _place(
        self,
        lane_index: LaneIndex,
        along_m: float,
        body: RoadUserBody,
        turned: float = 0.0,
        **values: Any,
    ) -> int:
        lane = self.roads.lane(lane_index)
        x, y = lane.position(along_m, 0.0)
        return self.add(body, x=x, y=y, heading=lane.heading_at(along_m) + turned, **values)

    def add_route(self, roads: Iterable[int]) -> tuple[int, int]:
        """Return the half-open rows of `Traffic.legs` with a route. roads: numbers of its roads."""
        key = tuple(roads)
        if key not in self._legs:
            self._legs[key] = len(self._leg_array)
            self._leg_array = np.append(self._leg_array, np.array(key, np.int64))
        return self._legs[key], self._legs[key] + len(key)

    def _set_bodies(self, bodies: Bodies) -> None:
        count = len(bodies)
        self._bodies, self._waiting = bodies, []
        self._order = np.arange(count)
        self._plans, self._slopes = np.zeros(count, PLAN), np.zeros((count, 4))
        self._sines = np.zeros(count)
        self._angles = None


EXPONENTS = Exponents()


def _angles(bodies: Bodies, centres: np.ndarray) -> np.ndarray:
    """Return `Traffic.angles`, (C, 3, N), about (C, 2) centres of circular lanes."""
    if not len(centres):
        return np.zeros((0, 3, len(bodies)))
    offsets = _offsets(bodies, centres)
    angles: np.ndarray = np.arctan2(offsets[1], offsets[0])
    return angles


@compiled()
def _offsets(bodies: Bodies, centres: np.ndarray) -> np.ndarray:
    """Return (2, C, 3, N) offsets in x and y of centre, front and rear of bodies from centres."""
    offsets = np.empty((2, len(centres), 3, len(bodies)))
    for slot in range(len(bodies)):
        for row in range(3):
            x, y = body_point(bodies[slot], row)
            for k in range(len(centres)):
                offsets[0, k, row, slot] = x - centres[k, 0]
                offsets[1, k, row, slot] = y - centres[k, 1]
    return offsets
