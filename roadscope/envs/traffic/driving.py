"""Drivers: IDM and MOBIL with true vehicle sizes, and steering within a real vehicle's limits."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.traffic.lane_geometry import (
    LOOK_AHEAD_M,
    Traffic,
    along_lane,
    follow_road,
    heading_at,
    leg_after,
    local_coordinates,
    next_lane,
    wrapped,
)
from roadscope.envs.traffic.neighbours import (
    Occupants,
    find_leader,
    find_neighbours,
    find_occupants,
    note_change,
)
from roadscope.envs.traffic.road_users import DRIVER, OBSTACLE, WALKER, RoadBody
from roadscope.envs.traffic.roads import record_type

LATERAL_LIMIT_M_S2 = 2.7
"""Largest lateral acceleration that the steering controller asks for; chosen by hand."""
LATERAL_JERK_M_S3 = 5.0
"""Largest lateral jerk of a vehicle; chosen by hand."""
STEERING_RATE_RAD_S = 0.7
"""Largest turning rate of the wheels, radians per second; chosen by hand."""
STEERING_LIMIT_RAD = pi / 3
"""Largest angle of the wheels: that of highway-env."""
CURVE_BRAKING_M_S2 = 1.2
"""Deceleration with which drivers slow down for a curve; chosen by hand."""
CALM_BRAKING_M_S2 = 3.0
"""Drivers brake harder than this only to avoid a collision; chosen by hand."""
RAMP_GAP_S, RAMP_BRAKING_M_S2 = 0.3, 2.0
"""Time gap and braking that drivers at the end of a ramp accept; chosen by hand."""
HARDEST_BRAKING_M_S2 = 8.0
"""Largest deceleration of a vehicle."""
COMFORT_M_S2, COMFORT_HEAVY_M_S2, COMFORT_BRAKING_M_S2 = 1.8, 0.9, 2.5
"""Parameters of IDM: the acceleration of drivers, that of drivers of heavy vehicles, and the
comfortable deceleration."""
POLITENESS, LEAST_GAIN_M_S2, MOST_IMPOSED_BRAKING_M_S2 = 0.1, 0.15, 2.0
"""Parameters of MOBIL: the weight of others' gains, the least gain for which a lane is changed, and
the hardest braking that the new follower may be forced to."""
LANE_CHANGE_DELAY_S = 1.0
"""Drivers consider a lane change again after this time."""


class Exponents(NamedTuple):
    """Exponents of IDM: `free` in the free-road term, `square` wherever IDM squares.

    They are arguments of kernels because LLVM replaces `x**2.0` with `x * x`, which differs from
    the C library's power in the last bit.
    """

    free: float = 4.0
    square: float = 2.0


class Plan(Protocol):
    """A record of what a driver steers and brakes for; metres, radians.

    across: offset from the centre line of the target lane.
    heading_here, heading_ahead: of that lane beside the driver and `look_ahead` farther on.
    Headings lack the arctangent of their slope, see `lane_geometry.Heading`.
    has_curve: whether there is a lane that far ahead.
    leader, gap, leader_heading: slot of the leader on the own lane, -1 for none; bumper-to-bumper
    gap, inf without one; heading of the lane at the leader.
    target_leader, target_gap, target_leader_heading: the same on the target lane. `target_leader`
    is -1 unless the driver changes lanes; the other two then mean nothing.
    """

    across: float
    heading_here: float
    heading_ahead: float
    look_ahead: float
    has_curve: bool
    leader: int
    gap: float
    leader_heading: float
    target_leader: int
    target_gap: float
    target_leader_heading: float


PLAN = record_type(Plan)


# --------------------------------------------------------------------------------------------------
# Decisions, one driver after the other.


@compiled()
def decide(traffic: Traffic, plans: np.ndarray, slopes: np.ndarray, exponents: Exponents) -> None:
    """Let every driver choose a lane; each knows the choices of those before it.

    Writes plans, (N,) of `PLAN`, and slopes, (N, 4): those of a plan's four headings, in the order
    of its fields.
    """
    occupants = find_occupants(traffic)
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.kind == DRIVER and not body.crashed:
            follow_road(traffic, slot)
            if body.lane_changes and not body.commanded:
                _change_lane(traffic, occupants, slot, exponents)
            _plan(traffic, occupants, slot, plans[slot], slopes[slot])
        note_change(occupants, traffic, slot)


@compiled(borrowing=True, forceinline=True)
def _plan(
    traffic: Traffic, occupants: Occupants, slot: int, plan: Plan, slopes: np.ndarray
) -> None:
    """Write down what a driver steers and brakes for."""
    body, roads = traffic.bodies[slot], traffic.roads
    lane = roads.lanes[body.target]
    place = local_coordinates(traffic, lane, slot)
    plan.across, plan.look_ahead = place.across, max(1.5, 0.5 * body.speed)
    heading = heading_at(lane, place.along)
    plan.heading_here, slopes[0] = heading.base, heading.slope
    plan.has_curve, along = True, place.along + plan.look_ahead
    if along <= lane.length:
        heading = heading_at(lane, along)
    else:
        following = next_lane(roads, traffic.legs, body.first_leg, body.last_leg, body.target)
        plan.has_curve = following >= 0
        if following >= 0:
            heading = heading_at(roads.lanes[following], along - lane.length)
    plan.heading_ahead, slopes[1] = heading.base, heading.slope
    leader = find_leader(traffic, occupants, slot, body.lane)
    plan.leader, plan.gap = leader.slot, leader.gap
    plan.leader_heading, slopes[2] = leader.heading.base, leader.heading.slope
    plan.target_leader = -1
    if body.target != body.lane:
        leader = find_leader(traffic, occupants, slot, body.target)
        plan.target_leader, plan.target_gap = leader.slot, leader.gap
        plan.target_leader_heading, slopes[3] = leader.heading.base, leader.heading.slope


@compiled(borrowing=True)
def _change_lane(traffic: Traffic, occupants: Occupants, slot: int, exponents: Exponents) -> None:
    """Begin a lane change, or abort one, as highway-env's `change_lane_policy`."""
    body, lanes = traffic.bodies[slot], traffic.roads.lanes
    if body.lane != body.target:
        if lanes[body.lane].road == lanes[body.target].road and _is_taken(traffic, slot):
            body.target = body.lane
        return
    if not body.timer > LANE_CHANGE_DELAY_S:
        return
    body.timer = 0.0
    road = traffic.roads.roads[lanes[body.lane].road]
    for side in (-1, 1):
        option = body.lane + side
        if road.first <= option < road.first + road.count and abs(body.speed) >= 1.0:
            lane = lanes[option]
            place = local_coordinates(traffic, lane, slot)
            near = abs(place.across) <= 2 * lane.width and 0.0 <= place.along < lane.length + 5.0
            if (
                near
                and not lane.forbidden
                and _should_change(traffic, occupants, slot, option, exponents)
            ):
                body.target = option


