"""Waves of standstill in a jam."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.course import PEAK, winding
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player
from roadscope.envs.traffic.script_stream import Carriageways
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 60.0
REACH_M = (170.0, 170.0)


def stop_and_go(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand and drive up to 6 to 11 m/s in turn, in two to four full lanes: 190 to 300 m in 60 s.

    Waves run backwards through each lane, vehicles answering 0.9 to 1.4 s after the one ahead;
    lanes have waves of their own, so that now these, now those creep past the ego.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    count = int(rng.integers(2, 5))
    mine = int(rng.integers(count))
    ways = Carriageways(count, mine, "motorway", gaps_m=(2.0, 5.0), delays_s=(0.9, 1.4))
    ego = _waves(rng, 0.0, float(times[-1]))
    cast = [Player(ego, EGO), *ways.lanes[mine].around(rng, ego, EGO, REACH_M)]
    for i, lane in enumerate(ways.lanes):
        if i != mine:
            beside = _waves(rng, float(rng.uniform(-8.0, 8.0)), float(times[-1]))
            cast += lane.with_first(rng, beside, REACH_M)
    course = winding(rng, (-REACH_M[0], 11.0 * times[-1]), float(rng.uniform(500.0, 900.0)))
    return ways.road(course, "motorway").play(cast, times)


def _waves(rng: np.random.Generator, at_m: float, until_s: float) -> Motion:
    """Drive, stand, drive on; waves began before the recording and end after it."""
    margin_s = 40.0
    at, changes = -margin_s + float(rng.uniform(0.0, 15.0)), []
    first = speed = float(rng.uniform(6.0, 11.0))
    while at < until_s + margin_s:
        braking = PEAK * speed / float(rng.uniform(1.0, 2.2))
        changes.append((at, braking, -speed))
        at += braking + float(rng.uniform(1.5, 5.0))
        speed = float(rng.uniform(6.0, 11.0))
        pulling = PEAK * speed / float(rng.uniform(0.9, 1.6))
        changes.append((at, pulling, speed))
        at += pulling + float(rng.uniform(0.0, 6.0))
    motion = Motion(0.0, 0.0, first, tuple(changes))
    now = float(motion.places(np.zeros(1))[0, 0])
    return Motion(at_m - now, 0.0, first, tuple(changes))
