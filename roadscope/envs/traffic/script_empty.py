"""Roads without any traffic: what an odometry does when nothing but the world is there."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.course import PEAK, winding
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_lane import breathing
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player
from roadscope.envs.traffic.script_stream import REACH_M, Carriageways
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 30.0
PULL_M_S2, TOWN_M_S = 1.6, 14.0
"""Peak acceleration of who starts from rest up to the speed of a town; from the peak on, faster
ones gain the rest as gently."""


def empty_motorway(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive alone at 18 to 28 m/s on two or three lanes each way, between rails and trees.

    Odd seeds stand for 2 to 4 s and pull away, and reach that after 20 to 30 s; even ones are at
    speed from the first scan on.
    """
    return _alone(seed, (18.0, 28.0), "motorway", duration_s)


def empty_street(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive alone at 8 to 14 m/s past houses, trees and parked cars; starts as above."""
    return _alone(seed, (8.0, 14.0), "urban", duration_s)


def _alone(
    seed: int, speeds: tuple[float, float], style: str, duration_s: float | None
) -> Timeline:
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    until, speed = float(times[-1]), float(rng.uniform(*speeds))
    ego, begin, start = Motion(0.0, 0.0, speed), -2.0, float(rng.uniform(2.0, 4.0))
    if seed % 2:
        low = min(speed, TOWN_M_S)
        length = PEAK * low / PULL_M_S2
        changes = [(start, length, low)]
        if speed > low:
            changes.append((start + length / 2, length, speed - low))
        ego, begin = Motion(0.0, 0.0, 0.0, tuple(changes)), sum(changes[-1][:2])
    count = int(rng.integers(2, 4))
    ways = Carriageways(count, int(rng.integers(count)), style, oncoming=count)
    ego = breathing(rng, ego, (begin, until), 0.8)
    course = winding(rng, (-REACH_M, (speed + 1) * until), speed**2 / rng.uniform(0.5, 1.2))
    return ways.road(course, style).play([Player(ego, EGO)], times)
