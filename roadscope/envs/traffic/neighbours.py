"""Who is ahead and behind: bodies of each lane in sorted order, for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.traffic.lane_geometry import (
    LOOK_AHEAD_M,
    Heading,
    Traffic,
    along_lane,
    heading_at,
    lane_point,
    leg_after,
    next_lane,
)
from roadscope.envs.traffic.roads import LaneRecord

MARGIN_M = 0.35
"""Lateral distance that drivers keep from what they pass; chosen by hand."""
BEHIND_M, BEYOND_M = 1.0, 3.0
"""Points this far before the start and beyond the end of a lane still belong to it."""
BOX_MARGIN_M = 8.0
"""Bodies further than this from the box around a lane are not on it: more than two half widths of
vehicles and `BEYOND_M` together."""
SLACK_M = 1e-6
"""Sorted lists are searched this much further, since sums are rounded."""
ONCOMING = -0.7
"""Cosine between the headings of two bodies, below which they face each other."""


class Occupants(NamedTuple):
    """Bodies on each lane, sorted by the least coordinate of their three points along it; metres.

    counts: (L,) number of bodies. slots: (L, N). points: (L, N, 3, 2) coordinates along and across
    the lane of centre, front and rear. lows: (L, N) least coordinate along the lane of these three.
    reach: (L,) largest distance from `lows` to the centre of a body.
    changes: (2 N, 2) slots of bodies that change to another lane of their road, and that lane.
    change_count: (1,) number of them.
    """

    counts: np.ndarray
    slots: np.ndarray
    lows: np.ndarray
    points: np.ndarray
    reach: np.ndarray
    changes: np.ndarray
    change_count: np.ndarray


class Leader(NamedTuple):
    """The body ahead on a route.

    slot: -1 for none. gap: metres, bumper to bumper. heading: of the lane at its centre.
    """

    slot: int
    gap: float
    heading: Heading


class LaneNeighbours(NamedTuple):
    """Slots of the bodies ahead and behind on a lane, -1 for none."""

    ahead: int
    behind: int


@compiled()
def find_occupants(traffic: Traffic) -> Occupants:
    """Return the bodies on each lane."""
    bodies, lanes = traffic.bodies, traffic.roads.lanes
    count, most = len(lanes), len(bodies)
    occupants = Occupants(
        np.zeros(count, np.int64),
        np.empty((count, most), np.int64),
        np.empty((count, most)),
        np.empty((count, most, 3, 2)),
        np.zeros(count),
        np.empty((2 * most, 2), np.int64),
        np.zeros(1, np.int64),
    )
    widest = 0.0
    for slot in range(most):
        widest = max(widest, bodies[slot].width)
        note_change(occupants, traffic, slot)
    for lane in range(count):
        for slot in range(most):
            _add_occupant(occupants, traffic, lane, slot, widest)
    return occupants


@compiled(borrowing=True, forceinline=True)
def note_change(occupants: Occupants, traffic: Traffic, slot: int) -> None:
    """Record that a body changes lanes, so that drivers on its target lane know."""
    body, lanes = traffic.bodies[slot], traffic.roads.lanes
    if body.target != body.lane and lanes[body.target].road == lanes[body.lane].road:
        k = occupants.change_count[0]
        occupants.changes[k, 0], occupants.changes[k, 1] = slot, body.target
        occupants.change_count[0] = k + 1


@compiled(borrowing=True, forceinline=True)
def _add_occupant(
    occupants: Occupants, traffic: Traffic, lane: int, slot: int, widest: float
) -> None:
    """Insert a body in the sorted list of a lane if any of its points may be on it."""
    body, record = traffic.bodies[slot], traffic.roads.lanes[lane]
    margin = BOX_MARGIN_M + body.length / 2
    if abs(body.x - record.box_x) > record.half_x + margin:
        return
    if abs(body.y - record.box_y) > record.half_y + margin:
        return
    low, high, inside = np.inf, -np.inf, False
    k = occupants.counts[lane]
    points = occupants.points[lane]
    for row in range(3):
        point = lane_point(traffic, record, slot, row)
        points[k, row, 0], points[k, row, 1] = point
        low, high = min(low, point.along), max(high, point.along)
        inside |= abs(point.across) < (body.width + widest) / 2 + MARGIN_M
    if not inside or high < -BEHIND_M or low > record.length + BEYOND_M:
        return
    occupants.reach[lane] = max(occupants.reach[lane], points[k, 0, 0] - low + SLACK_M)
    _sort_in(occupants, lane, k, slot, low)
    occupants.counts[lane] = k + 1


@compiled(borrowing=True, forceinline=True)
def _sort_in(occupants: Occupants, lane: int, k: int, slot: int, low: float) -> None:
    """Move entry k, the last one of a lane's sorted list, to its place."""
    slots, lows, points = occupants.slots[lane], occupants.lows[lane], occupants.points[lane]
    slots[k], lows[k] = slot, low
    while k > 0 and lows[k - 1] > low:
        slots[k], slots[k - 1] = slots[k - 1], slot
        lows[k], lows[k - 1] = lows[k - 1], low
        for row in range(3):
            for axis in range(2):
                before = points[k - 1, row, axis]
                points[k - 1, row, axis] = points[k, row, axis]
                points[k, row, axis] = before
        k -= 1


