"""A road of highway-env whose vehicles are stepped by kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle, MDPVehicle
from highway_env.vehicle.kinematics import Vehicle

from roadscope.envs.traffic.cars import CAR, CONTROLLED, IDM, STEERED, IdmModel, step_cars
from roadscope.envs.traffic.roads import Roads

_KINDS: dict[type, int] = {IDMVehicle: IDM, MDPVehicle: CONTROLLED, Vehicle: STEERED}


class AgentRoad(Road):  # type: ignore[misc]
    """A straight road with an agent among highway-env's IDM drivers, stepped by a kernel.

    The vehicles remain objects of highway-env. That of the agent is up to date after every step,
    the others when `vehicles` is read.

    recorder: called after every step; None for none. cars: (N,) of `CAR`.
    """

    recorder: Any = None
    cars: np.ndarray
    _is_outdated: bool

    @staticmethod
    def adopt(road: Any, agent: Any) -> bool:
        """Turn a road of highway-env into an `AgentRoad` if possible; return whether it was."""
        if not _is_simple(road, agent):
            return False
        road.__class__ = AgentRoad
        road._start(agent)
        return True

    @property
    def vehicles(self) -> list[Any]:
        """All vehicles as objects. Only changes of the agent have an effect."""
        if self._is_outdated:
            self._is_outdated = False
            for vehicle, car in zip(self._vehicles, self.cars, strict=True):
                self._update(vehicle, car)
        vehicles: list[Any] = self._vehicles
        return vehicles

    @vehicles.setter
    def vehicles(self, vehicles: list[Any]) -> None:
        """Replace the vehicles; from then on this is a road of highway-env again."""
        _ = self.vehicles
        self.__class__ = Road
        self.vehicles = vehicles

    @property
    def outdated_vehicles(self) -> list[Any]:
        """All vehicles as objects whose states may be those of an earlier step."""
        vehicles: list[Any] = self._vehicles
        return vehicles

    def act(self) -> None:
        """Do nothing: drivers decide in `step`."""

    def step(self, dt: float) -> None:
        """Let all drivers decide, move them, and record them."""
        car, agent = self.cars[self._slot], self._agent
        _describe_state(car, agent)
        if isinstance(agent, ControlledVehicle):
            car["target"] = self._lanes[agent.target_lane_index]
            car["target_speed"] = agent.target_speed
        else:
            car["steering"] = agent.action["steering"]
            car["acceleration"] = agent.action["acceleration"]
        step_cars(self.cars, self._lane_array, self._order, self._model, dt)
        self._update(agent, car)
        self._is_outdated = True
        if self.recorder is not None:
            self.recorder.tick(self, dt)

    def _start(self, agent: Any) -> None:
        self._vehicles = self.__dict__.pop("vehicles")
        self._agent, self._slot, self._is_outdated = agent, self._vehicles.index(agent), False
        roads = Roads(self.network)
        self._lanes, self._names = roads.lane_numbers, list(roads.lane_numbers)
        self._lane_array = roads.arrays.lanes
        # highway-env's drivers do not slow down for curves; these lanes are straight.
        self._model = IdmModel(*(float(getattr(IDMVehicle, name)) for name in IdmModel._fields))
        self.cars = np.zeros(len(self._vehicles), CAR)
        for vehicle, car in zip(self._vehicles, self.cars, strict=True):
            _describe(car, vehicle, self._lanes)
        self._order = np.argsort(self.cars["x"], kind="stable")

    def _update(self, vehicle: Any, car: Any) -> None:
        """Write the state of a record of `CAR` to its object."""
        vehicle.position = np.array((car["x"], car["y"]))
        vehicle.heading, vehicle.speed = float(car["heading"]), float(car["speed"])
        vehicle.crashed = bool(car["crashed"])
        vehicle.lane_index = self._names[car["lane"]]
        vehicle.lane = self.network.get_lane(vehicle.lane_index)
        vehicle.action = {
            "steering": float(car["steering"]),
            "acceleration": float(car["acceleration"]),
        }
        if car["kind"] == IDM:
            vehicle.target_lane_index = self._names[car["target"]]
            vehicle.timer = float(car["timer"])


def _is_simple(road: Any, agent: Any) -> bool:
    """Return whether all lanes are straight and of one road, and IDM drives all but the agent."""
    lanes = road.network.lanes_dict()
    return (
        type(road) is Road
        and not road.objects
        and not road.record_history
        and not road.neighbour_vehicles_connected_lanes
        and len({index[:2] for index in lanes}) == 1
        and all(type(lane) is StraightLane for lane in lanes.values())
        and type(agent) in (MDPVehicle, Vehicle)
        and all(type(v) is IDMVehicle and not v.route for v in road.vehicles if v is not agent)
        and all(v.check_collisions and v.collidable and v.solid for v in road.vehicles)
    )


def _describe(car: Any, vehicle: Any, lanes: dict[Any, int]) -> None:
    """Write a vehicle of highway-env to a record of `CAR`.

    lanes: numbers of lanes by highway-env's index.
    """
    car["kind"] = _KINDS[type(vehicle)]
    car["diagonal"], car["length"], car["width"] = vehicle.diagonal, vehicle.LENGTH, vehicle.WIDTH
    car["cos"], car["sin"] = np.cos(vehicle.heading), np.sin(vehicle.heading)
    car["heading"] = vehicle.heading
    _describe_state(car, vehicle)
    car["steering"] = vehicle.action["steering"]
    car["acceleration"] = vehicle.action["acceleration"]
    car["impact_x"], car["impact_y"] = (
        (np.nan, np.nan) if vehicle.impact is None else vehicle.impact
    )
    car["lane"] = car["target"] = lanes[vehicle.lane_index]
    if isinstance(vehicle, ControlledVehicle):
        car["target"], car["target_speed"] = lanes[vehicle.target_lane_index], vehicle.target_speed
    if isinstance(vehicle, IDMVehicle):
        car["lane_changes"], car["timer"] = vehicle.enable_lane_change, vehicle.timer
        car["exponent"] = vehicle.DELTA


def _describe_state(car: Any, vehicle: Any) -> None:
    """Write what may be set between steps: `ContinuousAction` sets the limits of the speed."""
    car["x"], car["y"] = vehicle.position
    car["speed"], car["crashed"] = vehicle.speed, vehicle.crashed
    car["slowest"], car["fastest"] = vehicle.MIN_SPEED, vehicle.MAX_SPEED
    if car["heading"] != vehicle.heading:
        car["heading"] = vehicle.heading
        car["cos"], car["sin"] = np.cos(vehicle.heading), np.sin(vehicle.heading)
