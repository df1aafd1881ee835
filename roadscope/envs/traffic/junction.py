"""Right of way: who may enter a crossing or a roundabout."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from roadscope.envs.traffic.driving import Driver
from roadscope.envs.traffic.flow import FlowRoad

REQUEST_M = 26.0
"""Drivers ask for their way this far before the line."""
SHARP_M_S2 = 3.5
"""Who would have to brake harder to stop at the line goes on."""
PATIENCE_S = 4.0
"""Who has waited longer is no longer overtaken by others' requests."""
CLEARANCE_M = 3.2
"""Ways through a crossing that come closer than this exclude each other."""


class Crossing:
    """Lets drivers onto a crossing whose ways through do not meet; others wait at the line.

    First come, first served, except that a free way may be taken past somebody whose way is
    not, until that one has waited for `PATIENCE_S`.

    lines: for each lane that ends at the crossing, how far before its end the line is.
    """

    def __init__(self, road: FlowRoad, lines: Mapping[Any, float]) -> None:
        self._lines = dict(lines)
        self._ways = [
            (lane_index[1], to, i)
            for lane_index in self._lines
            for to, lanes in road.network.graph[lane_index[1]].items()
            for i in range(len(lanes))
        ]
        self._until = _meeting(road, self._ways)
        self._granted: dict[int, tuple[Driver, Any]] = {}
        self._asked_s: dict[int, float] = {}
        self._count = 0

    def __call__(self, road: FlowRoad) -> None:
        """Set how far each approaching driver may go."""
        drivers = [v for v in road.vehicles if isinstance(v, Driver)]
        self._release(road, drivers)
        promised: list[Any] = []
        for ticket, driver, way in self._requests(road, drivers):
            kept = any((other, way) in self._until for other in promised)
            if not kept and not self._taken(road, way):
                self._granted[ticket] = (driver, way)
            elif road.now_s - self._asked_s[ticket] > PATIENCE_S:
                promised.append(way)
        for driver in drivers:
            ticket = vars(driver).get("ticket", -1)
            line = self._lines.get(driver.target_lane_index)
            waits = line is not None and ticket not in self._granted
            driver.hold_m = _to_line(road, driver, line) if waits and line is not None else None

    def _release(self, road: FlowRoad, drivers: list[Driver]) -> None:
        """Forget the grants of those whose rear has left the crossing."""
        here = {vars(d).get("ticket", -1): d for d in drivers}
        for ticket, (driver, way) in list(self._granted.items()):
            gone = ticket not in here
            lane_index = driver.target_lane_index
            if not gone and lane_index[0] == way[1]:
                gone = road.along(driver, lane_index) > driver.LENGTH / 2 + 1.0
            if gone:
                del self._granted[ticket]
                self._asked_s.pop(ticket, None)

    def _taken(self, road: FlowRoad, way: Any) -> bool:
        """Whether a way meets that of somebody who has not yet passed where they meet."""
        for driver, other in self._granted.values():
            until = self._until.get((other, way))
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
        """List who asks for which way, the longest waiting first."""
        asking = []
        foremost = self._foremost(road)
        for driver in drivers:
            line = self._lines.get(driver.target_lane_index)
            if line is None or vars(driver).get("ticket", -1) in self._granted:
                continue
            if _to_line(road, driver, line) < REQUEST_M and driver.slot in foremost:
                if "ticket" not in vars(driver):
                    driver.ticket = self._count = self._count + 1
                self._asked_s.setdefault(driver.ticket, road.now_s)
                way = road.after(driver.target_lane_index, driver.route)
                asking.append((driver.ticket, driver, way))
        return sorted(asking, key=lambda item: item[0])

    def _foremost(self, road: FlowRoad) -> set[int]:
        """Slots of the first driver before each line who has no grant yet."""
        found = set()
        for lane_index in self._lines:
            waiting = [
                (road.along(v, lane_index), v.slot)
                for v in road.vehicles
                if isinstance(v, Driver)
                and v.target_lane_index == lane_index
                and vars(v).get("ticket", -1) not in self._granted
            ]
            if waiting:
                found.add(max(waiting)[1])
        return found


class GiveWay:
    """Lets drivers into a roundabout when nobody on it would have to brake for them.

    lines: for each entry lane, how far before its end the line is.
    ring: for each entry lane, the ring's lanes that lead to where it joins, nearest first.
    gap_s: least time that whoever comes on the ring must still need.
    """

    def __init__(
        self, lines: Mapping[Any, float], ring: Mapping[Any, list[Any]], gap_s: float
    ) -> None:
        self._lines, self._ring, self._gap_s = dict(lines), dict(ring), gap_s

    def __call__(self, road: FlowRoad) -> None:
        """Set how far each entering driver may go."""
        for driver in road.vehicles:
            if not isinstance(driver, Driver):
                continue
            line = self._lines.get(driver.target_lane_index)
            driver.hold_m = None
            if line is not None:
                way = _to_line(road, driver, line)
                bound = driver.speed**2 / (2 * SHARP_M_S2) > way
                if not bound and not self._clear(road, driver, way):
                    driver.hold_m = way

    def _clear(self, road: FlowRoad, driver: Driver, way_m: float) -> bool:
        """Whether everybody who comes along the ring is far enough."""
        entry = driver.target_lane_index
        need_s = self._gap_s + max(way_m, 0.0) / max(driver.speed, 3.0)
        for other in road.vehicles:
            if not isinstance(other, Driver) or other is driver:
                continue
            left = self._way_left(road, other, entry)
            if left is not None and left < max(other.speed, 4.0) * need_s + 2.0:
                return False
        return True

    def _way_left(self, road: FlowRoad, other: Driver, entry: Any) -> float | None:
        """Metres from somebody's front to where an entry joins; None if not on the way there."""
        if not any(leg[0] == entry[1] for leg in other.route or ()):
            return None
        way = 0.0
        for lane_index in self._ring[entry]:
            length = float(road.network.get_lane(lane_index).length)
            if other.target_lane_index == lane_index:
                return way + length - road.along(other, lane_index) - other.LENGTH / 2
            way += length
        return None


def _to_line(road: FlowRoad, driver: Driver, line: float) -> float:
    """Metres from the front bumper to the line, negative beyond it."""
    lane_index = driver.target_lane_index
    length = float(road.network.get_lane(lane_index).length)
    return length - line - road.along(driver, lane_index) - driver.LENGTH / 2


def _meeting(road: FlowRoad, ways: list[Any]) -> dict[tuple[Any, Any], float]:
    """Return, for ways from different roads that come too close, how far along the first."""
    count, points = 40, {}
    for way in ways:
        lane = road.network.get_lane(way)
        points[way] = np.array([lane.position(s, 0.0) for s in np.linspace(0, lane.length, count)])
    until = {}
    for a in ways:
        along = np.linspace(0, float(road.network.get_lane(a).length), count)
        for b in ways:
            apart = np.linalg.norm(points[a][:, None] - points[b][None], axis=-1).min(axis=1)
            if a[0] != b[0] and apart.min() < CLEARANCE_M:
                until[a, b] = float(along[apart < CLEARANCE_M].max())
    return until
