"""A stage of our traffic, played by objects."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from highway_env.vehicle.objects import Obstacle

from research.object_traffic import rules
from research.object_traffic.driving import Driver, Parked
from research.object_traffic.flow import FlowRoad
from research.object_traffic.walkers import People, Walker
from roadscope.envs.traffic import walkers
from roadscope.envs.traffic.inflow import Inflow, Outflow
from roadscope.envs.traffic.junction import Crossing, GiveWay, Hold
from roadscope.envs.traffic.mix import RoadUserBody
from roadscope.envs.traffic.recorder import TrafficRecorder
from roadscope.envs.traffic.road_users import DRIVER, OBSTACLE, WALKER
from roadscope.envs.traffic.simulated import STEP_S, Stage
from roadscope.envs.traffic.timeline import Timeline

Rule = Callable[[FlowRoad], None]


class ObjectStage:
    """The road of a stage with its bodies as objects; the stage must not be played itself."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self.road = FlowRoad(stage.flow.roads.network, np.random.default_rng(0))
        for body in stage.flow.bodies:
            group = self.road.objects if body["kind"] == OBSTACLE else self.road.vehicles
            group.append(self._object(body))
        self.road.refresh()
        self._rules = [self._rule(rule) for rule in stage.rules]

    def advance(self) -> None:
        """Simulate one step."""
        for rule in self._rules:
            rule(self.road)
        self.road.act()
        self.road.step(STEP_S)

    def play(self, *, duration_s: float, style: str) -> Timeline:
        """Run the traffic at 20 Hz and return its timeline."""
        for _ in range(round(self._stage.warm_up_s / STEP_S)):
            self.advance()
        recorder = TrafficRecorder(style=style, raw=False)
        ego = next(v for v in self.road.vehicles if v.number == self._stage.ego)
        recorder.follow(self.road, ego)
        for _ in range(round(duration_s / STEP_S)):
            self.advance()
            recorder.tick(self.road, STEP_S)
        return recorder.timeline()

    def _object(self, body: Any) -> Any:
        """Return the object of a record of `RoadBody`."""
        flow = self._stage.flow
        if body["kind"] == OBSTACLE:
            obstacle = Obstacle(self.road, (body["x"], body["y"]), float(body["heading"]))
            obstacle.LENGTH, obstacle.WIDTH = float(body["length"]), float(body["width"])
            return obstacle
        made: Any
        if body["kind"] == WALKER:
            made = Walker(body, flow.paths[body["first_knot"] : body["last_knot"]])
        elif body["kind"] == DRIVER:
            legs = flow.traffic().legs[body["first_leg"] : body["last_leg"]]
            made = Driver(self.road, flow.roads, body, legs.tolist())
        else:
            made = Parked(self.road, flow.roads, body)
        made.body = flow.users[body["number"]]
        return made

    def _rule(self, rule: Any) -> Rule:
        """Return the rule of the product over objects."""
        if isinstance(rule, Inflow):
            return rules.Inflow(rule, partial(self._place, rule))
        if isinstance(rule, Outflow):
            return partial(rules.remove_arrived, ego=rule.ego)
        if isinstance(rule, Crossing):
            return rules.Crossing(self.road, rule.conflicts.lines)
        if isinstance(rule, GiveWay):
            return rules.GiveWay(rule)
        if isinstance(rule, Hold):
            return partial(rules.hold, lines=rule.lines)
        assert isinstance(rule, walkers.People)
        return People(rule.step_s)

    def _place(self, inflow: Inflow, source: Any, body: RoadUserBody) -> Driver:
        """Draw a driver as the product does, and return it as an object."""
        inflow.place(self._stage.flow, source, 0.0, body)
        driver: Driver = self._object(self._stage.flow.bodies[-1])
        return driver
