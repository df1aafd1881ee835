"""Driving between long smooth walls."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.course import winding
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_lane import Pair, breathing
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player
from roadscope.envs.traffic.script_stream import REACH_M, Carriageways
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 30.0


def barriers(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 15 to 28 m/s on a motorway between noise walls: 450 to 840 m in 30 s.

    Two or three lanes, by seed with three oncoming ones beside; the walls, 3.5 m high and 4.5 m
    off, are straight or bend gently, and only a sign now and then tells places apart.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    count, facing = int(rng.integers(2, 4)), 3 * int(rng.integers(2))
    mine = int(rng.integers(count))
    ways = Carriageways(count, mine, "motorway", oncoming=facing, median_m=2.0)
    return _drive(rng, ways, (15.0, 28.0), "barriers", duration_s)


def tunnel(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 14 to 25 m/s through a tunnel of two or three lanes: 420 to 750 m in 30 s.

    Walls 1 m off and a ceiling 5 m up, all smooth; lamps under the ceiling every 12 m or more and
    niches every 100 m or so are all that changes along it. Scenes begin and end inside: there are
    no portals.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    count = int(rng.integers(2, 4))
    ways = Carriageways(count, int(rng.integers(count)), "motorway")
    return _drive(rng, ways, (14.0, 25.0), "tunnel", duration_s)


def _drive(
    rng: np.random.Generator, ways: Carriageways, speeds: Pair, style: str, duration_s: float | None
) -> Timeline:
    times = times_until(DURATION_S if duration_s is None else duration_s)
    until, speed = float(times[-1]), float(rng.uniform(*speeds))
    ego = breathing(rng, Motion(0.0, 0.0, speed), (-2.0, until), 0.8)
    cast = [Player(ego, EGO), *ways.lanes[ways.mine].around(rng, ego, EGO, (REACH_M, REACH_M))]
    for i, lane in enumerate(ways.lanes):
        if i != ways.mine:
            faster = (ways.mine - i) * float(rng.uniform(1.0, 2.5)) if i < ways.count else 0.0
            cast += ways.stream(rng, lane, (speed + faster, speed), until)
    course = winding(rng, (-REACH_M, (speed + 1) * until), speed**2 / float(rng.uniform(0.3, 1.0)))
    return ways.road(course, style).play(cast, times)
