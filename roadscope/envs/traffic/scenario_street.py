"""A street in town with people on the pavements and on the road."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.envs.intersection_env import IntersectionEnv
from highway_env.envs.two_way_env import TwoWayEnv

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import Inflow
from roadscope.envs.traffic.junction import Crossing
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.pavement import Kerb
from roadscope.envs.traffic.scenario_intersection import EGO_PLACE, LINE_M, SOURCES, _goal
from roadscope.envs.traffic.stage import STEP_S, Stage
from roadscope.envs.traffic.walkers import People

LENGTH_M = 420.0
EGO_AT_M = 110.0
OURS, ONCOMING = ("a", "b", 1), ("b", "a", 0)
WISH = 8.5
SPACING_M = (22.0, 40.0)
ARM_M = 12.0
"""People cross an arm of the crossing this far before its end."""


def street(rng: np.random.Generator) -> Stage:
    """One lane each way; people walk, stand, ride and cross."""
    road = FlowRoad(network_of(TwoWayEnv, length=LENGTH_M).network, rng)
    inflow = Inflow(rng, (OURS, ONCOMING), lambda *_: None, "urban", WISH, headway_s=5.0)
    ego = inflow.keep = inflow.place(road, OURS, EGO_AT_M, EGO)
    for lane_index, first, last in ((OURS, EGO_AT_M, 380.0), (ONCOMING, 20.0, 400.0)):
        at = first + float(rng.uniform(*SPACING_M))
        while at < last:
            inflow.place(road, lane_index, at, draw_body("urban", rng))
            at += float(rng.uniform(*SPACING_M))
    sides = [
        Kerb(road, lane_index, _width(road, OURS, ONCOMING)) for lane_index in (OURS, ONCOMING)
    ]
    for kerb in sides:
        _populate(kerb, rng)
    return Stage(road, ego, warm_up_s=1.0, rules=(inflow, People(STEP_S)))


def _populate(kerb: Kerb, rng: np.random.Generator) -> None:
    ends = (5.0, kerb.length_m - 5.0)
    at = 20.0
    while at < kerb.length_m - 30.0:
        kerb.walk(rng, at, ends=ends)
        at += float(rng.uniform(10.0, 26.0))
    for at in rng.uniform(60.0, kerb.length_m - 60.0, 5):
        kerb.cross(rng, float(at), coming_m=float(rng.uniform(1.0, 12.0)))
    for at in rng.uniform(20.0, kerb.length_m - 120.0, 3):
        kerb.ride(rng, float(at), end_m=kerb.length_m - 5.0)


def town_crossing(rng: np.random.Generator) -> Stage:
    """Cross with people on all corners."""
    road = FlowRoad(network_of(IntersectionEnv).network, rng)
    inflow = Inflow(rng, SOURCES, _goal, "urban", 8.0, headway_s=4.5)
    ego = inflow.line_up_all(road, (8.0, 18.0), EGO_PLACE)
    rule = Crossing(road, dict.fromkeys(SOURCES, LINE_M))
    for source in SOURCES:
        kerb = Kerb(road, source, 2 * float(road.network.get_lane(source).width_at(0.0)))
        edge = kerb.length_m - ARM_M
        for at in rng.uniform(edge - 50.0, edge, 3):
            kerb.walk(rng, float(at), ends=(5.0, kerb.length_m - 2.0))
        kerb.cross(rng, edge, coming_m=float(rng.uniform(1.0, 14.0)))
        kerb.ride(rng, float(rng.uniform(edge - 60.0, edge - 25.0)), end_m=edge)
    return Stage(road, ego, warm_up_s=2.0, rules=(inflow, rule, People(STEP_S)))


def _width(road: FlowRoad, *lanes: Any) -> float:
    return sum(float(road.network.get_lane(lane).width_at(0.0)) for lane in lanes)
