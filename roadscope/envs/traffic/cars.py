"""highway-env's own drivers on parallel straight lanes, for kernels.

The formulas are those of its `IDMVehicle`, `ControlledVehicle` and `Vehicle`; gaps are between
centres; all vehicles are 5 m long.
"""

from __future__ import annotations

from math import asin, atan, cos, pi, sin, sqrt, tan
from typing import NamedTuple, Protocol

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.traffic.driving import STEERING_LIMIT_RAD
from roadscope.envs.traffic.lane_geometry import wrapped
from roadscope.envs.traffic.motion import collide
from roadscope.envs.traffic.roads import LaneRecord, record_type

IDM, CONTROLLED, STEERED = 0, 4, 5
"""Who drives: the IDM, an agent that chooses lane and speed, or one that steers. They differ from
`WALKER` and `OBSTACLE`, because `motion.collide` reads records of both modules."""
TAU_LATERAL_S, TAU_HEADING_S, TAU_SPEED_S = 0.6, 0.2, 0.6
"""Time constants of highway-env's controllers."""
REACH_M, SIDE_M = 5.0, 1.0
"""A vehicle is on a lane if its centre is at most this far beyond the ends and the sides."""


class Car(Protocol):
    """A record of a vehicle in highway-env's frame; metres, radians, seconds.

    kind: `IDM`, `CONTROLLED` or `STEERED`. lane, target: numbers of lanes. target_speed: m/s.
    slowest, fastest: limits of the speed, m/s; the slowest may be below 0.
    exponent: of the free road in IDM. timer: time since the driver last considered a lane change.
    The others are as in `road_users.RoadBody`.
    """

    kind: int
    x: float
    y: float
    heading: float
    cos: float
    sin: float
    speed: float
    length: float
    width: float
    diagonal: float
    steering: float
    acceleration: float
    impact_x: float
    impact_y: float
    crashed: bool
    lane: int
    target: int
    lane_changes: bool
    target_speed: float
    slowest: float
    fastest: float
    exponent: float
    timer: float


CAR = record_type(Car)


class IdmModel(NamedTuple):
    """Parameters of IDM and MOBIL, as highway-env names them; metres, seconds."""

    ACC_MAX: float
    COMFORT_ACC_MAX: float
    COMFORT_ACC_MIN: float
    DISTANCE_WANTED: float
    TIME_WANTED: float
    POLITENESS: float
    LANE_CHANGE_MIN_ACC_GAIN: float
    LANE_CHANGE_MAX_BRAKING_IMPOSED: float
    LANE_CHANGE_DELAY: float


class SortedCars(NamedTuple):
    """Vehicles on each lane, sorted by the coordinate of their centre along it.

    counts: (L,). slots, along: (L, N) slots and coordinates in metres, of which the first `counts`
    are valid.
    """

    counts: np.ndarray
    slots: np.ndarray
    along: np.ndarray


@compiled()
def step_cars(
    cars: np.ndarray, lanes: np.ndarray, order: np.ndarray, model: IdmModel, dt: float
) -> None:
    """Let all drivers decide in turn, and move them for `dt` seconds.

    cars: (N,) of `CAR`. lanes: (L,) of `LANE`, straight ones of one road. order: (N,) slots by x at
    the last call; it is sorted here.
    """
    by_lane = _sort_by_lane(cars, lanes, order)
    for slot in range(len(cars)):
        car = cars[slot]
        if car.kind == CONTROLLED:
            car.steering = _steering(car, lanes[car.target])
            car.acceleration = (car.target_speed - car.speed) / TAU_SPEED_S
        elif car.kind == IDM and not car.crashed:
            if car.lane_changes:
                _change_lane(cars, lanes, by_lane, slot, model)
            car.steering = _steering(car, lanes[car.target])
            ahead = _neighbours(cars, lanes, by_lane, slot, car.lane)[0]
            acceleration = _acceleration(cars, lanes, slot, slot, ahead, model)
            if car.lane != car.target:
                ahead = _neighbours(cars, lanes, by_lane, slot, car.target)[0]
                wanted = _acceleration(cars, lanes, slot, slot, ahead, model)
                acceleration = min(acceleration, wanted)
            car.acceleration = min(max(acceleration, -model.ACC_MAX), model.ACC_MAX)
    for slot in range(len(cars)):
        _move(cars[slot], lanes, dt)
    collide(cars, order, dt)


