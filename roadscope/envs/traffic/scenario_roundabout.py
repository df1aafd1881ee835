"""Four roads meet at a roundabout."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.envs.roundabout_env import RoundaboutEnv
from highway_env.road.lane import StraightLane

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import Inflow
from roadscope.envs.traffic.junction import GiveWay
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.stage import Stage

SIDES = "senw"
ENTRIES = [(f"{side}es", f"{side}e", 0) for side in SIDES]
SOURCES = [(f"{side}er", f"{side}es", 0) for side in SIDES]
RING = ["se", "ex", "ee", "nx", "ne", "wx", "we", "sx"]
OUTER = 1
LINE_RADIUS_M = 28.0
"""Who waits keeps the front this far from the middle; the outer lane ends at 26 m."""
WISH = 9.0
BEND_SPEED = 5.8
"""On the ring and on its entries and exits, whose ends do not quite meet it, m/s."""
EGO_PLACE = 2
"""How many drivers are before the ego on its road."""


def roundabout(rng: np.random.Generator) -> Stage:
    """Let traffic flow in from all sides at up to 9 m/s; everybody uses the outer lane."""
    road = FlowRoad(network_of(RoundaboutEnv).network, rng)
    inflow = Inflow(rng, SOURCES, _goal, "tight", WISH, headway_s=3.5)
    for lane in road.network.lanes_list():
        if type(lane) is not StraightLane:
            lane.speed_limit = BEND_SPEED
    ego = inflow.line_up_all(road, (2.0, 10.0), EGO_PLACE)
    rule = GiveWay({e: _line(road, e) for e in ENTRIES}, {e: _upstream(e) for e in ENTRIES}, 3.2)
    return Stage(road, ego, warm_up_s=1.0, rules=(inflow, rule))


def _goal(rng: np.random.Generator, source: Any, length_m: float) -> str:
    """Draw an exit other than the one beside the entry."""
    others = [side for side in SIDES if side != source[0][0]]
    return f"{others[int(rng.integers(len(others)))]}xr"


def _upstream(entry: Any) -> list[Any]:
    """List the ring's outer lanes that lead to an entry, nearest first."""
    at = RING.index(entry[1])
    nodes = [RING[(at - k) % 8] for k in range(8)]
    return [(start, end, OUTER) for start, end in zip(nodes[1:], nodes[:-1], strict=True)]


def _line(road: FlowRoad, entry: Any) -> float:
    """Metres before the end of an entry at which it comes within the line's radius."""
    lane = road.network.get_lane(entry)
    along = np.linspace(0.0, lane.length, 200)
    radii = np.array([np.hypot(*lane.position(s, 0.0)) for s in along])
    return float(lane.length - along[radii > LINE_RADIUS_M].max())