@compiled(borrowing=True, forceinline=True)
def _first_from(lows: np.ndarray, count: int, low: float) -> int:
    """Return the index of the first of sorted coordinates that is not less than `low`."""
    first, last = 0, count
    while first < last:
        middle = (first + last) // 2
        if lows[middle] < low:
            first = middle + 1
        else:
            last = middle
    return first


# --------------------------------------------------------------------------------------------------
# Leaders along a route.


@compiled(borrowing=True)
def find_leader(traffic: Traffic, occupants: Occupants, slot: int, lane: int) -> Leader:
    """Return the nearest body ahead of a driver, on a lane and on those that follow it."""
    body, lanes = traffic.bodies[slot], traffic.roads.lanes
    start, leg = -along_lane(traffic, lane, slot), body.first_leg
    while lane >= 0 and start < LOOK_AHEAD_M:
        leader, rear, centre = _nearest_on(traffic, occupants, slot, lane, start)
        if leader >= 0:
            gap = start + rear - body.length / 2
            return Leader(leader, gap, heading_at(lanes[lane], centre))
        start += lanes[lane].length
        leg = leg_after(traffic.roads, traffic.legs, leg, body.last_leg, lane)
        lane = next_lane(traffic.roads, traffic.legs, leg, body.last_leg, lane)
    return Leader(-1, np.inf, Heading(0.0, 0.0))


@compiled(borrowing=True, forceinline=True)
def _nearest_on(
    traffic: Traffic, occupants: Occupants, slot: int, lane: int, start: float
) -> tuple[int, float, float]:
    """Return the slot of the nearest body ahead on a lane, -1 for none, and two coordinates.

    They are the coordinates along the lane of its rearmost point there and of its centre.
    start: distance from the driver's centre to the start of the lane, metres. Of two equally near
    bodies the one with the lower slot counts.
    """
    body, record = traffic.bodies[slot], traffic.roads.lanes[lane]
    leader, rear, centre = -1, np.inf, 0.0
    count, lows, points = occupants.counts[lane], occupants.lows[lane], occupants.points[lane]
    k = _first_from(lows, count, -start - occupants.reach[lane])
    while k < count and lows[k] <= rear:
        other = occupants.slots[lane, k]
        if _is_ahead(traffic, slot, other, start + points[k, 0, 0]):
            limit = (traffic.bodies[other].width + body.width) / 2 + MARGIN_M
            least = np.inf
            for row in range(3):
                if abs(points[k, row, 1]) < limit:
                    least = _nearer(points[k, row, 0], record, least)
            if least < rear or (least == rear < np.inf and other < leader):
                leader, rear, centre = other, least, points[k, 0, 0]
        k += 1
    for k in range(occupants.change_count[0]):
        other = occupants.changes[k, 0]
        if occupants.changes[k, 1] == lane:
            middle = along_lane(traffic, lane, other)
            if _is_ahead(traffic, slot, other, start + middle):
                least = np.inf
                for row in range(3):
                    least = _nearer(lane_point(traffic, record, other, row).along, record, least)
                if least < rear or (least == rear < np.inf and other < leader):
                    leader, rear, centre = other, least, middle
    return leader, rear, centre


@compiled(borrowing=True, forceinline=True)
def _is_ahead(traffic: Traffic, slot: int, other: int, distance: float) -> bool:
    """Return whether another body's centre is ahead and it does not face the driver.

    distance: from the driver's centre to the other's along the route, metres.
    """
    body, leader = traffic.bodies[slot], traffic.bodies[other]
    facing = leader.cos * body.cos + leader.sin * body.sin < ONCOMING
    return bool(other != slot and distance > 0.0 and not facing)


@compiled(borrowing=True, forceinline=True)
def _nearer(along: float, lane: LaneRecord, least: float) -> float:
    """Return the lesser of two coordinates, or `least` if `along` is not on the lane."""
    return min(along, least) if -BEHIND_M < along < lane.length + BEYOND_M else least


