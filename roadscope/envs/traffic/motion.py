"""The motion of bodies in one step, and their collisions, for kernels."""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.traffic.driving import STEERING_LIMIT_RAD
from roadscope.envs.traffic.lane_geometry import Traffic, dot, lane_point
from roadscope.envs.traffic.road_users import DRIVER, OBSTACLE, WALKER, Bodies, RoadBody
from roadscope.envs.traffic.walking import walk

FASTEST_M_S = 40.0
"""Largest speed of a vehicle: that of highway-env."""


@compiled()
def turn_wheels(bodies: Bodies, angles: np.ndarray) -> None:
    """Turn the wheels of all drivers towards (N,) angles, radians, by at most `turn_limit` each."""
    for slot in range(len(bodies)):
        body = bodies[slot]
        if body.kind == DRIVER:
            wanted = body.steering
            if not body.crashed:
                wanted = min(max(angles[slot], -STEERING_LIMIT_RAD), STEERING_LIMIT_RAD)
            turned = min(max(wanted - body.wheel, -body.turn_limit), body.turn_limit)
            body.wheel += turned
            body.steering = 0.0 if body.crashed else body.wheel


@compiled()
def move(
    traffic: Traffic, paths: np.ndarray, slips: np.ndarray, order: np.ndarray, dt: float
) -> None:
    """Move all bodies for `dt` seconds, update their lanes, and let those crash that touch.

    paths: (K,) of `PATH`, all knots of people's paths. slips: (N,) angles from the heading to the
    course, radians. order: (N,) slots by x at the last call; it is sorted here.
    """
    bodies = traffic.bodies
    for slot in range(len(bodies)):
        body = bodies[slot]
        if body.kind == DRIVER:
            _drive(body, slips[slot], dt)
            body.cos, body.sin = cos(body.heading), sin(body.heading)
        elif body.kind == WALKER:
            walk(body, paths, dt)
    for slot in range(len(bodies)):
        if bodies[slot].kind == DRIVER:
            _update_lane(traffic, slot)
    collide(bodies, order, dt)


@compiled(borrowing=True, forceinline=True)
def _drive(body: RoadBody, slip: float, dt: float) -> None:
    """Move a vehicle by the kinematic bicycle model of its centre; never backwards."""
    acceleration = -body.speed if body.crashed else max(body.acceleration, -body.speed / dt)
    if body.speed > FASTEST_M_S:
        acceleration = min(acceleration, FASTEST_M_S - body.speed)
    elif body.speed < 0.0:
        acceleration = max(acceleration, -body.speed)
    body.acceleration, body.slip = acceleration, slip
    body.timer += dt
    course = body.heading + slip
    body.x += body.speed * cos(course) * dt
    body.y += body.speed * sin(course) * dt
    if not np.isnan(body.impact_x):
        body.x += body.impact_x
        body.y += body.impact_y
        body.crashed = True
        body.impact_x, body.impact_y = np.nan, np.nan
    body.heading += body.speed * sin(slip) / (body.length / 2) * dt
    body.speed += acceleration * dt


@compiled(borrowing=True, forceinline=True)
def _update_lane(traffic: Traffic, slot: int) -> None:
    """Set the lane of a driver: the nearest of the target lane and those beside it."""
    body, lanes = traffic.bodies[slot], traffic.roads.lanes
    if not body.lane_changes:
        body.lane = body.target
        return
    road = traffic.roads.roads[lanes[body.target].road]
    best, least = body.target, np.inf
    for lane in range(road.first, road.first + road.count):
        across = abs(lane_point(traffic, lanes[lane], slot, 0).across)
        if across < least - 1e-9:
            best, least = lane, across
    body.lane = best


# --------------------------------------------------------------------------------------------------
# Collisions, as highway-env's `handle_collisions`.


class Contact(NamedTuple):
    """Whether two outlines overlap now and in the next step, and the shift that separates them.

    x, y: metres, of the first outline against the second.
    """

    now: bool
    soon: bool
    x: float
    y: float


@compiled()
def collide(bodies: Bodies, order: np.ndarray, dt: float) -> None:
    """Let vehicles crash that touch each other or an obstacle, pair after pair by slot.

    order: (N,) slots by x, nearly sorted; it is sorted here.
    """
    count = len(bodies)
    _sort_by_x(bodies, order)
    ranks, near = np.empty(count, np.int64), np.empty(count, np.int64)
    longest = 0.0
    for k in range(count):
        ranks[order[k]] = k
        longest = max(longest, bodies[k].diagonal)
    for slot in range(count):
        if bodies[slot].kind != WALKER:
            for k in range(_find_near(bodies, order, ranks[slot], longest, near, dt)):
                if bodies[slot].kind == OBSTACLE:
                    _collide_pair(bodies[near[k]], bodies[slot], dt)
                else:
                    _collide_pair(bodies[slot], bodies[near[k]], dt)


@compiled(borrowing=True, forceinline=True)
def _sort_by_x(bodies: Bodies, order: np.ndarray) -> None:
    """Sort slots by insertion, which is fast if they are nearly sorted."""
    for k in range(1, len(order)):
        slot, m = order[k], k
        while m > 0 and bodies[order[m - 1]].x > bodies[slot].x:
            order[m] = order[m - 1]
            m -= 1
        order[m] = slot


