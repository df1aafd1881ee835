"""A country road with oncoming traffic."""

from __future__ import annotations

import numpy as np
from highway_env.envs.two_way_env import TwoWayEnv

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import Inflow
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.stage import Stage

LENGTH_M = 1200.0
EGO_AT_M = 160.0
SPACING_M = (22.0, 34.0)
OURS, ONCOMING = ("a", "b", 1), ("b", "a", 0)
WISH = 13.5


def two_way(rng: np.random.Generator) -> Stage:
    """One lane each way at about 13 m/s; nobody overtakes."""
    road = FlowRoad(network_of(TwoWayEnv, length=LENGTH_M).network, rng)
    inflow = Inflow(rng, (OURS, ONCOMING), lambda *_: None, "urban", WISH, headway_s=2.6)
    ego = inflow.place(road, OURS, EGO_AT_M, EGO)
    inflow.keep = ego
    for lane_index, first, last in (
        (OURS, EGO_AT_M, EGO_AT_M + 260.0), (ONCOMING, 10.0, LENGTH_M - 20.0)
    ):  # fmt: skip
        at = first + float(rng.uniform(*SPACING_M))
        while at < last:
            inflow.place(road, lane_index, at, draw_body("urban", rng))
            at += float(rng.uniform(*SPACING_M))
    at = EGO_AT_M - float(rng.uniform(*SPACING_M))
    while at > 10.0:
        inflow.place(road, OURS, at, draw_body("urban", rng))
        at -= float(rng.uniform(*SPACING_M))
    return Stage(road, ego, rules=(inflow,))
