"""Vehicles that appear at the starts of lanes and are removed at the ends of roads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.driving import Driver
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.mix import EGO, draw_body

GAPS_M = Bounds(7.0, 12.0)
"""Gaps between bumpers in a line of vehicles at the start; chosen by hand."""
CLEAR_M = 3.0
"""Vehicles vanish this far before the end of the last lane."""


@dataclass(slots=True)
class Inflow:
    """Adds vehicles at the starts of lanes and removes them at the ends of roads.

    sources: lanes on which vehicles appear.
    choose: draws the destination node for a source lane and a body length in metres; None to go
        to the end of the source lane.
    mix: name of the mix of bodies, see `mix.draw_body`.
    desired_speed: mean speed of these drivers on a free road, m/s.
    headway_s: mean time between two vehicles of one source.
    ego: the ego, which never vanishes.
    due_s: when the next vehicle of each source is due.
    """

    rng: np.random.Generator
    sources: Sequence[Any]
    choose: Callable[[np.random.Generator, Any, float], str | None]
    mix: str
    desired_speed: float
    headway_s: float
    ego: Any = None
    due_s: dict[Any, float] | None = None

    def __call__(self, road: FlowRoad) -> None:
        """Remove vehicles that have arrived; add those that are due where there is space."""
        remove_arrived(road, self.ego)
        if self.due_s is None:
            first = self.rng.uniform(0.0, self.headway_s, len(self.sources))
            self.due_s = dict(zip(self.sources, first.tolist(), strict=True))
        for source, due in self.due_s.items():
            if road.now_s >= due and self._has_space(road, source):
                self.place(road, source, 0.0, draw_body(self.mix, self.rng))
                wait = self.headway_s * float(self.rng.uniform(0.6, 1.4))
                self.due_s[source] = road.now_s + wait

    def line_up(
        self, road: FlowRoad, source: Any, first_m: float, ego_rank: int = -1
    ) -> list[Driver]:
        """Fill a source lane from a position back to its start, the foremost driver first.

        ego_rank: which of them is the ego, if any, counted from 0.
        """
        drivers: list[Driver] = []
        front = first_m
        while True:
            body = EGO if len(drivers) == ego_rank else draw_body(self.mix, self.rng)
            if front - body.size[0] < 2.0:
                return drivers
            drivers.append(self.place(road, source, front - body.size[0] / 2, body))
            front -= body.size[0] + float(self.rng.uniform(*GAPS_M))

    def line_up_all(self, road: FlowRoad, distance_m: Bounds, ego_rank: int) -> Driver:
        """Fill all source lanes up to a drawn distance before their ends; return the ego.

        ego_rank: which driver of the first source is the ego; it never vanishes.
        """
        for source in self.sources:
            first = float(road.network.get_lane(source).length - self.rng.uniform(*distance_m))
            rank = ego_rank if source == self.sources[0] else -1
            queue = self.line_up(road, source, first, rank)
            if rank >= 0:
                self.ego = queue[rank]
        ego: Driver = self.ego
        return ego

    def place(self, road: FlowRoad, source: Any, along_m: float, body: Any) -> Driver:
        """Put a driver with a given body on a source lane."""
        desired_speed = self.desired_speed * float(self.rng.uniform(0.9, 1.1))
        driver = Driver(
            road,
            source,
            along_m,
            body=body,
            speed=0.85 * desired_speed,
            desired_speed=desired_speed,
        )
        driver.vary(self.rng)
        goal = self.choose(self.rng, source, body.size[0])
        if goal is None:
            driver.route = [source]
        else:
            driver.plan_route_to(goal)
        road.vehicles.append(driver)
        road.refresh()
        return driver

    def _has_space(self, road: FlowRoad, source: Any) -> bool:
        """Return whether the last vehicle on a source lane has left enough space."""
        gaps = [
            road.along(v, source) - v.LENGTH / 2 for v in road.vehicles if v.lane_index == source
        ]
        return not gaps or min(gaps) > 8.0 + 0.9 * self.desired_speed


def remove_arrived(road: FlowRoad, ego: Any) -> None:
    """Remove vehicles at the end of the last lane of their route, except the ego."""
    arrived = [
        v for v in road.vehicles if v is not ego and isinstance(v, Driver) and _at_end(road, v)
    ]
    if arrived:
        road.vehicles = [v for v in road.vehicles if all(v is not a for a in arrived)]
        road.refresh()


def _at_end(road: FlowRoad, vehicle: Driver) -> bool:
    lane_index = vehicle.target_lane_index
    last = vehicle.route is not None and vehicle.route[-1][:2] == lane_index[:2]
    if not last and road.next_lane(lane_index, vehicle.route) is not None:
        return False
    left_m = road.network.get_lane(lane_index).length - road.along(vehicle, lane_index)
    return bool(left_m < CLEAR_M + vehicle.LENGTH / 2)
