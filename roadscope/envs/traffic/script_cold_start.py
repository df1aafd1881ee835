"""The first scan is taken at full speed."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.course import winding
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_lane import breathing
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player
from roadscope.envs.traffic.script_stream import REACH_M, Carriageways
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 25.0
FAST_M_S = 22.0


def cold_start(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 15 to 35 m/s, by seed, from the first scan on: 375 to 875 m in 25 s.

    Two or three lanes each way, vehicles about 1.3 s behind one another, those to the left faster
    and those to the right slower; up to 22 m/s in town, above on a motorway.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    until, speed = float(times[-1]), float(rng.uniform(15.0, 35.0))
    style, mix = ("urban", "urban") if speed < FAST_M_S else ("motorway", "motorway")
    count = int(rng.integers(2, 4))
    mine = int(rng.integers(count))
    ego = breathing(rng, Motion(0.0, 0.0, speed), (-2.0, until), 0.8)
    ways = Carriageways(count, mine, mix, oncoming=count)
    cast = [Player(ego, EGO), *ways.lanes[mine].around(rng, ego, EGO, (REACH_M, REACH_M))]
    for i, lane in enumerate(ways.lanes):
        if i != mine:
            faster = (mine - i) * float(rng.uniform(1.5, 3.0)) if i < count else 0.0
            cast += ways.stream(rng, lane, (speed + faster, speed), until)
    course = winding(rng, (-REACH_M, (speed + 1) * until), speed**2 / rng.uniform(0.5, 1.2))
    return ways.road(course, style).play(cast, times)
