"""Right of way: which driver may enter a crossing or a roundabout."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.traffic.flow import Flow
from roadscope.envs.traffic.lane_geometry import Traffic, along_lane, next_lane
from roadscope.envs.traffic.road_users import DRIVER
from roadscope.envs.traffic.roads import LaneIndex, Roads

REQUEST_M = 26.0
"""Drivers request their path through a crossing this far before the line; chosen by hand."""
SHARP_M_S2 = 3.5
"""Drivers that would have to brake harder to stop at the line drive on; chosen by hand."""
PATIENCE_S = 4.0
"""After this wait of a driver, no later request that conflicts with its own is granted; chosen by
hand."""
CLEARANCE_M = 3.2
"""Paths through a crossing that come closer than this conflict: one of them is driven at a time."""
SAMPLES = 40
"""Points on a path at which its distance to other paths is computed."""


def _before_end(roads: Roads, lines: Mapping[LaneIndex, float]) -> np.ndarray:
    """Return (L,) how far before the end of each lane its line is, metres, nan for none."""
    before_end = np.full(len(roads.arrays.lanes), np.nan)
    for index, metres in lines.items():
        before_end[roads.lane_numbers[index]] = metres
    return before_end


@compiled(borrowing=True)
def _distance_to_line(traffic: Traffic, slot: int, line: float) -> float:
    """Return the metres from the front bumper to the line, negative beyond it."""
    body = traffic.bodies[slot]
    length = traffic.roads.lanes[body.target].length
    return float(length - line - along_lane(traffic, body.target, slot) - body.length / 2)


class Hold:
    """Stops all drivers of some lanes at their lines.

    lines: for each lane, how far before its end the line is.
    """

    def __init__(self, roads: Roads, lines: Mapping[LaneIndex, float]) -> None:
        self.lines = lines
        self._before_end = _before_end(roads, lines)

    def __call__(self, flow: Flow) -> None:
        """Set `hold` of each driver on these lanes."""
        hold(flow.traffic(), self._before_end)


@compiled()
def hold(traffic: Traffic, before_end: np.ndarray) -> None:
    """Stop all drivers at the lines of their lanes.

    before_end: (L,) how far before the end of each lane its line is, metres, nan for none.
    """
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.kind == DRIVER and not np.isnan(before_end[body.target]):
            left = traffic.roads.lanes[body.target].length - along_lane(traffic, body.target, slot)
            body.hold = left - before_end[body.target] - body.length / 2


# --------------------------------------------------------------------------------------------------
# Crossings.


class Conflicts:
    """Which paths through a crossing conflict with each other.

    lines: for each lane that ends at the crossing, how far before its end the line is.
    """

    def __init__(self, roads: Roads, lines: Mapping[LaneIndex, float]) -> None:
        self.lines = lines
        self.before_end = _before_end(roads, lines)
        paths = [
            (index[1], to, i)
            for index in lines
            for to, lanes in roads.network.graph[index[1]].items()
            for i in range(len(lanes))
        ]
        self.blocked_until = _blocked_until(roads, paths)


class Crossing:
    """Lets drivers onto a crossing if their paths do not conflict; others wait at the line.

    First come, first served. A driver with a free path may go before one whose path is blocked;
    once that one has waited for `PATIENCE_S`, only on a path that does not conflict with its own.
    """

    def __init__(self, conflicts: Conflicts) -> None:
        self.conflicts = conflicts
        self._requests = 0

    def __call__(self, flow: Flow) -> None:
        """Set `hold` of each approaching driver."""
        conflicts = self.conflicts
        self._requests = grant_paths(
            flow.traffic(),
            conflicts.before_end,
            conflicts.blocked_until,
            flow.now_s,
            self._requests,
        )


@compiled()
def grant_paths(
    traffic: Traffic, before_end: np.ndarray, blocked_until: np.ndarray, now_s: float, requests: int
) -> int:
    """Grant paths to drivers and let the others wait; return the number of requests so far.

    before_end: (L,) as in `hold`. blocked_until: (L, L), as `_blocked_until` returns it.
    requests: number of requests before this call.
    """
    bodies = traffic.bodies
    _release(traffic)
    waiting = np.full(len(bodies), -1)
    count = 0
    for slot in range(len(bodies)):
        if _requests_path(traffic, slot, before_end):
            body = bodies[slot]
            if body.ticket < 0:
                requests += 1
                body.ticket = requests
            if np.isnan(body.requested):
                body.requested = now_s
            k = count
            while k > 0 and bodies[waiting[k - 1]].ticket > body.ticket:
                waiting[k] = waiting[k - 1]
                k -= 1
            waiting[k] = slot
            count += 1
    reserved, reserved_count = np.empty(count, np.int64), 0
    for slot in waiting[:count]:
        body = bodies[slot]
        path = next_lane(traffic.roads, traffic.legs, body.first_leg, body.last_leg, body.target)
        free = not _is_blocked(traffic, path, blocked_until)
        for other in reserved[:reserved_count]:
            free = free and np.isnan(blocked_until[other, path])
        if free:
            body.path = path
        elif now_s - body.requested > PATIENCE_S:
            reserved[reserved_count] = path
            reserved_count += 1
    for slot in range(len(bodies)):
        body = bodies[slot]
        if body.kind == DRIVER:
            line = before_end[body.target]
            body.hold = np.nan
            if body.path < 0 and not np.isnan(line):
                body.hold = _distance_to_line(traffic, slot, line)
    return requests


@compiled(borrowing=True)
def _release(traffic: Traffic) -> None:
    """Take back the paths of drivers whose rear has left the crossing."""
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.path >= 0 and _starts_after(traffic, body.target, body.path):
            is_past = along_lane(traffic, body.target, slot) > body.length / 2 + 1.0
            body.path = -1 if is_past else body.path
            body.requested = np.nan if is_past else body.requested


@compiled(borrowing=True)
def _starts_after(traffic: Traffic, lane: int, path: int) -> bool:
    """Return whether a lane begins where a path ends."""
    lanes, roads = traffic.roads.lanes, traffic.roads.roads
    return bool(roads[lanes[lane].road].start == roads[lanes[path].road].end)


@compiled(borrowing=True)
def _requests_path(traffic: Traffic, slot: int, before_end: np.ndarray) -> bool:
    """Return whether a driver is close to its line, has no path, and is the first at that line."""
    body = traffic.bodies[slot]
    if body.kind != DRIVER or body.path >= 0 or np.isnan(before_end[body.target]):
        return False
    if not _distance_to_line(traffic, slot, before_end[body.target]) < REQUEST_M:
        return False
    along = along_lane(traffic, body.target, slot)
    for other in range(len(traffic.bodies)):
        rival = traffic.bodies[other]
        if rival.kind == DRIVER and rival.path < 0 and rival.target == body.target:
            ahead = along_lane(traffic, body.target, other)
            if ahead > along or (ahead == along and other > slot):
                return False
    return True


@compiled(borrowing=True)
def _is_blocked(traffic: Traffic, path: int, blocked_until: np.ndarray) -> bool:
    """Return whether a path conflicts with a granted one whose driver has not yet passed."""
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.path >= 0:
            until = blocked_until[body.path, path]
            if not np.isnan(until):
                along = -np.inf
                if body.target == body.path:
                    along = along_lane(traffic, body.path, slot)
                elif _starts_after(traffic, body.target, body.path):
                    length = traffic.roads.lanes[body.path].length
                    along = length + along_lane(traffic, body.target, slot)
                if along - body.length / 2 < until + 0.5:
                    return True
    return False


def _blocked_until(roads: Roads, paths: list[LaneIndex]) -> np.ndarray:
    """Return (L, L) how far along the first lane a driver on it blocks the second, metres.

    nan where the lanes do not conflict.
    """
    until = np.full((len(roads.arrays.lanes),) * 2, np.nan)
    along = {path: np.linspace(0.0, float(roads.lane(path).length), SAMPLES) for path in paths}
    points = {
        path: np.array([roads.lane(path).position(s, 0.0) for s in along[path]]) for path in paths
    }
    for a in paths:
        for b in paths:
            distances = np.linalg.norm(points[a][:, None] - points[b][None], axis=-1).min(axis=1)
            if a[0] != b[0] and distances.min() < CLEARANCE_M:
                pair = roads.lane_numbers[a], roads.lane_numbers[b]
                until[pair] = along[a][distances < CLEARANCE_M].max()
    return until


# --------------------------------------------------------------------------------------------------
# Roundabouts.


class GiveWay:
    """Lets drivers into a roundabout when no driver on it would have to brake for them.

    lines: for each entry lane, how far before its end the line is.
    ring: for each entry lane, the ring's lanes that lead to where it joins, nearest first.
    gap_s: least time from an entry until the next driver on the ring arrives there.
    """

    def __init__(
        self,
        roads: Roads,
        lines: Mapping[LaneIndex, float],
        ring: Mapping[LaneIndex, list[LaneIndex]],
        gap_s: float,
    ) -> None:
        self.lines, self.ring, self.gap_s = lines, ring, gap_s
        self._before_end = _before_end(roads, lines)
        longest = max(map(len, ring.values()))
        self._ring = np.full((len(roads.arrays.lanes), longest), -1)
        for entry, lanes in ring.items():
            numbers = [roads.lane_numbers[index] for index in lanes]
            self._ring[roads.lane_numbers[entry], : len(lanes)] = numbers

    def __call__(self, flow: Flow) -> None:
        """Set `hold` of each entering driver."""
        give_way(flow.traffic(), self._before_end, self._ring, self.gap_s)


@compiled()
def give_way(traffic: Traffic, before_end: np.ndarray, ring: np.ndarray, gap_s: float) -> None:
    """Let drivers wait at the lines of a roundabout until the ring is clear.

    before_end: (L,) as in `hold`. ring: (L, K) lanes of the ring before each entry lane, nearest
    first, then -1. gap_s: as in `GiveWay`.
    """
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.kind == DRIVER:
            body.hold = np.nan
            if not np.isnan(before_end[body.target]):
                distance = _distance_to_line(traffic, slot, before_end[body.target])
                stops = body.speed * body.speed / (2 * SHARP_M_S2) <= distance
                if stops and not _ring_is_clear(traffic, slot, distance, ring[body.target], gap_s):
                    body.hold = distance


@compiled(borrowing=True)
def _ring_is_clear(
    traffic: Traffic, slot: int, distance: float, ring: np.ndarray, gap_s: float
) -> bool:
    """Return whether all drivers that come along the ring are far enough away.

    distance: from the waiting driver's front to its line, metres.
    """
    body = traffic.bodies[slot]
    need_s = gap_s + max(distance, 0.0) / max(body.speed, 3.0)
    for other in range(len(traffic.bodies)):
        rival = traffic.bodies[other]
        if rival.kind == DRIVER and other != slot:
            left = _distance_to_entry(traffic, other, body.target, ring)
            if left < max(rival.speed, 4.0) * need_s + 2.0:
                return False
    return True


@compiled(borrowing=True)
def _distance_to_entry(traffic: Traffic, slot: int, entry: int, ring: np.ndarray) -> float:
    """Return the metres from a driver's front to where an entry joins; inf if it leaves before."""
    body, lanes, roads = traffic.bodies[slot], traffic.roads.lanes, traffic.roads.roads
    passes, distance = False, 0.0
    for leg in range(body.first_leg, body.last_leg):
        passes |= roads[traffic.legs[leg]].start == roads[lanes[entry].road].end
    if not passes:
        return np.inf
    for lane in ring:
        if lane >= 0:
            length = lanes[lane].length
            if body.target == lane:
                centre = distance + length - along_lane(traffic, lane, slot)
                return float(centre - body.length / 2)
            distance += length
    return np.inf
