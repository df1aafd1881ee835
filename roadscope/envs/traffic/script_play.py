"""The timeline of scripted traffic on a road that bends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.envs.traffic.course import Course
from roadscope.envs.traffic.mix import Body
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.timeline import Timeline

WITHIN_M = 250.0
"""A player is there while its way along the course is this near the ego's."""
BEYOND_M = 260.0
"""How far the road goes on before and behind the ego's way."""


@dataclass(frozen=True, slots=True)
class Player:
    """Somebody on a road: x of the motion is the way along its course, y that to its left.

    ahead: 1 for the course's direction, -1 for oncoming; who comes the other way has a speed
        below 0.
    """

    motion: Motion
    body: Body
    ahead: int = 1


@dataclass(frozen=True, slots=True)
class Road:
    """A course with lanes beside it.

    lanes: where each lies, metres to the left of the course, and its direction as a `Player` has.
    """

    course: Course
    lanes: tuple[tuple[float, int], ...]
    width_m: float
    style: str

    def play(self, cast: Sequence[Player], times: np.ndarray) -> Timeline:
        """Return what a cast does at (T,) times, seconds; the first of it is the ego."""
        ways = np.stack([player.motion.places(times) for player in cast], axis=1)
        near = np.abs(ways[..., 0] - ways[:, :1, 0]) < WITHIN_M
        kept = near.any(axis=0)
        cast = [player for player, there in zip(cast, kept, strict=True) if there]
        ways, near = ways[:, kept], near[:, kept]
        speeds, yaws = self._going(cast, ways, times)
        sizes = np.array([player.body.size for player in cast])
        present = np.logical_or.accumulate(near) & np.logical_or.accumulate(near[::-1])[::-1]
        return Timeline(
            stamps_s=times,
            ids=np.arange(len(cast)),
            categories=np.array([player.body.category for player in cast], np.int8),
            sizes=sizes,
            centre_ahead_m=sizes[:, 0] / 2,
            present=present,
            axles=self.course.places(ways[..., 0], ways[..., 1]),
            yaws=yaws,
            speeds=speeds,
            crashed=np.zeros_like(present),
            road=self._map(ways[:, 0, 0]),
            style=self.style,
        )

    def _going(
        self, cast: Sequence[Player], ways: np.ndarray, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(T, A) speeds and yaws of rear axles, which do not slip."""
        rates = np.stack([player.motion.velocities(times) for player in cast], axis=1)
        ahead = np.array([player.ahead for player in cast])
        bend = self.course.curvatures(ways[..., 0])
        # Who stands has no direction of motion: rounding must not turn it round.
        forward = np.maximum(ahead * rates[..., 0] * (1.0 - bend * ways[..., 1]), 0.0)
        aside = ahead * rates[..., 1]
        back = np.where(ahead > 0, 0.0, np.pi)
        yaws = self.course.headings(ways[..., 0]) + back + np.arctan2(aside, forward)
        return np.hypot(forward, aside), yaws

    def _map(self, along: np.ndarray) -> RoadMap:
        ways = np.arange(along.min() - BEYOND_M, along.max() + BEYOND_M, 2.0)
        width = np.full_like(ways, self.width_m)
        return RoadMap.from_lanes(
            [
                (self.course.places(ways, np.full_like(ways, left))[::ahead], width)
                for left, ahead in self.lanes
            ]
        )
