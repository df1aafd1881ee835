"""The ego stands before a road that others drive on."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.envs.intersection_env import IntersectionEnv

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import Inflow
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.scenario_intersection import LINE_M, LONG_M, SOURCES, WISH
from roadscope.envs.traffic.stage import Stage

OURS, OPPOSITE = SOURCES[0], SOURCES[2]
HEADWAY_S = 2.6


def waiting(rng: np.random.Generator) -> Stage:
    """Let the ego wait first in line, as those opposite do; both ways cross before it."""
    road = FlowRoad(network_of(IntersectionEnv).network, rng)
    inflow = Inflow(rng, SOURCES, _goal, "urban", WISH, headway_s=HEADWAY_S)
    inflow.line_up_all(road, (8.0, 14.0), ego_place=0)
    return Stage(road, inflow.keep, warm_up_s=5.0, rules=(inflow, _hold))


def _hold(road: FlowRoad) -> None:
    """Let nobody over the lines of the minor road."""
    for driver in road.vehicles:
        lane_index = driver.target_lane_index
        if lane_index in (OURS, OPPOSITE):
            way = float(road.network.get_lane(lane_index).length) - road.along(driver, lane_index)
            driver.hold_m = way - LINE_M - driver.LENGTH / 2


def _goal(rng: np.random.Generator, source: Any, length_m: float) -> str:
    """Draw where to go: straight on or right, never across the way of those who come."""
    corner = int(source[0][1])
    turn = 2 if length_m > LONG_M else int(rng.choice([2, 2, 2, 3]))
    return f"o{(corner + turn) % 4}"
