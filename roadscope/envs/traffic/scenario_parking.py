"""A car park: most vehicles stand, a few drive slowly along the aisle."""

from __future__ import annotations

import numpy as np
from highway_env.envs.parking_env import ParkingEnv
from highway_env.road.lane import LineType, StraightLane

from roadscope.envs.traffic.driving import Driver, Parked
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.inflow import leave
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.stage import Stage

END_M = 50.0
ASIDE_M = 3.0
OCCUPIED = 0.75


def parking_lot(rng: np.random.Generator) -> Stage:
    """Drive past 28 spots, three quarters of them taken, with traffic both ways at 3 m/s."""
    network = network_of(ParkingEnv, builder="_create_road").network
    edge = (LineType.NONE, LineType.NONE)
    east, west = ("w", "e", 0), ("e2", "w2", 0)
    network.add_lane("w", "e", StraightLane([-END_M, ASIDE_M], [END_M, ASIDE_M], line_types=edge))
    network.add_lane(
        "e2", "w2", StraightLane([END_M, -ASIDE_M], [-END_M, -ASIDE_M], line_types=edge)
    )
    road = FlowRoad(network, rng)
    spots = [("a", "b", i) for i in range(14)] + [("b", "c", i) for i in range(14)]
    for spot in spots:
        if rng.random() < OCCUPIED:
            at = 4.0 + float(rng.uniform(-0.6, 0.6))
            body, reverse = draw_body("parked", rng), bool(rng.random() < 0.3)
            road.vehicles.append(Parked(road, spot, at, body=body, reverse=reverse))
    ego = _drive(road, rng, east, 18.0, mine=True)
    for lane_index, places in ((east, (4.0, 36.0, 52.0)), (west, (8.0, 27.0, 46.0, 62.0))):
        for at in places:
            if rng.random() < 0.8:
                _drive(road, rng, lane_index, at + float(rng.uniform(-3.0, 3.0)))
    return Stage(road, ego, rules=(lambda road: leave(road, ego),))


def _drive(
    road: FlowRoad, rng: np.random.Generator, lane_index: tuple[str, str, int],
    at: float, *, mine: bool = False,
) -> Driver:  # fmt: skip
    body = EGO if mine else draw_body("parked", rng)
    wish = float(rng.uniform(2.4, 3.4))
    driver = Driver(road, lane_index, at, body=body, speed=wish, wish=wish, route=[lane_index])
    road.vehicles.append(driver.vary(rng))
    return driver
