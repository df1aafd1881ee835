"""Lane coordinates and routes along lanes, for kernels.

Every operation is in the order of highway-env's or of NumPy, so that traffic remains equal to the
bit to that of highway-env's classes. The kernels call no arctangent: NumPy's rounds differently
from that of the C library. So callers compute the angles of all bodies about the centres of
circular lanes beforehand (`angles`), and add the arctangent of `slope` to a heading afterwards.
"""

from __future__ import annotations

from math import cos, hypot, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic

from roadscope.core.jit import compiled
from roadscope.envs.traffic.road_users import Bodies, RoadBody
from roadscope.envs.traffic.roads import CIRCULAR, SINE, LaneRecord, RoadArrays

LOOK_AHEAD_M = 120.0
"""Drivers look for leaders and curves this far ahead; chosen by hand."""


class Traffic(NamedTuple):
    """What kernels read of a road.

    legs: (K,) roads of all routes.
    angles: (C, 3, N) angles of centre, front and rear of each body about centres of lanes, radians.
    """

    bodies: Bodies
    roads: RoadArrays
    legs: np.ndarray
    angles: np.ndarray


class LanePoint(NamedTuple):
    """Lane coordinates of a point, metres."""

    along: float
    across: float


class Heading(NamedTuple):
    """A heading: a base in radians, plus the arctangent of a slope."""

    base: float
    slope: float


