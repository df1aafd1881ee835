"""Motorway traffic, free and dense."""

from __future__ import annotations

import numpy as np
from highway_env.road.road import RoadNetwork

from roadscope.envs.traffic.driving import HEAVY, Driver
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.stage import Stage

LENGTH_M = 2400.0
EGO_AT_M = 500.0


def motorway(rng: np.random.Generator) -> Stage:
    """Four lanes at about 25 m/s."""
    return _straight(rng, lanes=4, wish=31.0, headway_s=1.35, reach_m=300.0)


def dense_motorway(rng: np.random.Generator) -> Stage:
    """Four full lanes at about 12 m/s."""
    return _straight(rng, lanes=4, wish=16.0, headway_s=1.05, reach_m=150.0)


def _straight(
    rng: np.random.Generator, *, lanes: int, wish: float, headway_s: float, reach_m: float
) -> Stage:
    network = RoadNetwork.straight_road_network(lanes, length=LENGTH_M, speed_limit=1.2 * wish)
    road = FlowRoad(network, rng)
    ego_lane = int(rng.integers(1, lanes - 1))
    ego = None
    for lane in range(lanes):
        speed = wish * (0.94 - 0.05 * lane)
        for at in _places(rng, ego_lane == lane, headway_s * speed + 8.0, reach_m):
            mine = ego is None and lane == ego_lane and at == EGO_AT_M
            body = EGO if mine else draw_body("motorway", rng)
            if body.category in HEAVY and lane < lanes - 2:
                body = draw_body("parked", rng)
            driver = Driver(
                road, ("0", "1", lane), at, body=body, lane_changes=True,
                speed=speed, wish=speed * float(rng.uniform(0.9, 1.3)),
            ).vary(rng)  # fmt: skip
            road.vehicles.append(driver)
            ego = driver if mine else ego
    assert ego is not None
    return Stage(road, ego, warm_up_s=2.0)


def _places(
    rng: np.random.Generator, through_ego: bool, spacing_m: float, reach_m: float
) -> list[float]:
    """Draw where vehicles stand along a lane, around the ego's place."""
    at = EGO_AT_M if through_ego else EGO_AT_M + float(rng.uniform(-0.5, 0.5)) * spacing_m
    places = [at]
    while places[-1] < EGO_AT_M + reach_m:
        places.append(places[-1] + _spacing(rng, spacing_m))
    while places[0] > EGO_AT_M - reach_m:
        places.insert(0, places[0] - _spacing(rng, spacing_m))
    return places


def _spacing(rng: np.random.Generator, mean_m: float) -> float:
    """Draw a distance between centres; the longest vehicles are 16.5 m long."""
    return max(19.0, mean_m * float(rng.uniform(0.75, 1.35)))
