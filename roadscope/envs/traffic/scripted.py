"""The three experiments of Lu 2018 as scripts: closed-form motion with exact event frames.

The paper numbers LiDAR frames from 1 and gives no times; here frame k has the stamp k x 0.08 s.
Physics runs at 25 Hz, so frame k is sub-step 2k. Seeds vary speeds, offsets and sizes; starts are
solved for so that every event falls between the same two frames.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.mix import CARS, EGO, VANS, Body
from roadscope.envs.traffic.script_cast import STEP_S, Cast, any_car, timeline_of
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.script_view import LEFT_EDGE, azimuths, depth_in_view
from roadscope.envs.traffic.timeline import Timeline

FRAME_S = 0.08
LEAD_FRAMES = 2
"""The recording begins this many frames before frame 0 and ends as many after the last."""
LANE_M = 3.5
LANES = (LANE_M, 0.0, -LANE_M)


# Fractions of a frame: rolling shutter (a sixth of a frame either way) and rounded corners must
# not move an event over a frame's stamp.
ENTERS, LEAVES, HIDES, SHOWS = 0.25, 0.75, 0.6, 0.45


@dataclass(frozen=True, slots=True)
class Event:
    """What the paper says of a target in frames `first` to `last`, both included.

    target: actor id; the paper's target numbers.
    kind: `in_view` (some of it inside the field of view, hidden or not), `hidden` (wholly behind
        another target) or `missed` (the experiment suppresses its returns).
    """

    target: int
    kind: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Script:
    """An experiment: frames 1 to `frames` and what happens in them."""

    name: str
    frames: int
    events: tuple[Event, ...]

    def of(self, kind: str, target: int) -> tuple[Event, ...]:
        """Return the events of one kind that befall one target."""
        return tuple(e for e in self.events if e.kind == kind and e.target == target)


def _scripts(*items: Script) -> Mapping[str, Script]:
    return MappingProxyType({item.name: item for item in items})


SCRIPTS: Mapping[str, Script] = _scripts(
    # The paper: the left car enters in frame 26; in frame 147 it drives out of view, its filter
    # uses frame 146 for the last time. So it is in view from 26 to 146.
    Script(
        "lu2018-two-vehicles", 190,
        (
            Event(1, "in_view", 1, 190), Event(2, "in_view", 26, 146),
            *(Event(1, "missed", frame, frame) for frame in (102, 148, 172, 177)),
        ),
    ),
    Script(
        "lu2018-occlusion", 130,
        (Event(1, "in_view", 1, 130), Event(2, "in_view", 51, 130), Event(1, "hidden", 62, 74)),
    ),
    # The paper: target 1 vanishes from view in frame 16, so 15 is the last one that shows it.
    Script(
        "lu2018-three-vehicles", 100,
        (Event(1, "in_view", 1, 15), Event(2, "in_view", 1, 100), Event(3, "in_view", 1, 100)),
    ),
)  # fmt: skip


def play_script(name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Play an experiment from two frames before frame 0 to two after its last, or up to a time."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    cast = _CASTS[name](rng)
    end_s = (SCRIPTS[name].frames + LEAD_FRAMES) * FRAME_S if duration_s is None else duration_s
    times = np.arange(-2 * LEAD_FRAMES, round(end_s / STEP_S) + 1) * STEP_S
    return timeline_of(cast, times, lanes=LANES, width_m=LANE_M, style="campus")


def _two_vehicles(rng: np.random.Generator) -> Cast:
    """Target 1 keeps ahead on the right; target 2 overtakes on the left and falls back."""
    ego = Motion(0.0, 0.0, float(rng.uniform(8.5, 9.5)))
    gap = 5.0 + float(rng.uniform(13.0, 19.0))
    sway = float(rng.uniform(-0.5, 0.5))
    right = Motion(
        gap, -LANE_M + float(rng.uniform(-0.2, 0.3)), ego.speed,
        ((2.0, 4.0, sway), (8.0, 4.0, -sway)),
    )  # fmt: skip
    surplus, slowing = float(rng.uniform(5.0, 6.0)), float(rng.uniform(7.5, 8.5))
    middle = (25 + ENTERS + 146 + LEAVES) / 2 * FRAME_S
    left = Motion(
        0.0, LANE_M + float(rng.uniform(-0.2, 0.3)), ego.speed + surplus,
        ((middle - slowing / 2, slowing, -2 * surplus),),
    )  # fmt: skip
    bodies = [any_car(rng), any_car(rng)]
    left = _entering(left, bodies[1], ego, 25 + ENTERS)
    return (ego, EGO), (right, bodies[0]), (left, bodies[1])


def _three_vehicles(rng: np.random.Generator) -> Cast:
    """Target 1 on the left falls back out of view, targets 2 and 3 keep ahead."""
    ego = Motion(0.0, 0.0, float(rng.uniform(8.5, 9.5)))
    slower = ego.speed - float(rng.uniform(4.5, 5.5))
    left = Motion(0.0, LANE_M + float(rng.uniform(-0.2, 0.3)), slower)
    sway = float(rng.uniform(-0.5, 0.5))
    ahead = Motion(
        5.0 + float(rng.uniform(20.0, 26.0)), float(rng.uniform(-0.3, 0.3)), ego.speed,
        ((1.0, 3.0, sway), (4.0, 3.0, -sway)),
    )  # fmt: skip
    right = Motion(
        5.0 + float(rng.uniform(9.0, 13.0)), -LANE_M + float(rng.uniform(-0.3, 0.2)), ego.speed,
        ((1.0, 3.0, -sway), (4.0, 3.0, sway)),
    )  # fmt: skip
    bodies = [any_car(rng), any_car(rng), any_car(rng)]
    left = _entering(left, bodies[0], ego, 15 + LEAVES)
    return (ego, EGO), (left, bodies[0]), (ahead, bodies[1]), (right, bodies[2])


def _occlusion(rng: np.random.Generator) -> Cast:
    """Target 1 drives ahead; target 2 overtakes on the left and cuts in closely between.

    Crossing in front of the LiDAR it hides target 1 from its right to its left edge; target 1,
    a little left of the lane's middle, comes out on its left side again.
    """
    ego = Motion(0.0, 0.0, float(rng.uniform(7.0, 8.0)))
    hidden = Motion(5.0 + float(rng.uniform(33.0, 37.0)), float(rng.uniform(0.6, 0.8)), ego.speed)
    surplus = float(rng.uniform(7.3, 7.8))
    bodies = [Body(Category.CAR, CARS[int(rng.integers(4))]), Body(Category.VAN, VANS[1])]
    side, across = float(rng.uniform(3.4, 3.6)), -float(rng.uniform(4.95, 5.15))

    def cutting_in(start: float, duration: float) -> Motion:
        motion = Motion(
            0.0, side, ego.speed + surplus,
            ((47 * FRAME_S, 3.0, 1.5 - surplus),), ((start, duration, across),),
        )  # fmt: skip
        return _entering(motion, bodies[1], ego, 50 + ENTERS)

    def misses(start: float, duration: float) -> np.ndarray:
        times = np.array([61 + HIDES, 74 + SHOWS]) * FRAME_S
        front = azimuths(cutting_in(start, duration), bodies[1].size, ego, times)
        back = azimuths(hidden, bodies[0].size, ego, times)
        return np.array([front[0, 0] - back[0, 0], front[1, 1] - back[1, 1]])

    hiding = cutting_in(*_solve(misses, np.array([3.3, 3.7])))
    return (ego, EGO), (hidden, bodies[0]), (hiding, bodies[1])


def _entering(motion: Motion, body: Body, ego: Motion, frame: float) -> Motion:
    """Shift a motion along x until its body touches the left end of the view at a frame."""
    time = np.array([frame * FRAME_S])
    for _ in range(2):
        depth = float(depth_in_view(motion, body.size, ego, time)[0])
        motion = replace(motion, x_m=motion.x_m - depth / float(np.sin(LEFT_EDGE)))
    return motion


def _solve(misses: Callable[[float, float], np.ndarray], guess: np.ndarray) -> tuple[float, float]:
    """Find the pair of values that makes both misses vanish, by Newton's method."""
    nudge = 1e-6
    for _ in range(60):
        wrong = misses(*guess)
        if np.abs(wrong).max() < 1e-12:
            return float(guess[0]), float(guess[1])
        slopes = [(misses(*(guess + nudge * unit)) - wrong) / nudge for unit in np.eye(2)]
        guess = guess - np.clip(np.linalg.solve(np.array(slopes).T, wrong), -0.2, 0.2)
    raise ArithmeticError("no cutting in hides the target in the frames of the script")


_CASTS: Mapping[str, Callable[[np.random.Generator], Cast]] = {
    "lu2018-two-vehicles": _two_vehicles,
    "lu2018-occlusion": _occlusion,
    "lu2018-three-vehicles": _three_vehicles,
}
