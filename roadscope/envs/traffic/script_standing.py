"""The ego stands while others drive past."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.envs.traffic.course import winding
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player
from roadscope.envs.traffic.script_stream import REACH_M, Carriageways
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 30.0
QUEUE_M = 22.0


def standing_in_traffic(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand all the time, as if to turn off, while others pass at 7 to 14 m/s on both sides.

    One lane of the ego's direction to the right, one or none to the left, then two oncoming ones;
    up to three wait before and behind the ego. A street with houses, trees and parked cars.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    mine = int(rng.integers(2))
    ways = Carriageways(mine + 2, mine, "urban", oncoming=2, gaps_m=(3.0, 22.0), median_m=0.3)
    return _stand(rng, ways, (7.0, 14.0), "urban", duration_s)


def standing_barriers(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand on the right of a motorway between noise walls while others pass at 10 to 28 m/s.

    Two or three lanes of the ego's direction to its left, by seed also three oncoming ones; up to
    three stand before and behind the ego. Nothing but a sign now and then tells places apart.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    mine, facing = int(rng.integers(2, 4)), 3 * int(rng.integers(2))
    ways = Carriageways(mine + 1, mine, "motorway", oncoming=facing, median_m=2.0)
    return _stand(rng, ways, (10.0, 28.0), "barriers", duration_s)


def _stand(
    rng: np.random.Generator,
    ways: Carriageways,
    speeds: tuple[float, float],
    style: str,
    duration_s: float | None,
) -> Timeline:
    times = times_until(DURATION_S if duration_s is None else duration_s)
    stopped, fastest = Motion(0.0, 0.0, 0.0), float(rng.uniform(*speeds))
    queue = replace(ways.lanes[ways.mine], gaps_m=(1.5, 4.0), mix="parked")
    reach = float(rng.uniform(0.0, QUEUE_M)), float(rng.uniform(0.0, QUEUE_M))
    cast = [Player(stopped, EGO), *queue.around(rng, stopped, EGO, reach)]
    for i, lane in enumerate(ways.lanes):
        if i != ways.mine:
            speed = max(fastest * float(rng.uniform(0.75, 1.0)), speeds[0])
            cast += ways.stream(rng, lane, (speed, 0.0), float(times[-1]))
    course = winding(rng, (-REACH_M, REACH_M), fastest**2)
    return ways.road(course, style).play(cast, times)
