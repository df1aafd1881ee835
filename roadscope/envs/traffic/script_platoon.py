"""Driving in the middle of others that keep their places."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.course import winding
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_lane import Lane, breathing
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player, Road
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 30.0
WIDTH_M = 3.6
REACH_M = (130.0, 130.0)


def platoon(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 18 to 27 m/s in an inner lane of three or four, all 10 to 18 m behind one another.

    Everybody's speed goes up and down alike by up to 1 m/s; by seed each one's own wavers besides
    by 0 to 0.12 m/s. More than half are vans, lorries and buses. 540 to 810 m in 30 s.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    count = int(rng.integers(3, 5))
    mine = int(rng.integers(1, count - 1))
    lanes = [Lane((mine - i) * WIDTH_M, "convoy", (10.0, 18.0)) for i in range(count)]
    speed, waver = float(rng.uniform(18.0, 27.0)), float(rng.uniform(0.0, 0.12))
    span = (-2.0, float(times[-1]))
    ego = breathing(rng, Motion(0.0, 0.0, speed), span, 1.0)
    others = lanes[mine].around(rng, ego, EGO, REACH_M)
    for lane in lanes[:mine] + lanes[mine + 1 :]:
        beside = Motion(float(rng.uniform(-12.0, 4.0)), 0.0, speed, ego.speed_changes)
        others += lane.with_first(rng, beside, REACH_M)
    cast = [Player(ego, EGO)]
    cast += [Player(breathing(rng, p.motion, span, waver), p.body) for p in others]
    course = winding(
        rng, (-REACH_M[0], (speed + 1.0) * times[-1]), speed**2 / float(rng.uniform(0.5, 1.2))
    )
    return Road(course, tuple((lane.left_m, 1) for lane in lanes), WIDTH_M, "motorway").play(
        cast, times
    )
