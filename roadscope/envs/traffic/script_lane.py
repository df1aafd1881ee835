"""A lane of scripted traffic: everybody does what who is ahead did, a little later."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from roadscope.envs.traffic.mix import Body, draw_body
from roadscope.envs.traffic.script_motion import Change, Motion
from roadscope.envs.traffic.script_play import Player

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Lane:
    """Traffic of one lane as Newell's simplified car following has it (2002).

    A follower's way is that of who is ahead, `delay_s` later and a body and a gap behind, so
    nobody ever touches anybody and speeds are smooth wherever the leader's is.

    left_m: where the lane lies, metres to the left of the course.
    mix: a name of `mix.MIXES`.
    gaps_m: least and most distance between bumpers at standstill; drawn for each vehicle.
    delays_s: likewise how much later a vehicle does what the one ahead of it does.
    aside_m: how far vehicles keep from the middle of the lane, at most.
    ahead: 1 for the course's direction, -1 for oncoming.
    """

    left_m: float
    mix: str
    gaps_m: Pair
    delays_s: Pair = (0.0, 0.0)
    aside_m: float = 0.25
    ahead: int = 1

    def around(
        self, rng: np.random.Generator, motion: Motion, body: Body, reach_m: Pair
    ) -> list[Player]:
        """Return the others of a lane around one vehicle, so far behind and ahead of it."""
        queue = []
        for step, reach in ((1, reach_m[1]), (-1, reach_m[0])):
            for other in self._others(rng, motion, body, step):
                if step * self.ahead * (other.motion.x_m - motion.x_m) > reach:
                    break
                queue.append(other)
        return queue

    def with_first(
        self, rng: np.random.Generator, motion: Motion, reach_m: Pair, body: Body | None = None
    ) -> list[Player]:
        """Return all vehicles of a lane, one of them with the motion given."""
        body = draw_body(self.mix, rng) if body is None else body
        motion = replace(motion, y_m=self._left(rng))
        return [Player(motion, body, self.ahead), *self.around(rng, motion, body, reach_m)]

    def _others(
        self, rng: np.random.Generator, motion: Motion, body: Body, step: int
    ) -> Iterator[Player]:
        """Go from vehicle to vehicle in the driving direction, or against it."""
        while True:
            following, body = body, draw_body(self.mix, rng)
            # Rear axles: a body lies ahead of its own.
            room = float(rng.uniform(*self.gaps_m)) + (following if step > 0 else body).size[0]
            delay = float(rng.uniform(*self.delays_s))
            motion = shifted(motion, self.ahead * step * room, -step * delay)
            motion = replace(motion, y_m=self._left(rng))
            yield Player(motion, body, self.ahead)

    def _left(self, rng: np.random.Generator) -> float:
        return self.left_m + float(rng.uniform(-1.0, 1.0)) * self.aside_m


def shifted(motion: Motion, ahead_m: float, later_s: float) -> Motion:
    """Return the motion of who does the same later and farther ahead."""

    def later(changes: tuple[Change, ...]) -> tuple[Change, ...]:
        return tuple((start + later_s, duration, change) for start, duration, change in changes)

    return Motion(
        motion.x_m + ahead_m - motion.speed * later_s, motion.y_m, motion.speed,
        later(motion.speed_changes), later(motion.lane_changes),
    )  # fmt: skip


def breathing(rng: np.random.Generator, motion: Motion, span_s: Pair, most_m_s: float) -> Motion:
    """Let the speed go up and down slowly around what it is, by so much at most."""
    changes, off = list(motion.speed_changes), 0.0
    at = span_s[0]
    while at < span_s[1]:
        length = float(rng.uniform(4.0, 8.0))
        to = float(rng.uniform(-1.0, 1.0)) * most_m_s
        changes.append((at, length, to - off))
        at, off = at + length + float(rng.uniform(0.0, 2.0)), to
    return replace(motion, speed_changes=tuple(changes))
