"""Vehicles from a ramp join a motorway."""

from __future__ import annotations

import numpy as np
from highway_env.envs.merge_env import MergeGenericEnv

from roadscope.envs.traffic.driving import Driver
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import leave
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.stage import Stage

SECTIONS = {
    "before_merge_length": 260, "converge_merge_length": 80,
    "parallel_merge_length": 160, "after_merge_length": 700,
}  # fmt: skip
EGO_AT_M = 215.0


def merge(rng: np.random.Generator) -> Stage:
    """Two lanes at about 16 m/s, and a ramp whose vehicles must change lanes before its end."""
    built = network_of(MergeGenericEnv, config=SECTIONS)
    road = FlowRoad(built.network, rng)
    road.objects = built.objects
    ego = None
    for lane, wish in ((0, 18.0), (1, 16.0)):
        start = EGO_AT_M if lane else EGO_AT_M + float(rng.uniform(-15.0, 15.0))
        places = [start]
        while places[-1] < 390.0:
            places.append(places[-1] + float(rng.uniform(26.0, 42.0)))
        while places[0] > 90.0:
            places.insert(0, places[0] - float(rng.uniform(26.0, 42.0)))
        for at in places:
            mine = lane == 1 and at == EGO_AT_M
            driver = _join(road, rng, ("a", "b", lane), at, wish=wish, mine=mine)
            ego = driver if mine else ego
    ramp = ("j", "k", 0)
    for at in np.arange(100.0, 250.0, 35.0) + rng.uniform(-5.0, 5.0, 5):
        _join(road, rng, ramp, float(at), wish=15.0)
    return Stage(road, ego, rules=(lambda road: leave(road, ego),))


def _join(
    road: FlowRoad, rng: np.random.Generator, lane_index: tuple[str, str, int], at: float,
    *, wish: float, mine: bool = False,
) -> Driver:  # fmt: skip
    driver = Driver(
        road, lane_index, at, body=EGO if mine else draw_body("urban", rng),
        speed=0.9 * wish, wish=wish * float(rng.uniform(0.95, 1.1)), lane_changes=not mine,
    ).vary(rng)  # fmt: skip
    road.vehicles.append(driver)
    return driver