@compiled(borrowing=True, forceinline=True)
def _find_near(
    bodies: Bodies, order: np.ndarray, rank: int, longest: float, near: np.ndarray, dt: float
) -> int:
    """Write the higher slots of bodies that a body may touch, in order; return their number.

    rank: of the body in `order`. longest: greatest diagonal of all bodies, metres.
    """
    slot, count = order[rank], 0
    body = bodies[slot]
    reach = (body.diagonal + longest) / 2 + max(body.speed, 0.0) * dt
    for side in (-1, 1):
        k = rank + side
        while 0 <= k < len(order) and abs(bodies[order[k]].x - body.x) <= reach:
            other = order[k]
            if other > slot and _may_touch(body, bodies[other], dt):
                m = count
                while m > 0 and near[m - 1] > other:
                    near[m] = near[m - 1]
                    m -= 1
                near[m] = other
                count += 1
            k += side
    return count


@compiled(borrowing=True, forceinline=True)
def _may_touch(body: RoadBody, other: RoadBody, dt: float) -> bool:
    """Return whether two bodies can collide and are close to each other."""
    if other.kind == WALKER or (body.kind == OBSTACLE and other.kind == OBSTACLE):
        return False
    x, y = other.x - body.x, other.y - body.y
    return bool(sqrt(dot(x, y, x, y)) <= (body.diagonal + other.diagonal) / 2 + body.speed * dt)


@compiled()
def _collide_pair(body: RoadBody, other: RoadBody, dt: float) -> None:
    """Let two bodies crash if they touch, and move them apart if they will in the next step."""
    contact = _find_contact(body, other, dt)
    if contact.soon:
        share = 1.0 if other.kind == OBSTACLE else 2.0
        body.impact_x, body.impact_y = contact.x / share, contact.y / share
        if other.kind != OBSTACLE:
            other.impact_x, other.impact_y = -contact.x / share, -contact.y / share
    if contact.now:
        body.crashed = other.crashed = True


@compiled()
def first_touching(bodies: Bodies, slot: int) -> int:
    """Return the slot of the first other body that a body touches, -1 for none; people count."""
    body = bodies[slot]
    for other in range(len(bodies)):
        x, y = bodies[other].x - body.x, bodies[other].y - body.y
        reach = (body.diagonal + bodies[other].diagonal) / 2
        is_near = other != slot and x * x + y * y <= reach * reach
        if is_near and _find_contact(body, bodies[other], 0.0).now:
            return other
    return -1


@compiled()
def _find_contact(body: RoadBody, other: RoadBody, dt: float) -> Contact:
    """Return whether two outlines overlap, by the separating axis theorem."""
    outlines = np.empty((2, 4, 2))
    _write_outline(outlines[0], body)
    _write_outline(outlines[1], other)
    # Motion of the first body against the second in the next step, metres.
    x = body.speed * body.cos * dt - other.speed * other.cos * dt
    y = body.speed * body.sin * dt - other.speed * other.sin * dt
    now, soon, least, best_x, best_y = True, True, np.inf, 0.0, 0.0
    for edge in range(8):
        outline, k = outlines[edge // 4], edge % 4
        normal_x = -outline[(k + 1) % 4, 1] + outline[k, 1]
        normal_y = outline[(k + 1) % 4, 0] - outline[k, 0]
        norm = sqrt(dot(normal_x, normal_y, normal_x, normal_y))
        normal_x, normal_y = normal_x / norm, normal_y / norm
        low, high = _projected(outlines[0], normal_x, normal_y)
        other_low, other_high = _projected(outlines[1], normal_x, normal_y)
        if _interval(low, high, other_low, other_high) > 0.0:
            now = False
        shift = dot(normal_x, normal_y, x, y)
        if shift < 0.0:
            low += shift
        else:
            high += shift
        distance = _interval(low, high, other_low, other_high)
        if distance > 0.0:
            soon = False
        if not now and not soon:
            return Contact(False, False, 0.0, 0.0)
        if abs(distance) < least:
            least = abs(distance)
            apart_x = _mean(outlines[0], 0) - _mean(outlines[1], 0)
            apart_y = _mean(outlines[0], 1) - _mean(outlines[1], 1)
            side = 1.0 if dot(apart_x, apart_y, normal_x, normal_y) > 0.0 else -1.0
            best_x, best_y = side * normal_x, side * normal_y
    return Contact(now, soon, least * best_x, least * best_y)


@compiled(borrowing=True, forceinline=True)
def _write_outline(outline: np.ndarray, body: RoadBody) -> None:
    """Write the (4, 2) corners of a body, metres, highway-env's frame."""
    for k, (x, y) in enumerate(((-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0))):
        ahead, aside = x * body.length / 2, y * body.width / 2
        outline[k, 0] = dot(ahead, aside, body.cos, -body.sin) + body.x
        outline[k, 1] = dot(ahead, aside, body.sin, body.cos) + body.y


@compiled(borrowing=True, forceinline=True)
def _projected(outline: np.ndarray, x: float, y: float) -> tuple[float, float]:
    """Return the least and the greatest coordinate of corners along an axis."""
    low, high = np.inf, -np.inf
    for k in range(4):
        along = dot(outline[k, 0], outline[k, 1], x, y)
        low, high = min(low, along), max(high, along)
    return low, high


@compiled(borrowing=True, forceinline=True)
def _interval(low: float, high: float, other_low: float, other_high: float) -> float:
    """Return the distance between two intervals, negative if they overlap."""
    return other_low - high if low < other_low else low - other_high


@compiled(borrowing=True, forceinline=True)
def _mean(outline: np.ndarray, axis: int) -> float:
    """Return the mean x (axis 0) or y (axis 1) of four corners."""
    total = outline[0, axis] + outline[1, axis] + outline[2, axis] + outline[3, axis]
    return float(total / 4)
