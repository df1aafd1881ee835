"""Two roads of a town cross."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.envs.intersection_env import IntersectionEnv

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import Inflow
from roadscope.envs.traffic.junction import Crossing
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.stage import Stage

SOURCES = [(f"o{corner}", f"ir{corner}", 0) for corner in range(4)]
WISH = 8.0
LINE_M = 3.0
"""highway-env takes a vehicle to be past a lane 2.5 m before its end, and bumpers lead centres."""
EGO_PLACE = 2
"""How many drivers are before the ego on its road."""
LONG_M = 6.5
"""Longer vehicles drive straight on: highway-env's turns have radii of 9 and 13 m."""


def intersection(rng: np.random.Generator) -> Stage:
    """Let traffic flow in from all sides at up to 8 m/s."""
    road = FlowRoad(network_of(IntersectionEnv).network, rng)
    inflow = Inflow(rng, SOURCES, _goal, "urban", WISH, headway_s=3.5)
    ego = inflow.line_up_all(road, (8.0, 18.0), EGO_PLACE)
    rule = Crossing(road, dict.fromkeys(SOURCES, LINE_M))
    return Stage(road, ego, warm_up_s=2.0, rules=(inflow, rule))


def _goal(rng: np.random.Generator, source: Any, length_m: float) -> str:
    """Draw where to go: straight on, left or right."""
    corner = int(source[0][1])
    turn = 2 if length_m > LONG_M else int(rng.choice([1, 2, 2, 3]))
    return f"o{(corner + turn) % 4}"
