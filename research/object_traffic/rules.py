"""Rules of our traffic over objects: inflow, removal and right of way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from research.object_traffic.driving import Driver
from research.object_traffic.flow import FlowRoad
from roadscope.envs.traffic import junction
from roadscope.envs.traffic.inflow import CLEAR_M
from roadscope.envs.traffic.inflow import Inflow as DrawnInflow
from roadscope.envs.traffic.junction import CLEARANCE_M, PATIENCE_S, REQUEST_M, SHARP_M_S2
from roadscope.envs.traffic.mix import draw_body


class Inflow:
    """Adds vehicles at the starts of lanes and removes them at the ends of roads.

    drawn: the product's rule, which draws vehicles. place: puts one on a source lane.
    """

    def __init__(self, drawn: DrawnInflow, place: Callable[[Any, Any], Driver]) -> None:
        self._drawn, self._place = drawn, place

    def __call__(self, road: FlowRoad) -> None:
        """Remove vehicles that have arrived; add those that are due where there is space."""
        drawn = self._drawn
        remove_arrived(road, drawn.ego)
        if drawn.due_s is None:
            first = drawn.rng.uniform(0.0, drawn.headway_s, len(drawn.sources))
            drawn.due_s = dict(zip(drawn.sources, first.tolist(), strict=True))
        for source, due in drawn.due_s.items():
            if road.now_s >= due and self._has_space(road, source):
                driver = self._place(source, draw_body(drawn.mix, drawn.rng))
                road.vehicles.append(driver)
                road.refresh()
                wait = drawn.headway_s * float(drawn.rng.uniform(0.6, 1.4))
                drawn.due_s[source] = road.now_s + wait

    def _has_space(self, road: FlowRoad, source: Any) -> bool:
        """Return whether the last vehicle on a source lane has left enough space."""
        gaps = [
            road.along(v, source) - v.LENGTH / 2 for v in road.vehicles if v.lane_index == source
        ]
        return not gaps or min(gaps) > 8.0 + 0.9 * self._drawn.desired_speed


def remove_arrived(road: FlowRoad, ego: int) -> None:
    """Remove vehicles at the end of the last lane of their route, except the ego."""
    arrived = [
        v for v in road.vehicles if v.number != ego and isinstance(v, Driver) and _at_end(road, v)
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


def hold(road: FlowRoad, lines: Mapping[Any, float]) -> None:
    """Stop all drivers at the lines of their lanes."""
    for driver in road.vehicles:
        lane_index = driver.target_lane_index
        if lane_index in lines:
            left_m = float(road.network.get_lane(lane_index).length) - road.along(
                driver, lane_index
            )
            driver.hold_m = left_m - lines[lane_index] - driver.LENGTH / 2


class Crossing:
    """Lets drivers onto a crossing if their paths do not conflict; others wait at the line.

    First come, first served. A driver with a free path may go before one whose path is blocked,
    until that one has waited for `PATIENCE_S`.

    """

    def __init__(self, road: FlowRoad, lines: Mapping[Any, float]) -> None:
        self._lines = dict(lines)
        self._paths = [
            (lane_index[1], to, i)
            for lane_index in self._lines
            for to, lanes in road.network.graph[lane_index[1]].items()
            for i in range(len(lanes))
        ]
        self._blocked_until_m = _conflicts(road, self._paths)
        self._granted: dict[int, tuple[Driver, Any]] = {}
        self._requested_s: dict[int, float] = {}
        self._count = 0

    def __call__(self, road: FlowRoad) -> None:
        """Set `hold_m` of each approaching driver."""
        drivers = [v for v in road.vehicles if isinstance(v, Driver)]
        self._release(road, drivers)
        reserved_paths: list[Any] = []
        for ticket, driver, path in self._requests(road, drivers):
            reserved = any((other, path) in self._blocked_until_m for other in reserved_paths)
            if not reserved and not self._is_blocked(road, path):
                self._granted[ticket] = (driver, path)
            elif road.now_s - self._requested_s[ticket] > PATIENCE_S:
                reserved_paths.append(path)
        for driver in drivers:
            ticket = vars(driver).get("ticket", -1)
            line = self._lines.get(driver.target_lane_index)
            waits = line is not None and ticket not in self._granted
            driver.hold_m = (
                _distance_to_line(road, driver, line) if waits and line is not None else None
            )

    def _release(self, road: FlowRoad, drivers: list[Driver]) -> None:
        """Remove the grants of drivers whose rear has left the crossing."""
        here = {vars(d).get("ticket", -1): d for d in drivers}
        for ticket, (driver, path) in list(self._granted.items()):
            gone = ticket not in here
            lane_index = driver.target_lane_index
            if not gone and lane_index[0] == path[1]:
                gone = road.along(driver, lane_index) > driver.LENGTH / 2 + 1.0
            if gone:
                del self._granted[ticket]
                self._requested_s.pop(ticket, None)

    def _is_blocked(self, road: FlowRoad, path: Any) -> bool:
        """Return whether a path conflicts with a granted one whose driver has not yet passed."""
        for driver, other in self._granted.values():
            until = self._blocked_until_m.get((other, path))
            if until is not None:
                at = -np.inf
                if driver.target_lane_index == other:
                    at = road.along(driver, other)
                elif driver.target_lane_index[0] == other[1]:
                    length = float(road.network.get_lane(other).length)
                    at = length + road.along(driver, driver.target_lane_index)
                if at - driver.LENGTH / 2 < until + 0.5:
                    return True
        return False

    def _requests(self, road: FlowRoad, drivers: list[Driver]) -> list[tuple[int, Driver, Any]]:
        """Return ticket, driver and path of each request, the longest waiting first."""
        asking = []
        foremost = self._first_drivers(road)
        for driver in drivers:
            line = self._lines.get(driver.target_lane_index)
            if line is None or vars(driver).get("ticket", -1) in self._granted:
                continue
            if _distance_to_line(road, driver, line) < REQUEST_M and driver.slot in foremost:
                if "ticket" not in vars(driver):
                    driver.ticket = self._count = self._count + 1
                self._requested_s.setdefault(driver.ticket, road.now_s)
                path = road.next_lane(driver.target_lane_index, driver.route)
                asking.append((driver.ticket, driver, path))
        return sorted(asking, key=lambda item: item[0])

    def _first_drivers(self, road: FlowRoad) -> set[int]:
        """Return the slots of the first driver without a grant before each line."""
        slots = set()
        for lane_index in self._lines:
            waiting = [
                (road.along(v, lane_index), v.slot)
                for v in road.vehicles
                if isinstance(v, Driver)
                and v.target_lane_index == lane_index
                and vars(v).get("ticket", -1) not in self._granted
            ]
            if waiting:
                slots.add(max(waiting)[1])
        return slots


class GiveWay:
    """Lets drivers into a roundabout when no driver on it would have to brake for them."""

    def __init__(self, rule: junction.GiveWay) -> None:
        self._lines, self._ring, self._gap_s = dict(rule.lines), dict(rule.ring), rule.gap_s

    def __call__(self, road: FlowRoad) -> None:
        """Set `hold_m` of each entering driver."""
        for driver in road.vehicles:
            if not isinstance(driver, Driver):
                continue
            line = self._lines.get(driver.target_lane_index)
            driver.hold_m = None
            if line is not None:
                distance_m = _distance_to_line(road, driver, line)
                cannot_stop = driver.speed**2 / (2 * SHARP_M_S2) > distance_m
                if not cannot_stop and not self._ring_is_clear(road, driver, distance_m):
                    driver.hold_m = distance_m

    def _ring_is_clear(self, road: FlowRoad, driver: Driver, distance_m: float) -> bool:
        """Return whether all drivers that come along the ring are far enough away."""
        entry = driver.target_lane_index
        need_s = self._gap_s + max(distance_m, 0.0) / max(driver.speed, 3.0)
        for other in road.vehicles:
            if not isinstance(other, Driver) or other is driver:
                continue
            left_m = self._distance_to_entry(road, other, entry)
            if left_m is not None and left_m < max(other.speed, 4.0) * need_s + 2.0:
                return False
        return True

    def _distance_to_entry(self, road: FlowRoad, other: Driver, entry: Any) -> float | None:
        """Return the metres from a driver's front to an entry; None if it goes elsewhere."""
        if not any(leg[0] == entry[1] for leg in other.route or ()):
            return None
        distance_m = 0.0
        for lane_index in self._ring[entry]:
            length = float(road.network.get_lane(lane_index).length)
            if other.target_lane_index == lane_index:
                return distance_m + length - road.along(other, lane_index) - other.LENGTH / 2
            distance_m += length
        return None


def _distance_to_line(road: FlowRoad, driver: Driver, line: float) -> float:
    """Return the metres from the front bumper to the line, negative beyond it."""
    lane_index = driver.target_lane_index
    length = float(road.network.get_lane(lane_index).length)
    return length - line - road.along(driver, lane_index) - driver.LENGTH / 2


def _conflicts(road: FlowRoad, paths: list[Any]) -> dict[tuple[Any, Any], float]:
    """Return for each pair of conflicting paths how far along the first it blocks the second."""
    count, points = 40, {}
    for path in paths:
        lane = road.network.get_lane(path)
        points[path] = np.array([lane.position(s, 0.0) for s in np.linspace(0, lane.length, count)])
    until = {}
    for a in paths:
        along = np.linspace(0, float(road.network.get_lane(a).length), count)
        for b in paths:
            distances = np.linalg.norm(points[a][:, None] - points[b][None], axis=-1).min(axis=1)
            if a[0] != b[0] and distances.min() < CLEARANCE_M:
                until[a, b] = float(along[distances < CLEARANCE_M].max())
    return until
