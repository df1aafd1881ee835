"""Drivers of our traffic as objects of highway-env."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.utils import wrap_to_pi
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from roadscope.envs.traffic.driving import (
    CALM_BRAKING_M_S2,
    CURVE_BRAKING_M_S2,
    LATERAL_JERK_M_S3,
    LATERAL_LIMIT_M_S2,
    RAMP_BRAKING_M_S2,
    RAMP_GAP_S,
    STEERING_RATE_RAD_S,
)
from roadscope.envs.traffic.roads import CURVE_LATERAL_M_S2, Roads, greatest_curvature


def clamp(value: float, low: float, high: float) -> float:
    """Return a number limited to an interval; `np.clip` takes ten times as long for one number."""
    return float(min(max(value, low), high))


class Driver(IDMVehicle):  # type: ignore[misc]
    """An IDM and MOBIL vehicle of highway-env with its own body.

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

    def __init__(self, road: Any, roads: Roads, body: Any, legs: Any) -> None:
        """Take over a record of `RoadBody` and the roads of its route."""
        index = list(roads.lane_numbers)[body["target"]]
        names = roads.road_names
        super().__init__(
            road,
            (body["x"], body["y"]),
            float(body["heading"]),
            float(body["speed"]),
            target_lane_index=index,
            target_speed=float(body["target_speed"]),
            route=[(*names[leg], None) for leg in legs] or None,
            enable_lane_change=bool(body["lane_changes"]),
        )
        self.heading = float(body["heading"])
        self.number = int(body["number"])
        self.LENGTH, self.WIDTH = float(body["length"]), float(body["width"])
        self.diagonal = float(np.hypot(self.LENGTH, self.WIDTH))
        self.COMFORT_ACC_MAX = float(body["comfort"])
        self.TIME_WANTED = float(body["time_gap"])
        self.DISTANCE_WANTED = float(body["standstill_gap"])
        self.timer = float(body["timer"])
        self.lane_index, self.lane = index, road.network.get_lane(index)
        # How far the front may still go until a line to wait at, metres; None where there is none.
        self.hold_m: float | None = None
        self.slot = -1

    def act(self, action: Any = None) -> None:
        """Choose lane, steering and acceleration."""
        if self.crashed:
            return
        self.follow_road()
        if self.enable_lane_change:
            self.change_lane_policy()
        steering = self.steering_control(self.target_lane_index)
        Vehicle.act(self, {"steering": steering, "acceleration": self._allowed_acceleration()})

    def step(self, dt: float) -> None:
        """Move for `dt` seconds within the limits of steering; never drive backwards."""
        rate = min(STEERING_RATE_RAD_S, LATERAL_JERK_M_S3 * self.LENGTH / max(self.speed, 1.0) ** 2)
        last = getattr(self, "wheel", 0.0)
        self.wheel = last + clamp(self.action["steering"] - last, -rate * dt, rate * dt)
        self.action["steering"] = self.wheel
        if not self.crashed:
            self.action["acceleration"] = max(self.action["acceleration"], -self.speed / dt)
        super().step(dt)

    def on_state_update(self) -> None:
        """Keep the lane: `FlowRoad.step` updates the lanes of all vehicles together."""

    def acceleration(
        self, ego_vehicle: Any, front_vehicle: Any = None, rear_vehicle: Any = None
    ) -> float:
        """Return the acceleration of a vehicle behind another, m/s^2; MOBIL calls this."""
        if ego_vehicle is None or not isinstance(ego_vehicle, Vehicle):
            return 0.0
        desired_speed = float(getattr(ego_vehicle, "target_speed", ego_vehicle.speed))
        if front_vehicle is None:
            return self.free_acceleration(ego_vehicle.speed, desired_speed)
        gap = ego_vehicle.lane_distance_to(front_vehicle) - _half_lengths(
            ego_vehicle, front_vehicle
        )
        return self.following_acceleration(
            ego_vehicle.speed, desired_speed, gap, front_vehicle.speed
        )

    def mobil(self, lane_index: Any) -> bool:
        """Return whether to change to a lane: it is safe, and it pays or the own lane ends."""
        if not self.lane.forbidden:
            return bool(super().mobil(lane_index))
        ahead, behind = self.road.neighbour_vehicles(self, lane_index)
        return self._gap_is_safe(self, ahead) and self._gap_is_safe(behind, self)

    def _gap_is_safe(self, rear: Any, front: Any) -> bool:
        """Return whether drivers at the end of a ramp accept the gap between two vehicles."""
        if rear is None or front is None:
            return True
        gap = rear.lane_distance_to(front) - _half_lengths(rear, front)
        closing = max(rear.speed - front.speed, 0.0)
        return bool(gap > max(2.0, RAMP_GAP_S * rear.speed) + closing**2 / (2 * RAMP_BRAKING_M_S2))

    def desired_gap(
        self, ego_vehicle: Any, front_vehicle: Any = None, projected: bool = True
    ) -> float:
        """Return the desired distance between both centres in metres, from the true lengths."""
        closing = ego_vehicle.speed - front_vehicle.speed
        return self._desired_clearance(ego_vehicle.speed, closing) + _half_lengths(
            ego_vehicle, front_vehicle
        )

    def free_acceleration(self, speed: float, desired_speed: float) -> float:
        """Return the acceleration on a free road, m/s^2 (improved IDM of Treiber and Kesting)."""
        up, down = self.COMFORT_ACC_MAX, -self.COMFORT_ACC_MIN
        desired_speed = max(desired_speed, 0.1)
        if speed <= desired_speed:
            return float(up * (1.0 - (speed / desired_speed) ** self.DELTA))
        return float(-down * (1.0 - (desired_speed / speed) ** (up * self.DELTA / down)))

    def following_acceleration(
        self, speed: float, desired_speed: float, gap_m: float, front_speed: float
    ) -> float:
        """Return the acceleration behind a leader at a bumper-to-bumper gap, m/s^2."""
        ratio = self._desired_clearance(speed, speed - front_speed) / max(gap_m, 0.1)
        acceleration = (
            self.free_acceleration(speed, desired_speed) - self.COMFORT_ACC_MAX * ratio**2
        )
        # If another vehicle cuts in and the gap is too short, plain IDM brakes far too hard.
        needed_braking = max(speed**2 - front_speed**2, 0.0) / (2 * max(gap_m - 0.5, 0.3))
        return float(
            max(acceleration, -max(CALM_BRAKING_M_S2, 1.5 * needed_braking), -self.ACC_MAX)
        )

    def steering_control(self, target_lane_index: Any) -> float:
        """Return the wheel angle that leads to a lane's centre line, radians.

        Curvature of the lane ahead plus feedback of offset and course error; the product of
        curvature and squared speed stays within `LATERAL_LIMIT_M_S2`.
        """
        lane = self.road.network.get_lane(target_lane_index)
        along, across = lane.local_coordinates(self.position)
        slip = np.arctan(np.tan(self.action["steering"]) / 2)
        course = wrap_to_pi(self.heading + slip - lane.heading_at(along))
        speed = max(self.speed, 3.0)
        feedback = 0.6 * clamp(across, -2.5, 2.5) + 1.6 * speed * np.sin(course)
        curvature = self._curvature_ahead(lane, along) - feedback / speed**2
        curvature_limit = LATERAL_LIMIT_M_S2 / max(self.speed, 0.5) ** 2
        sine_of_slip = clamp(
            clamp(curvature, -curvature_limit, curvature_limit) * self.LENGTH / 2, -0.9, 0.9
        )
        wheel = np.arctan(2 * np.tan(np.arcsin(sine_of_slip)))
        return clamp(wheel, -self.MAX_STEERING_ANGLE, self.MAX_STEERING_ANGLE)

    def _curvature_ahead(self, lane: Any, along: float) -> float:
        """Return the mean curvature of the lane ahead, 1/m."""
        ahead = max(1.5, 0.5 * self.speed)
        here = lane.heading_at(along)
        if along + ahead <= lane.length:
            there = lane.heading_at(along + ahead)
        else:
            following = self.road.next_lane(self.target_lane_index, self.route)
            if following is None:
                return 0.0
            after = self.road.network.get_lane(following)
            there = after.heading_at(along + ahead - lane.length)
        return float(wrap_to_pi(there - here) / ahead)

    def _allowed_acceleration(self) -> float:
        """Return the acceleration that leaders, curves and junctions allow, m/s^2."""
        desired_speed = min(self.target_speed, self._curve_speed())
        acceleration = self.free_acceleration(self.speed, desired_speed)
        lanes = [self.lane_index]
        if self.target_lane_index != self.lane_index:
            lanes.append(self.target_lane_index)
        for lane_index in lanes:
            leader = self.road.leader(self, lane_index)
            if leader is not None:
                acceleration = min(
                    acceleration, self.following_acceleration(self.speed, desired_speed, *leader)
                )
        if self.hold_m is not None:
            gap = self.hold_m + self.DISTANCE_WANTED - 0.5
            acceleration = min(
                acceleration, self.following_acceleration(self.speed, desired_speed, gap, 0.0)
            )
        return max(acceleration, -self.ACC_MAX)

    def _curve_speed(self) -> float:
        """Return the greatest speed that still allows to slow down for the curves ahead, m/s."""
        allowed_speed = np.inf
        for lane_index, start_m in self.road.lanes_ahead(self, self.target_lane_index):
            lane = self.road.network.get_lane(lane_index)
            curvature = greatest_curvature(lane)
            limit = lane.speed_limit or np.inf
            if curvature > 0:
                limit = min(limit, np.sqrt(CURVE_LATERAL_M_S2 / curvature))
            distance_m = max(start_m - self.LENGTH / 2, 0.0)
            allowed_speed = min(
                allowed_speed, np.sqrt(limit**2 + 2 * CURVE_BRAKING_M_S2 * distance_m)
            )
        return float(allowed_speed)

    def _desired_clearance(self, speed: float, closing: float) -> float:
        """Return IDM's desired gap in metres, bumper to bumper."""
        braking = 2 * np.sqrt(-self.COMFORT_ACC_MAX * self.COMFORT_ACC_MIN)
        return float(
            self.DISTANCE_WANTED + max(0.0, speed * self.TIME_WANTED + speed * closing / braking)
        )


class Parked(Vehicle):  # type: ignore[misc]
    """A vehicle that stands still on a lane, or facing against it."""

    def __init__(self, road: Any, roads: Roads, body: Any) -> None:
        super().__init__(road, (body["x"], body["y"]), float(body["heading"]), 0.0)
        index = list(roads.lane_numbers)[body["target"]]
        self.number = int(body["number"])
        self.LENGTH, self.WIDTH = float(body["length"]), float(body["width"])
        self.diagonal = float(np.hypot(self.LENGTH, self.WIDTH))
        self.lane_index = self.target_lane_index = index
        self.lane, self.slot = road.network.get_lane(index), -1

    def act(self, action: Any = None) -> None:
        """Do nothing."""

    def step(self, dt: float) -> None:
        """Stay."""


def _half_lengths(a: Any, b: Any) -> float:
    """Return the distance between the centres of two vehicles whose bumpers touch, metres."""
    return float((a.LENGTH + b.LENGTH) / 2)