@compiled(borrowing=True)
def _is_taken(traffic: Traffic, slot: int) -> bool:
    """Return whether another driver changes to the same lane close ahead."""
    body = traffic.bodies[slot]
    for other in range(len(traffic.bodies)):
        leader = traffic.bodies[other]
        if (
            other != slot
            and leader.kind == DRIVER
            and leader.target == body.target
            and leader.lane != body.target
        ):
            distance = _lane_distance(traffic, slot, other)
            wanted = _clearance(body, body.speed, body.speed - leader.speed)
            if 0.0 < distance < wanted + _half_lengths(body, leader):
                return True
    return False


@compiled(borrowing=True)
def _should_change(
    traffic: Traffic, occupants: Occupants, slot: int, option: int, exponents: Exponents
) -> bool:
    """Return whether to change to a lane: if it is safe, by MOBIL or because the own lane ends."""
    lane = traffic.bodies[slot].lane
    new = find_neighbours(traffic, occupants, slot, option)
    if traffic.roads.lanes[lane].forbidden:
        return _gap_is_safe(traffic, slot, new.ahead, exponents) and _gap_is_safe(
            traffic, new.behind, slot, exponents
        )
    new_follower = _acceleration(traffic, slot, new.behind, new.ahead, exponents)
    new_follower_then = _acceleration(traffic, slot, new.behind, slot, exponents)
    if new_follower_then < -MOST_IMPOSED_BRAKING_M_S2:
        return False
    old = find_neighbours(traffic, occupants, slot, lane)
    own_then = _acceleration(traffic, slot, slot, new.ahead, exponents)
    own = _acceleration(traffic, slot, slot, old.ahead, exponents)
    old_follower = _acceleration(traffic, slot, old.behind, slot, exponents)
    old_follower_then = _acceleration(traffic, slot, old.behind, old.ahead, exponents)
    others = new_follower_then - new_follower + old_follower_then - old_follower
    return bool(own_then - own + POLITENESS * others >= LEAST_GAIN_M_S2)


@compiled(borrowing=True)
def _gap_is_safe(traffic: Traffic, rear: int, front: int, exponents: Exponents) -> bool:
    """Return whether drivers at the end of a ramp accept the gap between two vehicles."""
    if rear < 0 or front < 0:
        return True
    behind, ahead = traffic.bodies[rear], traffic.bodies[front]
    gap = _lane_distance(traffic, rear, front) - _half_lengths(behind, ahead)
    closing = max(behind.speed - ahead.speed, 0.0)
    stopping = closing**exponents.square / (2 * RAMP_BRAKING_M_S2)
    return bool(gap > max(2.0, RAMP_GAP_S * behind.speed) + stopping)


