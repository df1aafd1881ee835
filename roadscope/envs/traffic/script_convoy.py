"""Standing at a light among lorries, and pulling away together with them."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.course import PEAK, winding
from roadscope.envs.traffic.mix import EGO, HEAVY_TRUCKS, Body
from roadscope.envs.traffic.script_cast import times_until
from roadscope.envs.traffic.script_lane import Lane, breathing
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player, Road
from roadscope.envs.traffic.timeline import Timeline

DURATION_S = 40.0
WIDTH_M = 3.4
BEHIND_M = 110.0


def convoy_pull_away(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand 2 to 4 s in an inner lane of three or four, then drive 250 to 450 m in 40 s.

    An articulated lorry or a rigid one stands on each side, more than half of the others are vans,
    lorries and buses. All lanes pull away within a second of each other, to speeds that differ by
    a few per cent, so what is around the ego keeps its place while the roadside, little of which
    is to be seen, moves.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    count = int(rng.integers(3, 5))
    mine = int(rng.integers(1, count - 1))
    lanes = [
        Lane((mine - i) * WIDTH_M, "convoy", (1.5, 3.5), (0.2, 0.9)) for i in range(count)
    ]  # fmt: skip
    start_s, speed = float(rng.uniform(2.0, 4.0)), float(rng.uniform(9.0, 14.0))
    pull, front_m = float(rng.uniform(0.9, 1.4)), float(rng.uniform(25.0, 90.0))
    reach = (BEHIND_M, front_m)
    ego = _pulling(rng, (start_s, speed, pull), 0.0, times[-1])
    cast = [Player(ego, EGO), *lanes[mine].around(rng, ego, EGO, reach)]
    for lane in lanes[:mine] + lanes[mine + 1 :]:
        later, faster = float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.95, 1.05))
        green = start_s + later, speed * faster, pull
        beside = _pulling(rng, green, float(rng.uniform(-9.0, 1.0)), times[-1])
        lorry = Body(Category.TRUCK, HEAVY_TRUCKS[int(rng.integers(2))])
        cast += lane.with_first(rng, beside, reach, lorry)
    course = winding(rng, (-BEHIND_M, speed * times[-1]), speed**2 / float(rng.uniform(0.5, 1.2)))
    ways = tuple((lane.left_m, 1) for lane in lanes)
    return Road(course, ways, WIDTH_M, "urban").play(cast, times)


def _pulling(
    rng: np.random.Generator, green: tuple[float, float, float], at_m: float, until_s: float
) -> Motion:
    """Start at a time, up to a speed, with a peak acceleration; then keep it roughly."""
    start, speed, pull = green
    length = PEAK * speed / pull
    motion = Motion(at_m, 0.0, 0.0, ((start, length, speed),))
    return breathing(rng, motion, (start + length, until_s), 0.4)
