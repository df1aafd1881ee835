"""Road users that act against the ego: they cut in ahead of it, or step out in front of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.flow import Flow
from roadscope.envs.traffic.lane_geometry import along_lane
from roadscope.envs.traffic.road_users import DRIVER, WALKER

# Constants are chosen by hand on train seeds, so that the simulation's own drivers, which know the
# truth, avoid nearly all collisions.

CUT_IN_GAP_M = Bounds(6.0, 16.0)
"""Gap from the ego's front to the rear of a driver that cuts in."""
FREE_BEHIND_M, FREE_AHEAD_M = 3.0, 5.0
"""A driver cuts in only if nobody but the ego is on the ego's lane within these distances of that
driver's rear and front."""
MOST_CLOSING_M_S = 2.5
"""Drivers cut in only if the ego approaches them at no more than this speed."""
SLOWER_M_S = Bounds(1.0, 4.0)
"""How much slower than the ego drivers want to be after they cut in."""
BETWEEN_CUT_INS_S = Bounds(3.0, 6.0)
"""Least time from one cut-in to the next."""
REACTION_S, BRAKING_M_S2 = Bounds(1.4, 2.2), Bounds(3.5, 5.5)
"""A person steps out at the distance in which a driver can just stop who reacts after the first and
brakes with the second. The reaction includes the time in which the person walks into the lane."""
STEP_OUT_MARGIN_M = 1.5
"""Added to that distance."""


@dataclass(slots=True)
class CutIns:
    """Lets drivers on the lanes beside the ego cut in closely ahead of it: one of `Stage.rules`.

    rng: of its own, so that other traffic does not depend on how the ego drives.
    ego: its number. due_s: instant from which the next driver may cut in.
    """

    rng: np.random.Generator
    ego: int
    due_s: float = 3.0

    def __call__(self, flow: Flow) -> None:
        """Let one driver cut in, if it is time and somebody is at the right place."""
        if flow.now_s < self.due_s:
            return
        bodies, lanes = flow.bodies, flow.roads.arrays.lanes
        slot = int(np.flatnonzero(bodies["number"] == self.ego)[0])
        ego, lane = bodies[slot], int(bodies["lane"][slot])
        traffic = flow.traffic()
        along = np.array([along_lane(traffic, lane, k) for k in range(len(bodies))])
        along -= along[slot]
        halves = bodies["length"] / 2
        beside = (bodies["kind"] == DRIVER) & (abs(bodies["lane"] - lane) == 1)
        beside &= lanes["road"][bodies["lane"]] == lanes["road"][lane]
        beside &= bodies["lane"] == bodies["target"]
        on_lane = (bodies["lane"] == lane) | (bodies["target"] == lane)
        on_lane[slot] = False
        for other in np.flatnonzero(beside):
            body, centre, half = bodies[other], along[other], halves[other]
            gap = centre - half - halves[slot]
            closing = ego["speed"] - body["speed"]
            in_place = CUT_IN_GAP_M.low <= gap <= CUT_IN_GAP_M.high
            near = (along + halves > centre - half - FREE_BEHIND_M) & (
                along - halves < centre + half + FREE_AHEAD_M
            )
            if in_place and closing <= MOST_CLOSING_M_S and not (near & on_lane).any():
                slower = float(self.rng.uniform(*SLOWER_M_S))
                body["target"], body["timer"] = lane, 0.0
                body["target_speed"] = max(float(ego["speed"]) - slower, 3.0)
                self.due_s = flow.now_s + float(self.rng.uniform(*BETWEEN_CUT_INS_S))
                return


class StepOut(NamedTuple):
    """When a person steps out: reaction time and deceleration of a driver who can just stop."""

    reaction_s: float
    braking_m_s2: float

    @staticmethod
    def draw(rng: np.random.Generator) -> StepOut:
        """Draw those of one person."""
        return StepOut(float(rng.uniform(*REACTION_S)), float(rng.uniform(*BRAKING_M_S2)))


@dataclass(slots=True)
class StepOuts:
    """Lets people at the kerb step out in front of the ego without looking: one of `Stage.rules`.

    It must come after `People` in the rules, since it overrides whether people are blocked.

    ego: its number. waiting: when each person at the kerb steps out, by the person's number.
    walking: numbers of those who have stepped out.
    """

    ego: int
    waiting: dict[int, StepOut]
    walking: set[int] = field(default_factory=set)

    def __call__(self, flow: Flow) -> None:
        """Start the crossing of each person whom the ego can just stop for."""
        bodies = flow.bodies
        ego = bodies[bodies["number"] == self.ego][0]
        for slot in np.flatnonzero(bodies["kind"] == WALKER):
            person = bodies[slot]
            number = int(person["number"])
            if number in self.waiting and self._is_due(ego, person, self.waiting[number]):
                del self.waiting[number]
                self.walking.add(number)
                person["crossing"] = True
            if number in self.walking:
                person["blocked"] = False

    @staticmethod
    def _is_due(ego: np.void, person: np.void, step_out: StepOut) -> bool:
        x, y = person["x"] - ego["x"], person["y"] - ego["y"]
        ahead = x * ego["cos"] + y * ego["sin"] - ego["length"] / 2
        stopping = ego["speed"] * step_out.reaction_s
        stopping += ego["speed"] ** 2 / (2 * step_out.braking_m_s2)
        return bool(0.0 < ahead < stopping + STEP_OUT_MARGIN_M)