@compiled(borrowing=True)
def _acceleration(
    traffic: Traffic, driver: int, rear: int, front: int, exponents: Exponents
) -> float:
    """Return the acceleration of a vehicle behind another one as a driver predicts it, m/s^2.

    driver: its slot; it assumes its own parameters for others. rear, front: slots, -1 for none.
    """
    if rear < 0:
        return 0.0
    model, body = traffic.bodies[driver], traffic.bodies[rear]
    if body.kind == WALKER or body.kind == OBSTACLE:
        return 0.0
    terms = _speed_terms(model, body.speed, body.target_speed, exponents)
    if front < 0:
        return terms.free
    leader = traffic.bodies[front]
    gap = _lane_distance(traffic, rear, front) - _half_lengths(body, leader)
    return _following_acceleration(model, terms, gap, leader.speed, exponents)


@compiled(borrowing=True, forceinline=True)
def _lane_distance(traffic: Traffic, rear: int, front: int) -> float:
    """Return the distance between two bodies along the lane of the first, metres."""
    lane = traffic.roads.lanes[traffic.bodies[rear].lane]
    ahead = local_coordinates(traffic, lane, front).along
    return ahead - local_coordinates(traffic, lane, rear).along


@compiled(borrowing=True, forceinline=True)
def _half_lengths(body: RoadBody, other: RoadBody) -> float:
    """Return the distance between the centres of two bodies whose bumpers touch, metres."""
    return (body.length + other.length) / 2


# --------------------------------------------------------------------------------------------------
# IDM.


@compiled(borrowing=True, forceinline=True)
def _free_acceleration(
    model: RoadBody, speed: float, desired_speed: float, exponents: Exponents
) -> float:
    """Return the acceleration on a free road, m/s^2 (improved IDM of Treiber and Kesting)."""
    up, down = model.comfort, COMFORT_BRAKING_M_S2
    desired_speed = max(desired_speed, 0.1)
    if speed <= desired_speed:
        return float(up * (1.0 - (speed / desired_speed) ** exponents.free))
    return float(-down * (1.0 - (desired_speed / speed) ** (up * exponents.free / down)))


@compiled(borrowing=True, forceinline=True)
def _clearance(model: RoadBody, speed: float, closing: float) -> float:
    """Return IDM's desired gap in metres, bumper to bumper."""
    braking = 2 * sqrt(-model.comfort * -COMFORT_BRAKING_M_S2)
    return model.standstill_gap + max(0.0, speed * model.time_gap + speed * closing / braking)


class _SpeedTerms(NamedTuple):
    """A vehicle's speed in m/s, its square, and its acceleration on a free road, m/s^2."""

    speed: float
    squared: float
    free: float


@compiled(borrowing=True, forceinline=True)
def _speed_terms(
    model: RoadBody, speed: float, desired_speed: float, exponents: Exponents
) -> _SpeedTerms:
    free = _free_acceleration(model, speed, desired_speed, exponents)
    return _SpeedTerms(speed, speed**exponents.square, free)


@compiled(borrowing=True, forceinline=True)
def _following_acceleration(
    model: RoadBody, terms: _SpeedTerms, gap: float, front_speed: float, exponents: Exponents
) -> float:
    """Return the acceleration behind a leader at a bumper-to-bumper gap, m/s^2."""
    square = exponents.square
    ratio = _clearance(model, terms.speed, terms.speed - front_speed) / max(gap, 0.1)
    acceleration = terms.free - model.comfort * ratio**square
    # If another vehicle cuts in and the gap is too short, plain IDM brakes far too hard.
    needed = max(terms.squared - front_speed**square, 0.0) / (2 * max(gap - 0.5, 0.3))
    hardest = max(CALM_BRAKING_M_S2, 1.5 * needed)
    return float(max(max(acceleration, -hardest), -HARDEST_BRAKING_M_S2))


# --------------------------------------------------------------------------------------------------
# Steering and acceleration, every driver for itself.


@compiled()
def control(
    traffic: Traffic,
    plans: np.ndarray,
    slope_angles: np.ndarray,
    exponents: Exponents,
    dt: float,
    sines: np.ndarray,
) -> None:
    """Choose the accelerations of all drivers and how far their wheels may turn in `dt` seconds.

    slope_angles: (N, 4) arctangents of the slopes, radians. Writes sines, (N,), of the slip angles
    to steer for.
    """
    for slot in range(len(traffic.bodies)):
        body = traffic.bodies[slot]
        if body.kind == DRIVER:
            desired = min(body.target_speed, _curve_speed(traffic, slot))
            terms = _speed_terms(body, body.speed, desired, exponents)
            rate = LATERAL_JERK_M_S3 * body.length / _squared(terms, 1.0, exponents)
            body.turn_limit = min(STEERING_RATE_RAD_S, rate) * dt
            if not body.crashed:
                sines[slot] = _sine_of_slip(body, terms, plans[slot], slope_angles[slot], exponents)
                if not body.commanded:
                    body.acceleration = _allowed_acceleration(
                        traffic, body, terms, plans[slot], slope_angles[slot], exponents
                    )


