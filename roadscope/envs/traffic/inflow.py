"""Vehicles that appear at the starts of lanes and are removed at the ends of roads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.core.jit import compiled
from roadscope.envs.traffic.flow import DriverSetup, Flow
from roadscope.envs.traffic.lane_geometry import Traffic, along_lane, next_lane
from roadscope.envs.traffic.mix import EGO, RoadUserBody, draw_body
from roadscope.envs.traffic.road_users import DRIVER, WALKER
from roadscope.envs.traffic.roads import LaneIndex

GAPS_M = Bounds(7.0, 12.0)
"""Gaps between bumpers in a line of vehicles at the start; chosen by hand."""
CLEAR_M = 3.0
"""Vehicles are removed when their front is this far before the end of the last lane."""


@dataclass(slots=True)
class Inflow:
    """Adds vehicles at the starts of lanes and removes them at the ends of roads.

    sources: lanes on which vehicles appear.
    choose: draws the destination node for a source lane and a body length in metres; None to go
        to the end of the source lane.
    mix: name of the mix of bodies, see `mix.draw_body`.
    desired_speed: mean speed of these drivers on a free road, m/s.
    headway_s: mean time between two vehicles of one source.
    ego: number of the ego, which is never removed; -1 for none.
    due_s: instant from which the next vehicle of each source may appear; None: drawn at first use.
    """

    rng: np.random.Generator
    sources: Sequence[LaneIndex]
    choose: Callable[[np.random.Generator, LaneIndex, float], str | None]
    mix: str
    desired_speed: float
    headway_s: float
    ego: int = -1
    due_s: dict[LaneIndex, float] | None = None

    def __call__(self, flow: Flow) -> None:
        """Remove vehicles that have arrived; add those that are due where there is space."""
        Outflow(self.ego)(flow)
        if self.due_s is None:
            first = self.rng.uniform(0.0, self.headway_s, len(self.sources))
            self.due_s = dict(zip(self.sources, first.tolist(), strict=True))
        for source, due in self.due_s.items():
            if flow.now_s >= due and self._has_space(flow, source):
                self.place(flow, source, 0.0, draw_body(self.mix, self.rng))
                wait = self.headway_s * float(self.rng.uniform(0.6, 1.4))
                self.due_s[source] = flow.now_s + wait

    def line_up(
        self, flow: Flow, source: LaneIndex, first_m: float, ego_rank: int = -1
    ) -> list[int]:
        """Fill a source lane from a position back to its start; return the numbers of the drivers.

        first_m: coordinate along the lane of the foremost front bumper.
        ego_rank: which driver is the ego, counted from 0 at the foremost; -1 for none.
        """
        drivers: list[int] = []
        front = first_m
        while True:
            body = EGO if len(drivers) == ego_rank else draw_body(self.mix, self.rng)
            if front - body.size[0] < 2.0:
                return drivers
            drivers.append(self.place(flow, source, front - body.size[0] / 2, body))
            front -= body.size[0] + float(self.rng.uniform(*GAPS_M))

    def line_up_all(self, flow: Flow, distance_m: Bounds, ego_rank: int) -> int:
        """Fill all source lanes up to a drawn distance before their ends; return the ego's number.

        ego_rank: which driver of the first source is the ego, as in `line_up`.
        """
        for source in self.sources:
            first = float(flow.roads.lane(source).length - self.rng.uniform(*distance_m))
            rank = ego_rank if source == self.sources[0] else -1
            queue = self.line_up(flow, source, first, rank)
            if rank >= 0:
                self.ego = queue[rank]
        return self.ego

    def place(self, flow: Flow, source: LaneIndex, along_m: float, body: RoadUserBody) -> int:
        """Put a driver with a given body on a source lane; return its number."""
        desired_speed = self.desired_speed * float(self.rng.uniform(0.9, 1.1))
        driver = DriverSetup(body, source, along_m, 0.85 * desired_speed, desired_speed).vary(
            self.rng
        )
        goal = self.choose(self.rng, source, body.size[0])
        roads = flow.roads
        driver.route = [roads.road_number(source)] if goal is None else roads.route(source, goal)
        return flow.add_driver(driver)

    def _has_space(self, flow: Flow, source: LaneIndex) -> bool:
        """Return whether the last vehicle on a source lane has left enough space."""
        gap = least_gap(flow.traffic(), flow.roads.lane_numbers[source])
        return gap > 8.0 + 0.9 * self.desired_speed


@dataclass(frozen=True, slots=True)
class Outflow:
    """Removes vehicles at the end of the last lane of their route, except the ego."""

    ego: int

    def __call__(self, flow: Flow) -> None:
        """Remove vehicles that have arrived."""
        if mark_arrived(flow.traffic(), self.ego):
            flow.remove_gone()


@compiled()
def mark_arrived(traffic: Traffic, ego: int) -> bool:
    """Mark drivers as gone that are at the end of their route; return whether there are any."""
    any_arrived = False
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.kind == DRIVER and body.number != ego:
            body.gone = is_at_end(traffic, slot)
            any_arrived |= body.gone
    return any_arrived


@compiled(borrowing=True)
def is_at_end(traffic: Traffic, slot: int) -> bool:
    """Return whether a driver is at the end of its route."""
    body, roads = traffic.bodies[slot], traffic.roads
    following = next_lane(roads, traffic.legs, body.first_leg, body.last_leg, body.target)
    if following >= 0:
        return False
    remaining = roads.lanes[body.target].length - along_lane(traffic, body.target, slot)
    return bool(remaining < CLEAR_M + body.length / 2)


@compiled()
def least_gap(traffic: Traffic, lane: int) -> float:
    """Return the metres from the start of a lane to the first vehicle on it, inf without one."""
    least = np.inf
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.kind != WALKER and body.lane == lane:
            least = min(least, along_lane(traffic, lane, slot) - body.length / 2)
    return least
