"""Many vehicles on a winding closed track."""

from __future__ import annotations

import numpy as np
from highway_env.envs.racetrack_env import RacetrackEnv

from roadscope.envs.traffic.driving import Driver
from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.networks import network_of
from roadscope.envs.traffic.stage import Stage

SPACING_M, LOOP_SPACING_M = 24.0, 36.0


def racetrack(rng: np.random.Generator) -> Stage:
    """Two lanes in a loop of about 350 m, at 5 to 10 m/s; everybody keeps the lane."""
    return _filled(rng, SPACING_M, (8.0, 10.0))


def racetrack_loop(rng: np.random.Generator) -> Stage:
    """As racetrack, with room to drive: the ego is back where it began within 70 s."""
    return _filled(rng, LOOP_SPACING_M, (9.0, 11.0))


def _filled(rng: np.random.Generator, spacing_m: float, wishes_m_s: tuple[float, float]) -> Stage:
    road = FlowRoad(network_of(RacetrackEnv).network, rng)
    for side in (0, 1):
        left_m = float(rng.uniform(5.0, spacing_m))
        for start, roads in road.network.graph.items():
            for end, lanes in roads.items():
                length = float(lanes[side].length)
                while left_m < length - 1.0:
                    _join(road, rng, (start, end, side), left_m, wishes_m_s)
                    left_m += spacing_m * float(rng.uniform(0.85, 1.4))
                left_m -= length
    ego = road.vehicles[int(rng.integers(len(road.vehicles)))]
    ego.carry(EGO)
    return Stage(road, ego, warm_up_s=3.0)


def _join(
    road: FlowRoad,
    rng: np.random.Generator,
    lane_index: tuple[str, str, int],
    at: float,
    wishes_m_s: tuple[float, float],
) -> None:
    wish = float(rng.uniform(*wishes_m_s))
    body = draw_body("tight", rng)
    road.vehicles.append(
        Driver(road, lane_index, at, body=body, speed=4.5, wish=wish).vary(rng)
    )  # fmt: skip
