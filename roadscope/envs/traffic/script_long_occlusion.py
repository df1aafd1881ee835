"""Who is hidden behind a lorry for seconds, and comes out again."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.mix import EGO, HEAVY_TRUCKS, Body
from roadscope.envs.traffic.script_cast import Cast, any_car, any_van, timeline_of, times_until
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.timeline import Timeline

LANE_M = 3.6
LANES = (0.0, LANE_M, 2 * LANE_M, 3 * LANE_M + 1.0)
"""The ego's, the lorry's, the overtakers' and, behind a gap, the oncoming one."""
DURATION_S = 12.0
OVERTAKERS, ONCOMING = 4, 4


def long_occlusion(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive beside a lorry while others pass behind it, the same way and the other way.

    From the ego's roof the lorry hides about 35 m of the overtakers' lane: they are out of sight
    for 2 to 6 s, two at once, and change their speed meanwhile.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    return timeline_of(_cast(rng), times, lanes=LANES, width_m=LANE_M, style="motorway")


def _cast(rng: np.random.Generator) -> Cast:
    ego = Motion(0.0, 0.0, float(rng.uniform(11.0, 13.0)))
    beside = Motion(
        float(rng.uniform(-7.5, -4.5)),
        LANE_M + _aside(rng),
        ego.speed + float(rng.uniform(-0.3, 0.3)),
    )
    lorry = Body(Category.TRUCK, HEAVY_TRUCKS[0])
    follower = Motion(beside.x_m - float(rng.uniform(12.0, 16.0)), beside.y_m, beside.speed)
    leader = Motion(float(rng.uniform(20.0, 28.0)), _aside(rng), ego.speed)
    parts = [(ego, EGO), (beside, lorry), (follower, any_car(rng)), (leader, any_van(rng))]
    return (*parts, *_overtakers(rng, ego), *_oncoming(rng, ego))


def _overtakers(rng: np.random.Generator, ego: Motion) -> Cast:
    """Let a row of cars brake or speed up together, while the first two are hidden."""
    speed = ego.speed + float(rng.uniform(7.0, 10.0))
    change = (float(rng.uniform(3.0, 4.0)), float(rng.uniform(2.0, 3.0)), float(rng.uniform(-3, 2)))
    at, row = float(rng.uniform(-42.0, -34.0)), []
    for _ in range(OVERTAKERS):
        row.append((Motion(at, 2 * LANE_M + _aside(rng), speed, (change,)), any_car(rng)))
        at -= float(rng.uniform(13.0, 22.0))
    return tuple(row)


def _oncoming(rng: np.random.Generator, ego: Motion) -> Cast:
    speed, at, row = -float(rng.uniform(10.0, 13.0)), float(rng.uniform(40.0, 60.0)), []
    for _ in range(ONCOMING):
        row.append((Motion(at, LANES[-1] + _aside(rng), speed), any_car(rng)))
        at += float(rng.uniform(25.0, 60.0))
    return tuple(row)


def _aside(rng: np.random.Generator) -> float:
    return float(rng.uniform(-0.25, 0.25))
