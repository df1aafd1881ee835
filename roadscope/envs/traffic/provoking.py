"""Road users that act against the ego: they cut in ahead of it, or step out in front of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.flow import Flow
from roadscope.envs.traffic.lane_geometry import along_lane
from roadscope.envs.traffic.road_users import DRIVER, WALKER

CUT_IN_GAP_M = Bounds(6.0, 16.0)
"""Bumper to bumper, ahead of the ego, of a driver that cuts in."""
MOST_CLOSING_M_S = 2.5
"""Drivers cut in only if the ego comes closer at no more than this speed."""
SLOWER_M_S = Bounds(1.0, 4.0)
"""Drivers that have cut in want to drive so much more slowly than the ego."""
BETWEEN_CUT_INS_S = Bounds(3.0, 6.0)
REACTION_S, BRAKING_M_S2 = Bounds(1.4, 2.2), Bounds(3.5, 5.5)
"""People step out when a driver can just stop who brakes so hard after this time; within it they
come to be in the way, and the driver reacts."""
STEP_OUT_MARGIN_M = 1.5


@dataclass(slots=True)
class CutIns:
    """Lets drivers on the lanes beside the ego cut in closely ahead of it; a rule of a stage."""

    rng: np.random.Generator
    ego: int
    due_s: float = 3.0

    def __call__(self, flow: Flow) -> None:
        """Let one driver cut in, if it is time and somebody is at the right place."""
        if flow.now_s < self.due_s:
            return
        bodies = flow.bodies
        slot = int(np.flatnonzero(bodies["number"] == self.ego)[0])
        ego, lanes = bodies[slot], flow.roads.arrays.lanes
        beside = (bodies["kind"] == DRIVER) & (abs(bodies["lane"] - ego["lane"]) == 1)
        beside &= (lanes["road"][bodies["lane"]] == lanes["road"][ego["lane"]]) & (
            bodies["lane"] == bodies["target"]
        )
        traffic = flow.traffic()
        here = along_lane(traffic, int(ego["lane"]), slot)
        for other in np.flatnonzero(beside):
            body = bodies[other]
            ahead = along_lane(traffic, int(ego["lane"]), int(other)) - here
            gap = ahead - (body["length"] + ego["length"]) / 2
            closing = ego["speed"] - body["speed"]
            if CUT_IN_GAP_M.low <= gap <= CUT_IN_GAP_M.high and closing <= MOST_CLOSING_M_S:
                slower = float(self.rng.uniform(*SLOWER_M_S))
                body["target"], body["timer"] = ego["lane"], 0.0
                body["target_speed"] = max(float(ego["speed"]) - slower, 3.0)
                self.due_s = flow.now_s + float(self.rng.uniform(*BETWEEN_CUT_INS_S))
                return


@dataclass(slots=True)
class StepOuts:
    """Lets people at the kerb step out in front of the ego, who do not look; a rule of a stage.

    ego: its number. people: numbers of those who wait for the ego. It must come after `People`.
    """

    rng: np.random.Generator
    ego: int
    people: list[int]
    walking: list[int] = field(default_factory=list)

    def __call__(self, flow: Flow) -> None:
        """Let those step out whom the ego reaches when it can just stop."""
        bodies = flow.bodies
        ego = bodies[bodies["number"] == self.ego][0]
        for slot in np.flatnonzero(bodies["kind"] == WALKER):
            person = bodies[slot]
            number = int(person["number"])
            if number in self.walking:
                person["blocked"] = False
            if number not in self.people or person["crossing"]:
                continue
            x, y = person["x"] - ego["x"], person["y"] - ego["y"]
            ahead = x * ego["cos"] + y * ego["sin"] - ego["length"] / 2
            reaction, braking = self.rng.uniform(*REACTION_S), self.rng.uniform(*BRAKING_M_S2)
            stopping = ego["speed"] * reaction + ego["speed"] ** 2 / (2 * braking)
            if 0.0 < ahead < stopping + STEP_OUT_MARGIN_M:
                person["crossing"], person["blocked"] = True, False
                self.people.remove(number)
                self.walking.append(number)
