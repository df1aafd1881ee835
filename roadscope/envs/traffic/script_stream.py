"""Lanes in which traffic streams past an ego, or along with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.envs.traffic.course import Course
from roadscope.envs.traffic.script_lane import Lane, Pair, breathing
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_play import Player, Road

REACH_M = 220.0
"""A stream is filled as far as this before and behind the ego, at every instant."""
WAVER_M_S = 0.8


@dataclass(frozen=True, slots=True)
class Carriageways:
    """Lanes of the ego's direction and, left of a gap, oncoming ones.

    count: lanes of the ego's direction.
    mine: which of them is the ego's, from the left; it lies on the course.
    mix: a name of `mix.MIXES`.
    oncoming: lanes of the other direction.
    gaps_m, delays_s: as in `Lane`.
    median_m: width of the gap between both directions.
    """

    count: int
    mine: int
    mix: str
    oncoming: int = 0
    gaps_m: Pair = (4.0, 16.0)
    delays_s: Pair = (0.8, 1.5)
    width_m: float = 3.5
    median_m: float = 1.0

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """Lanes of the ego's direction from left to right, then those of the other."""
        ours = [((self.mine - i) * self.width_m, 1) for i in range(self.count)]
        first = (self.mine + 1) * self.width_m + self.median_m
        theirs = [(first + i * self.width_m, -1) for i in range(self.oncoming)]
        return tuple(
            Lane(left, self.mix, self.gaps_m, self.delays_s, ahead=ahead)
            for left, ahead in ours + theirs
        )

    def stream(
        self, rng: np.random.Generator, lane: Lane, speeds: Pair, until_s: float
    ) -> list[Player]:
        """Fill a lane with all that come near the ego until then.

        speeds: of the lane in its direction and of the ego in the course's, m/s.
        """
        passing = (speeds[0] - lane.ahead * speeds[1]) * until_s
        reach = REACH_M + max(passing, 0.0), REACH_M + max(-passing, 0.0)
        motion = Motion(float(rng.uniform(-20.0, 20.0)), 0.0, lane.ahead * speeds[0])
        motion = breathing(rng, motion, (-2.0, until_s), WAVER_M_S)
        return lane.with_first(rng, motion, reach)

    def road(self, course: Course, style: str) -> Road:
        """Return the road with these lanes."""
        ways = tuple((lane.left_m, lane.ahead) for lane in self.lanes)
        return Road(course, ways, self.width_m, style)
