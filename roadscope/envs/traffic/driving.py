"""Drivers with true sizes whose motion a real vehicle could follow."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.utils import wrap_to_pi
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from roadscope.core import Category
from roadscope.envs.traffic.lanes import sharpest
from roadscope.envs.traffic.mix import Body

LATERAL_LIMIT_M_S2 = 2.7
"""Lateral acceleration that steering asks for at most."""
CURVE_LATERAL_M_S2 = 1.9
"""Lateral acceleration at which drivers take curves."""
LATERAL_JERK_M_S3 = 5.0
STEERING_RATE_RAD_S = 0.7
CURVE_BRAKING_M_S2 = 1.2
CALM_BRAKING_M_S2 = 3.0
"""Drivers brake harder than this only if they would otherwise hit somebody."""
RAMP_GAP_S, RAMP_BRAKING_M_S2 = 0.3, 2.0
LOOK_AHEAD_M = 120.0

HEAVY = (Category.TRUCK, Category.BUS)


def between(value: float, low: float, high: float) -> float:
    """Limit one number; `np.clip` takes ten times as long for it."""
    return float(min(max(value, low), high))


class Driver(IDMVehicle):  # type: ignore[misc]
    """An IDM and MOBIL vehicle of highway-env with a body of its own.

    Gaps are bumper to bumper, braking ends at standstill, curves are taken slowly enough, and
    steering obeys limits of rate, lateral jerk and lateral acceleration, so that the recorded
    motion could be that of a vehicle. All constants are our own: building one of highway-env's
    intersections overwrites those of `IDMVehicle`.
    """

    ACC_MAX = 8.0
    COMFORT_ACC_MAX = 1.8
    COMFORT_ACC_MIN = -2.5
    DISTANCE_WANTED = 2.5
    TIME_WANTED = 1.2
    DELTA = 4.0
    POLITENESS = 0.1
    LANE_CHANGE_MIN_ACC_GAIN = 0.15
    LANE_CHANGE_MAX_BRAKING_IMPOSED = 2.0
    LANE_CHANGE_DELAY = 1.0
    MIN_SPEED = 0.0

    def __init__(
        self,
        road: Any,
        lane_index: Any,
        along_m: float,
        *,
        body: Body,
        speed: float,
        wish: float,
        lane_changes: bool = False,
        route: Any = None,
    ) -> None:
        """Stand on a lane; `wish` is the speed in m/s wanted on a free road."""
        lane = road.network.get_lane(lane_index)
        super().__init__(
            road,
            lane.position(along_m, 0.0),
            lane.heading_at(along_m),
            speed,
            target_lane_index=lane_index,
            target_speed=wish,
            route=route,
            enable_lane_change=lane_changes,
        )
        self.carry(body)
        self.lane_index, self.lane = lane_index, lane
        self.hold_m: float | None = None
        self.slot = -1

    def carry(self, body: Body) -> None:
        """Take a body; heavy ones accelerate less."""
        self.body = body
        self.LENGTH, self.WIDTH, _ = body.size
        self.diagonal = float(np.hypot(self.LENGTH, self.WIDTH))
        self.COMFORT_ACC_MAX = 0.9 if body.category in HEAVY else type(self).COMFORT_ACC_MAX

    def vary(self, rng: np.random.Generator) -> Driver:
        """Draw a temperament: time gap, standstill gap and eagerness."""
        self.TIME_WANTED = float(rng.uniform(0.9, 1.5))
        self.DISTANCE_WANTED = float(rng.uniform(2.0, 3.0))
        self.COMFORT_ACC_MAX *= float(rng.uniform(0.85, 1.15))
        self.timer = float(rng.uniform(0.0, self.LANE_CHANGE_DELAY))
        return self

    def act(self, action: Any = None) -> None:
        """Choose lane, steering and acceleration."""
        if self.crashed:
            return
        self.follow_road()
        if self.enable_lane_change:
            self.change_lane_policy()
        steering = self.steering_control(self.target_lane_index)
        Vehicle.act(self, {"steering": steering, "acceleration": self._pace()})

    def step(self, dt: float) -> None:
        """Move, turning the wheel no faster than allowed, never backwards."""
        rate = min(STEERING_RATE_RAD_S, LATERAL_JERK_M_S3 * self.LENGTH / max(self.speed, 1.0) ** 2)
        last = getattr(self, "wheel", 0.0)
        self.wheel = last + between(self.action["steering"] - last, -rate * dt, rate * dt)
        self.action["steering"] = self.wheel
        if not self.crashed:
            self.action["acceleration"] = max(self.action["acceleration"], -self.speed / dt)
        super().step(dt)

    def on_state_update(self) -> None:
        """Leave the lane as it is: the road finds all lanes at once."""

    def acceleration(
        self, ego_vehicle: Any, front_vehicle: Any = None, rear_vehicle: Any = None
    ) -> float:
        """Return the acceleration of a vehicle behind another, m/s^2, as MOBIL asks for it."""
        if ego_vehicle is None or not isinstance(ego_vehicle, Vehicle):
            return 0.0
        wish = float(getattr(ego_vehicle, "target_speed", ego_vehicle.speed))
        if front_vehicle is None:
            return self.free(ego_vehicle.speed, wish)
        gap = ego_vehicle.lane_distance_to(front_vehicle) - _reach(ego_vehicle, front_vehicle)
        return self.follow(ego_vehicle.speed, wish, gap, front_vehicle.speed)

    def mobil(self, lane_index: Any) -> bool:
        """Whether to change to a lane: if safe and worth it, or if safe and the own lane ends."""
        if not self.lane.forbidden:
            return bool(super().mobil(lane_index))
        ahead, behind = self.road.neighbour_vehicles(self, lane_index)
        return self._fits(self, ahead) and self._fits(behind, self)

    def _fits(self, rear: Any, front: Any) -> bool:
        """Whether the gap between two vehicles is one that drivers at the end of a ramp take."""
        if rear is None or front is None:
            return True
        gap = rear.lane_distance_to(front) - _reach(rear, front)
        closing = max(rear.speed - front.speed, 0.0)
        return bool(gap > max(2.0, RAMP_GAP_S * rear.speed) + closing**2 / (2 * RAMP_BRAKING_M_S2))

    def desired_gap(
        self, ego_vehicle: Any, front_vehicle: Any = None, projected: bool = True
    ) -> float:
        """Return the wanted distance from centre to centre in metres, true lengths included."""
        closing = ego_vehicle.speed - front_vehicle.speed
        return self._clearance(ego_vehicle.speed, closing) + _reach(ego_vehicle, front_vehicle)

    def free(self, speed: float, wish: float) -> float:
        """Return the acceleration on a free road, m/s^2 (improved IDM of Treiber and Kesting)."""
        up, down = self.COMFORT_ACC_MAX, -self.COMFORT_ACC_MIN
        wish = max(wish, 0.1)
        if speed <= wish:
            return float(up * (1.0 - (speed / wish) ** self.DELTA))
        return float(-down * (1.0 - (wish / speed) ** (up * self.DELTA / down)))

    def follow(self, speed: float, wish: float, gap_m: float, front_speed: float) -> float:
        """Return the acceleration behind a leader at a bumper-to-bumper gap, m/s^2."""
        ratio = self._clearance(speed, speed - front_speed) / max(gap_m, 0.1)
        wanted = self.free(speed, wish) - self.COMFORT_ACC_MAX * ratio**2
        # Where a gap opens up too short, as when somebody cuts in, IDM brakes as if about to hit.
        needed = max(speed**2 - front_speed**2, 0.0) / (2 * max(gap_m - 0.5, 0.3))
        return float(max(wanted, -max(CALM_BRAKING_M_S2, 1.5 * needed), -self.ACC_MAX))

    def steering_control(self, target_lane_index: Any) -> float:
        """Return a wheel angle that leads to a lane's centre line.

        Curvature of the lane ahead plus feedback of offset and course error; the product of
        curvature and squared speed stays within `LATERAL_LIMIT_M_S2`.
        """
        lane = self.road.network.get_lane(target_lane_index)
        along, across = lane.local_coordinates(self.position)
        slip = np.arctan(np.tan(self.action["steering"]) / 2)
        course = wrap_to_pi(self.heading + slip - lane.heading_at(along))
        speed = max(self.speed, 3.0)
        pull = 0.6 * between(across, -2.5, 2.5) + 1.6 * speed * np.sin(course)
        bend = self._bend(lane, along) - pull / speed**2
        most = LATERAL_LIMIT_M_S2 / max(self.speed, 0.5) ** 2
        turn = between(between(bend, -most, most) * self.LENGTH / 2, -0.9, 0.9)
        wheel = np.arctan(2 * np.tan(np.arcsin(turn)))
        return between(wheel, -self.MAX_STEERING_ANGLE, self.MAX_STEERING_ANGLE)

    def _bend(self, lane: Any, along: float) -> float:
        """Mean curvature of the way ahead, 1/m."""
        ahead = max(1.5, 0.5 * self.speed)
        here = lane.heading_at(along)
        if along + ahead <= lane.length:
            there = lane.heading_at(along + ahead)
        else:
            following = self.road.after(self.target_lane_index, self.route)
            if following is None:
                return 0.0
            after = self.road.network.get_lane(following)
            there = after.heading_at(along + ahead - lane.length)
        return float(wrap_to_pi(there - here) / ahead)

    def _pace(self) -> float:
        """Return the acceleration that leaders, curves and junctions allow, m/s^2."""
        wish = min(self.target_speed, self._curve_speed())
        acceleration = self.free(self.speed, wish)
        lanes = [self.lane_index]
        if self.target_lane_index != self.lane_index:
            lanes.append(self.target_lane_index)
        for lane_index in lanes:
            found = self.road.leader(self, lane_index)
            if found is not None:
                acceleration = min(acceleration, self.follow(self.speed, wish, *found))
        if self.hold_m is not None:
            gap = self.hold_m + self.DISTANCE_WANTED - 0.5
            acceleration = min(acceleration, self.follow(self.speed, wish, gap, 0.0))
        return max(acceleration, -self.ACC_MAX)

    def _curve_speed(self) -> float:
        """Return the speed from which coming curves can still be taken, m/s."""
        allowed = np.inf
        for lane_index, start_m in self.road.way(self, self.target_lane_index):
            lane = self.road.network.get_lane(lane_index)
            curvature = sharpest(lane)
            limit = lane.speed_limit or np.inf
            if curvature > 0:
                limit = min(limit, np.sqrt(CURVE_LATERAL_M_S2 / curvature))
            way = max(start_m - self.LENGTH / 2, 0.0)
            allowed = min(allowed, np.sqrt(limit**2 + 2 * CURVE_BRAKING_M_S2 * way))
        return float(allowed)

    def _clearance(self, speed: float, closing: float) -> float:
        """Return IDM's wanted gap in metres, bumper to bumper."""
        braking = 2 * np.sqrt(-self.COMFORT_ACC_MAX * self.COMFORT_ACC_MIN)
        return float(
            self.DISTANCE_WANTED + max(0.0, speed * self.TIME_WANTED + speed * closing / braking)
        )


class Parked(Vehicle):  # type: ignore[misc]
    """A vehicle that stands still on a lane, or facing against it."""

    def __init__(
        self, road: Any, lane_index: Any, along_m: float, *, body: Body, reverse: bool = False
    ) -> None:
        lane = road.network.get_lane(lane_index)
        heading = lane.heading_at(along_m) + np.pi * reverse
        super().__init__(road, lane.position(along_m, 0.0), heading, 0.0)
        self.body = body
        self.LENGTH, self.WIDTH, _ = body.size
        self.diagonal = float(np.hypot(self.LENGTH, self.WIDTH))
        self.lane_index, self.lane, self.target_lane_index = lane_index, lane, lane_index
        self.slot = -1

    def act(self, action: Any = None) -> None:
        """Do nothing."""

    def step(self, dt: float) -> None:
        """Stay."""


def _reach(a: Any, b: Any) -> float:
    return float((a.LENGTH + b.LENGTH) / 2)