# --------------------------------------------------------------------------------------------------
# Neighbours on a lane, for lane changes.


class _Nearest(NamedTuple):
    """The nearest bodies so far: their slots, -1 for none, and signed distances ahead, metres."""

    ahead: int
    ahead_m: float
    behind: int
    behind_m: float


NOBODY = _Nearest(-1, np.inf, -1, -np.inf)


@compiled(borrowing=True)
def find_neighbours(traffic: Traffic, occupants: Occupants, slot: int, lane: int) -> LaneNeighbours:
    """Return the bodies ahead and behind on a lane, and on those before and after it."""
    body, roads = traffic.bodies[slot], traffic.roads
    here = along_lane(traffic, lane, slot)
    best = _nearest_with(traffic, occupants, slot, lane, 0.0, here, NOBODY)
    following = next_lane(roads, traffic.legs, body.first_leg, body.last_leg, lane)
    if following >= 0:
        start = roads.lanes[lane].length
        best = _nearest_with(traffic, occupants, slot, following, start, here, best)
    for k in range(roads.sources.shape[1]):
        source = roads.sources[lane, k]
        if source >= 0:
            start = -roads.lanes[source].length
            best = _nearest_with(traffic, occupants, slot, source, start, here, best)
    return LaneNeighbours(best.ahead, best.behind)


@compiled(borrowing=True)
def _nearest_with(
    traffic: Traffic,
    occupants: Occupants,
    slot: int,
    lane: int,
    start: float,
    here: float,
    best: _Nearest,
) -> _Nearest:
    """Return the nearest of the bodies so far (`best`) and of those on one more lane.

    start: where that lane begins; here: where the driver is. Both are coordinates along the lane of
    `find_neighbours`, metres.
    """
    count, lows, points = occupants.counts[lane], occupants.lows[lane], occupants.points[lane]
    record, width, reach = traffic.roads.lanes[lane], traffic.bodies[slot].width, occupants.reach
    nearest = NOBODY
    k = _first_from(lows, count, here - start - reach[lane])
    while k < count and lows[k] + start - here <= nearest.ahead_m:
        other, along = occupants.slots[lane, k], points[k, 0, 0]
        if _blocks(traffic, points[k], other, width) and other != slot and _is_on(record, along):
            nearest = _closer(nearest, other, along + start - here)
        k += 1
    k = _first_from(lows, count, here - start + SLACK_M) - 1
    while k >= 0 and lows[k] + reach[lane] + start - here >= nearest.behind_m:
        other, along = occupants.slots[lane, k], points[k, 0, 0]
        if _blocks(traffic, points[k], other, width) and other != slot and _is_on(record, along):
            nearest = _closer(nearest, other, along + start - here)
        k -= 1
    for k in range(occupants.change_count[0]):
        other = occupants.changes[k, 0]
        if other != slot and occupants.changes[k, 1] == lane:
            along = along_lane(traffic, lane, other)
            if _is_on(record, along):
                nearest = _closer(nearest, other, along + start - here)
    ahead = nearest if nearest.ahead_m < best.ahead_m else best
    behind = nearest if nearest.behind_m > best.behind_m else best
    return _Nearest(ahead.ahead, ahead.ahead_m, behind.behind, behind.behind_m)


@compiled(borrowing=True, forceinline=True)
def _closer(best: _Nearest, other: int, offset: float) -> _Nearest:
    """Return the nearest bodies with one more; of two equally near the lower slot counts."""
    if offset >= 0.0:
        if offset < best.ahead_m or (offset == best.ahead_m and other < best.ahead):
            return _Nearest(other, offset, best.behind, best.behind_m)
    elif offset > best.behind_m or (offset == best.behind_m and other < best.behind):
        return _Nearest(best.ahead, best.ahead_m, other, offset)
    return best


@compiled(borrowing=True, forceinline=True)
def _blocks(traffic: Traffic, points: np.ndarray, other: int, width: float) -> bool:
    """Return whether any point of a body is in the path of a vehicle.

    points: (3, 2) of the body, as in `Occupants`. width: of the vehicle, metres.
    """
    limit = (traffic.bodies[other].width + width) / 2 + MARGIN_M
    return bool(abs(points[0, 1]) < limit or abs(points[1, 1]) < limit or abs(points[2, 1]) < limit)


@compiled(borrowing=True, forceinline=True)
def _is_on(lane: LaneRecord, along: float) -> bool:
    """Return whether a coordinate is on a lane or close to its ends."""
    return bool(-BEHIND_M <= along < lane.length + 1.0)