@compiled(borrowing=True, forceinline=True)
def _squared(terms: _SpeedTerms, least: float, exponents: Exponents) -> float:
    """Return the square of the speed or, if that is greater, of `least` m/s."""
    return terms.squared if terms.speed >= least else least**exponents.square


@compiled(borrowing=True, forceinline=True)
def _sine_of_slip(
    body: RoadBody, terms: _SpeedTerms, plan: Plan, slope_angles: np.ndarray, exponents: Exponents
) -> float:
    """Return the sine of the slip angle that leads to the centre line of the target lane.

    It follows the curvature of the lane ahead and corrects the errors of offset and course. The
    product of curvature and squared speed stays within `LATERAL_LIMIT_M_S2`.
    """
    heading = plan.heading_here + slope_angles[0]
    course_error = wrapped(body.heading + body.slip - heading)
    offset, speed = _clamped(plan.across, -2.5, 2.5), max(terms.speed, 3.0)
    feedback = 0.6 * offset + 1.6 * speed * sin(course_error)
    curvature = 0.0
    if plan.has_curve:
        curvature = wrapped(plan.heading_ahead + slope_angles[1] - heading) / plan.look_ahead
    curvature -= feedback / _squared(terms, 3.0, exponents)
    limit = LATERAL_LIMIT_M_S2 / _squared(terms, 0.5, exponents)
    return _clamped(_clamped(curvature, -limit, limit) * body.length / 2, -0.9, 0.9)


@compiled(borrowing=True, forceinline=True)
def _clamped(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@compiled(borrowing=True, forceinline=True)
def _allowed_acceleration(
    traffic: Traffic,
    body: RoadBody,
    terms: _SpeedTerms,
    plan: Plan,
    slope_angles: np.ndarray,
    exponents: Exponents,
) -> float:
    """Return the acceleration that leaders, curves and junctions allow, m/s^2."""
    allowed = terms.free
    if plan.leader >= 0:
        leader = traffic.bodies[plan.leader]
        speed = _speed_along(leader, plan.leader_heading + slope_angles[2])
        allowed = min(allowed, _following_acceleration(body, terms, plan.gap, speed, exponents))
    if plan.target_leader >= 0:
        leader = traffic.bodies[plan.target_leader]
        speed = _speed_along(leader, plan.target_leader_heading + slope_angles[3])
        following = _following_acceleration(body, terms, plan.target_gap, speed, exponents)
        allowed = min(allowed, following)
    if not np.isnan(body.hold):
        gap = body.hold + body.standstill_gap - 0.5
        allowed = min(allowed, _following_acceleration(body, terms, gap, 0.0, exponents))
    return max(allowed, -HARDEST_BRAKING_M_S2)


@compiled(borrowing=True, forceinline=True)
def _speed_along(body: RoadBody, heading: float) -> float:
    """Return the speed of a body in a direction, at least 0, m/s."""
    along = body.speed * body.cos * cos(heading) + body.speed * body.sin * sin(heading)
    return max(along, 0.0)


@compiled(borrowing=True)
def speed_allowed(traffic: Traffic, slot: int) -> float:
    """Return the speed that a driver's desired speed, the curves and speed limits allow, m/s."""
    return float(min(traffic.bodies[slot].target_speed, _curve_speed(traffic, slot)))


@compiled(borrowing=True, forceinline=True)
def _curve_speed(traffic: Traffic, slot: int) -> float:
    """Return the speed, m/s, from which a driver can just slow down for curves and speed limits."""
    body, roads = traffic.bodies[slot], traffic.roads
    allowed, lane, leg = np.inf, body.target, body.first_leg
    start = -along_lane(traffic, lane, slot)
    while lane >= 0 and start < LOOK_AHEAD_M:
        distance = max(start - body.length / 2, 0.0)
        squared = roads.lanes[lane].speed_squared + 2 * CURVE_BRAKING_M_S2 * distance
        allowed = min(allowed, sqrt(squared))
        start += roads.lanes[lane].length
        leg = leg_after(roads, traffic.legs, leg, body.last_leg, lane)
        lane = next_lane(roads, traffic.legs, leg, body.last_leg, lane)
    return allowed