@intrinsic  # type: ignore[untyped-decorator]
def _multiply_add(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once, as BLAS does on processors that can."""
    signature = types.float64(types.float64, types.float64, types.float64)
    return signature, lambda context, builder, signature, arguments: builder.fma(*arguments)


@compiled()
def dot(x: float, y: float, other_x: float, other_y: float) -> float:
    """Return the scalar product of two vectors, rounded as `np.dot` does."""
    product: float = _multiply_add(y, other_y, x * other_x)
    return product


@compiled()
def wrapped(angle: float) -> float:
    """Return an angle within -pi to pi, as highway-env does."""
    return (angle + pi) % (2 * pi) - pi


@compiled(borrowing=True, forceinline=True)
def body_point(body: RoadBody, row: int) -> tuple[float, float]:
    """Return x and y of the centre (row 0), the front (1) or the rear (2) of a body, metres."""
    if row == 0:
        return body.x, body.y
    half_x, half_y = body.length / 2 * body.cos, body.length / 2 * body.sin
    if row == 1:
        return body.x + half_x, body.y + half_y
    return body.x - half_x, body.y - half_y


@compiled(borrowing=True, forceinline=True)
def lane_point(traffic: Traffic, lane: LaneRecord, slot: int, row: int) -> LanePoint:
    """Return the lane coordinates of a body's centre, front or rear."""
    x, y = body_point(traffic.bodies[slot], row)
    x, y = x - lane.x, y - lane.y
    if lane.kind == CIRCULAR:
        turned = wrapped(traffic.angles[lane.centre, row, slot] - lane.start_phase)
        along = lane.turn * turned * lane.radius
        return LanePoint(along, lane.turn * (lane.radius - hypot(x, y)))
    along = x * lane.along_x + y * lane.along_y
    across = x * lane.across_x + y * lane.across_y
    if lane.kind == SINE:
        across = across - lane.amplitude * sin(lane.pulsation * along + lane.phase)
    return LanePoint(along, across)


@compiled(borrowing=True)
def along_lane(traffic: Traffic, lane: int, slot: int) -> float:
    """Return the coordinate of a body's centre along a lane, metres."""
    return lane_point(traffic, traffic.roads.lanes[lane], slot, 0).along


@compiled(borrowing=True)
def local_coordinates(traffic: Traffic, lane: LaneRecord, slot: int) -> LanePoint:
    """Return `lane.local_coordinates` of highway-env for the centre of a body."""
    body = traffic.bodies[slot]
    x, y = body.x - lane.x, body.y - lane.y
    if lane.kind == CIRCULAR:
        angle = traffic.angles[lane.centre, 0, slot]
        phase = lane.start_phase + wrapped(angle - lane.start_phase)
        along = lane.turn * (phase - lane.start_phase) * lane.radius
        return LanePoint(along, lane.turn * (lane.radius - sqrt(dot(x, y, x, y))))
    along = dot(x, y, lane.along_x, lane.along_y)
    across = dot(x, y, lane.across_x, lane.across_y)
    if lane.kind == SINE:
        across = across - lane.amplitude * sin(lane.pulsation * along + lane.phase)
    return LanePoint(along, across)


@compiled(borrowing=True)
def heading_at(lane: LaneRecord, along: float) -> Heading:
    """Return the heading of a lane at a coordinate along it, highway-env's frame."""
    if lane.kind == CIRCULAR:
        phase = lane.turn * along / lane.radius + lane.start_phase
        return Heading(phase + pi / 2 * lane.turn, 0.0)
    if lane.kind == SINE:
        slope = lane.amplitude * lane.pulsation * cos(lane.pulsation * along + lane.phase)
        return Heading(lane.heading, slope)
    return Heading(lane.heading, 0.0)


@compiled(borrowing=True)
def centre_line(lane: LaneRecord, along: float) -> tuple[float, float]:
    """Return x and y of a point on the centre line of a lane, metres, highway-env's frame."""
    if lane.kind == CIRCULAR:
        phase = lane.turn * along / lane.radius + lane.start_phase
        return lane.x + lane.radius * cos(phase), lane.y + lane.radius * sin(phase)
    across = 0.0
    if lane.kind == SINE:
        across = lane.amplitude * sin(lane.pulsation * along + lane.phase)
    x = lane.x + along * lane.along_x + across * lane.across_x
    return x, lane.y + along * lane.along_y + across * lane.across_y


# --------------------------------------------------------------------------------------------------
# Along a route.


@compiled(borrowing=True)
def next_lane(roads: RoadArrays, legs: np.ndarray, first: int, last: int, lane: int) -> int:
    """Return the lane that follows a lane on a route, -1 at its end or where no road goes on.

    first, last: half-open range of the route's remaining legs; if it is empty, the nearest lane is
    taken.
    """
    road = roads.lanes[lane].road
    if first < last and legs[last - 1] == road:
        return -1
    for leg in range(first, last):
        if legs[leg] != road:
            for k in range(roads.onward.shape[1]):
                option = roads.onward[lane, k]
                if option >= 0 and roads.lanes[option].road == legs[leg]:
                    return int(option)
            return -1
    return int(roads.onward[lane, 0])


@compiled(borrowing=True)
def leg_after(roads: RoadArrays, legs: np.ndarray, first: int, last: int, lane: int) -> int:
    """Return the first remaining leg once a lane has been passed; the last leg always remains."""
    passed = first + 1 < last and legs[first] == roads.lanes[lane].road
    return first + 1 if passed else first


@compiled()
def path_ahead(traffic: Traffic, slot: int, points: int, step: float) -> np.ndarray:
    """Return (points, 2) of the centre line ahead of a driver, highway-env's frame, metres.

    step: arc length from one point to the next. The line begins beside the driver's centre and goes
    on past the end of the road.
    """
    body, roads = traffic.bodies[slot], traffic.roads
    path = np.empty((points, 2))
    lane, leg, along = body.target, body.first_leg, along_lane(traffic, body.target, slot)
    for k in range(points):
        while along > roads.lanes[lane].length:
            leg = leg_after(roads, traffic.legs, leg, body.last_leg, lane)
            following = next_lane(roads, traffic.legs, leg, body.last_leg, lane)
            if following < 0:
                break
            along -= roads.lanes[lane].length
            lane = following
        path[k] = centre_line(roads.lanes[lane], along)
        along += step
    return path


@compiled(borrowing=True)
def follow_road(traffic: Traffic, slot: int) -> None:
    """Set the target of a driver near the end of its lane to the next lane, as highway-env does."""
    body = traffic.bodies[slot]
    lanes, legs = traffic.roads.lanes, traffic.legs
    lane = lanes[body.target]
    along = local_coordinates(traffic, lane, slot).along
    # highway-env takes all vehicles for 5 m long and does so half of that before the end.
    if along <= lane.length - 2.5:
        return
    if body.first_leg < body.last_leg and legs[body.first_leg] == lane.road:
        body.first_leg += 1
    x, y = centre_line(lane, along)
    node = traffic.roads.roads[lane.road].end
    planned = -1
    if body.first_leg < body.last_leg:
        leg = legs[body.first_leg]
        planned = leg if traffic.roads.roads[leg].start == node else -1
    best, least = body.target, np.inf
    for k in range(traffic.roads.exits.shape[1]):
        road = traffic.roads.exits[body.target, k]
        if road >= 0 and (planned < 0 or road == planned):
            option, distance = _entry(traffic.roads, lane, road, x, y)
            if distance < least:
                best, least = option, distance
    body.target = best


@compiled(borrowing=True)
def _entry(roads: RoadArrays, lane: LaneRecord, road: int, x: float, y: float) -> tuple[int, float]:
    """Return the lane of a road that a driver takes after a lane, and the distance to it, metres.

    It is the one with the same number if both roads have as many lanes, otherwise the nearest one.
    x, y: the point from which distances are measured.
    """
    first, count = roads.roads[road].first, roads.roads[road].count
    if count == roads.roads[lane.road].count:
        return first + lane.number, _distance(roads.lanes[first + lane.number], x, y)
    best, least = first, np.inf
    for option in range(first, first + count):
        distance = _distance(roads.lanes[option], x, y)
        if distance < least:
            best, least = option, distance
    return best, least


@compiled(borrowing=True)
def _distance(lane: LaneRecord, x: float, y: float) -> float:
    """Return the distance from a point to a lane, metres: across it, plus beyond its ends."""
    x, y = x - lane.x, y - lane.y
    if lane.kind == CIRCULAR:
        along = lane.turn * wrapped(np.arctan2(y, x) - lane.start_phase) * lane.radius
        across = lane.turn * (lane.radius - hypot(x, y))
    else:
        along = x * lane.along_x + y * lane.along_y
        across = x * lane.across_x + y * lane.across_y
        if lane.kind == SINE:
            across = across - lane.amplitude * sin(lane.pulsation * along + lane.phase)
    return abs(across) + max(along - lane.length, 0.0) + max(0.0 - along, 0.0)