@compiled(borrowing=True, forceinline=True)
def _along(car: Car, lane: LaneRecord) -> float:
    return (car.x - lane.x) * lane.along_x + (car.y - lane.y) * lane.along_y


@compiled(borrowing=True, forceinline=True)
def _across(car: Car, lane: LaneRecord) -> float:
    return (car.x - lane.x) * lane.across_x + (car.y - lane.y) * lane.across_y


@compiled()
def _sort_by_lane(cars: np.ndarray, lanes: np.ndarray, order: np.ndarray) -> SortedCars:
    """Return the vehicles on each lane."""
    shape = (len(lanes), len(cars))
    by_lane = SortedCars(np.zeros(len(lanes), np.int64), np.empty(shape, np.int64), np.empty(shape))
    for number in range(len(lanes)):
        lane, count = lanes[number], 0
        slots, along = by_lane.slots[number], by_lane.along[number]
        for slot in order:
            here = _along(cars[slot], lane)
            beside = abs(_across(cars[slot], lane)) <= lane.width / 2 + SIDE_M
            if beside and -REACH_M <= here < lane.length + REACH_M:
                k = count
                while k > 0 and along[k - 1] > here:
                    slots[k], along[k] = slots[k - 1], along[k - 1]
                    k -= 1
                slots[k], along[k] = slot, here
                count += 1
        by_lane.counts[number] = count
    return by_lane


@compiled(borrowing=True)
def _neighbours(
    cars: np.ndarray, lanes: np.ndarray, by_lane: SortedCars, slot: int, lane: int
) -> tuple[int, int]:
    """Return the slots of the vehicles ahead and behind on a lane, -1 for none."""
    here = _along(cars[slot], lanes[lane])
    slots, along, count = by_lane.slots[lane], by_lane.along[lane], by_lane.counts[lane]
    first, last = 0, count
    while first < last:
        middle = (first + last) // 2
        if along[middle] < here:
            first = middle + 1
        else:
            last = middle
    behind = slots[first - 1] if first > 0 else -1
    if first < count and slots[first] == slot:
        first += 1
    ahead = slots[first] if first < count else -1
    return int(ahead), int(behind)


@compiled(borrowing=True, forceinline=True)
def _not_zero(value: float) -> float:
    if abs(value) > 1e-2:
        return value
    return 1e-2 if value >= 0 else -1e-2


@compiled(borrowing=True)
def _steering(car: Car, lane: LaneRecord) -> float:
    """Return the wheel angle that leads to the centre line of a lane, radians."""
    aside = -_across(car, lane) / TAU_LATERAL_S
    turn = asin(min(max(aside / _not_zero(car.speed), -1.0), 1.0))
    heading = lane.heading + min(max(turn, -pi / 4), pi / 4)
    rate = wrapped(heading - car.heading) / TAU_HEADING_S
    sine = car.length / 2 / _not_zero(car.speed) * rate
    wheel = atan(2 * tan(asin(min(max(sine, -1.0), 1.0))))
    return min(max(wheel, -STEERING_LIMIT_RAD), STEERING_LIMIT_RAD)


@compiled(borrowing=True)
def _desired_gap(car: Car, front: Car, model: IdmModel) -> float:
    """Return the distance to the vehicle in front that IDM wants, between centres, metres."""
    x = car.speed * car.cos - front.speed * front.cos
    y = car.speed * car.sin - front.speed * front.sin
    closing = x * car.cos + y * car.sin
    braking = 2 * sqrt(-model.COMFORT_ACC_MAX * model.COMFORT_ACC_MIN)
    wanted = model.DISTANCE_WANTED + car.speed * model.TIME_WANTED
    return float(wanted + car.speed * closing / braking)


@compiled(borrowing=True)
def _acceleration(
    cars: np.ndarray, lanes: np.ndarray, driver: int, rear: int, front: int, model: IdmModel
) -> float:
    """Return the acceleration of a vehicle behind another one as a driver predicts it, m/s^2.

    driver: its slot; it assumes its own exponent for others. rear, front: slots, -1 for none.
    """
    if rear < 0:
        return 0.0
    car, exponent = cars[rear], cars[driver].exponent
    lane = lanes[car.lane]
    desired = min(max(car.target_speed, 0.0), sqrt(lane.speed_squared))
    ratio = max(car.speed, 0.0) / abs(_not_zero(desired))
    acceleration = model.COMFORT_ACC_MAX * (1.0 - ratio**exponent)
    if front >= 0:
        distance = _along(cars[front], lane) - _along(car, lane)
        gap_ratio = _desired_gap(car, cars[front], model) / _not_zero(distance)
        acceleration -= model.COMFORT_ACC_MAX * gap_ratio * gap_ratio
    return float(acceleration)


@compiled(borrowing=True)
def _change_lane(
    cars: np.ndarray, lanes: np.ndarray, by_lane: SortedCars, slot: int, model: IdmModel
) -> None:
    """Begin a lane change, or abort one."""
    car = cars[slot]
    if car.lane != car.target:
        for other in range(len(cars)):
            rival = cars[other]
            changes = rival.kind != STEERED and rival.lane != car.target == rival.target
            if other != slot and changes:
                lane = lanes[car.lane]
                distance = _along(rival, lane) - _along(car, lane)
                if 0.0 < distance < _desired_gap(car, rival, model):
                    car.target = car.lane
                    return
        return
    if not car.timer > model.LANE_CHANGE_DELAY:
        return
    car.timer = 0.0
    for side in (-1, 1):
        option = car.lane + side
        if 0 <= option < len(lanes) and abs(car.speed) >= 1.0:
            lane = lanes[option]
            near = abs(_across(car, lane)) <= 2 * lane.width
            near = near and 0.0 <= _along(car, lane) < lane.length + REACH_M
            if (
                near
                and not lane.forbidden
                and _should_change(cars, lanes, by_lane, slot, option, model)
            ):
                car.target = option


@compiled(borrowing=True)
def _should_change(
    cars: np.ndarray,
    lanes: np.ndarray,
    by_lane: SortedCars,
    slot: int,
    option: int,
    model: IdmModel,
) -> bool:
    """Return whether MOBIL recommends a change to a lane."""
    ahead, behind = _neighbours(cars, lanes, by_lane, slot, option)
    new_follower = _acceleration(cars, lanes, slot, behind, ahead, model)
    new_follower_then = _acceleration(cars, lanes, slot, behind, slot, model)
    if new_follower_then < -model.LANE_CHANGE_MAX_BRAKING_IMPOSED:
        return False
    old_ahead, old_behind = _neighbours(cars, lanes, by_lane, slot, cars[slot].lane)
    own_then = _acceleration(cars, lanes, slot, slot, ahead, model)
    own = _acceleration(cars, lanes, slot, slot, old_ahead, model)
    old_follower = _acceleration(cars, lanes, slot, old_behind, slot, model)
    old_follower_then = _acceleration(cars, lanes, slot, old_behind, old_ahead, model)
    others = new_follower_then - new_follower + old_follower_then - old_follower
    return bool(own_then - own + model.POLITENESS * others >= model.LANE_CHANGE_MIN_ACC_GAIN)


@compiled(borrowing=True)
def _move(car: Car, lanes: np.ndarray, dt: float) -> None:
    """Move a vehicle by the kinematic bicycle model of its centre; set its lane to the nearest."""
    car.timer += dt
    if car.crashed:
        car.steering, car.acceleration = 0.0, -car.speed
    if car.speed > car.fastest:
        car.acceleration = min(car.acceleration, car.fastest - car.speed)
    elif car.speed < car.slowest:
        car.acceleration = max(car.acceleration, car.slowest - car.speed)
    slip = atan(tan(car.steering) / 2)
    course = car.heading + slip
    car.x += car.speed * cos(course) * dt
    car.y += car.speed * sin(course) * dt
    if not np.isnan(car.impact_x):
        car.x += car.impact_x
        car.y += car.impact_y
        car.crashed = True
        car.impact_x, car.impact_y = np.nan, np.nan
    car.heading += car.speed * sin(slip) / (car.length / 2) * dt
    car.speed += car.acceleration * dt
    car.cos, car.sin = cos(car.heading), sin(car.heading)
    least = np.inf
    for number in range(len(lanes)):
        lane = lanes[number]
        along = _along(car, lane)
        beyond = max(along - lane.length, 0.0) + max(-along, 0.0)
        turned = abs(wrapped(car.heading - lane.heading))
        distance = abs(_across(car, lane)) + beyond + turned
        if distance < least:
            car.lane, least = number, distance
